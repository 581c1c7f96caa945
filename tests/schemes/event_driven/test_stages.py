"""Kernels of the smooth motion of one mechanism, against Pinocchio, differences and dense matrices."""

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from mbvi.constraints.features.feature_kernels import (
    EDGES,
    FACE_RIM,
    LINE_VERTEX,
    POINTS,
    RIM_FACE,
    VERTEX_FACE,
    VERTEX_LINE,
)
from mbvi.constraints.mechanism.held_rows import LIMIT, force_margins, hold, write_gaps_of, write_held
from mbvi.schemes.event_driven.stages import accelerate
from mbvi.system.mechanisms.chart import joint_chart_rates
from support.held_row_arguments import moving, random_parts
from support.joint_tree_arguments import random_model, tree_of

seeds = st.integers(0, 10_000).map(np.random.default_rng)


@given(seeds, st.floats(1e-3, 2.0))
def test_the_rate_of_a_chart(rng, size):
    """Pinocchio's derivative of the retraction takes it back to the velocity."""
    model = random_model(rng)
    pin.seed(int(rng.integers(2**31)))
    q, v, rate = pin.randomConfiguration(model, -np.ones(model.nq), np.ones(model.nq)), rng.normal(size=model.nv), None
    dq = rng.uniform(-size, size, size=model.nv)
    rate = np.empty(model.nv)
    joint_chart_rates(tree_of(model), dq, v, rate)
    # Pinocchio's series for small angles are exact to 1e-11
    np.testing.assert_allclose(pin.dIntegrate(model, q, dq, pin.ARG1) @ rate, v, atol=1e-10)


@given(seeds)
@settings(max_examples=30)
def test_accelerations_without_contact_forces(rng):
    system, motion, rows, q, v = moving(rng)
    accelerate(motion, rows, q, v)
    data = system.model.createData()
    expected = pin.aba(system.model, data, q, v, motion.torque - system.damping * v)
    np.testing.assert_allclose(motion.free, expected, atol=1e-10 * np.abs(expected).max())


def _gap(model, row, q):
    """The gap of one row, from Pinocchio's placements."""
    kind, sides, parts, radius = row
    if kind == LIMIT:
        return parts[0, 0, 0] * q[sides[0]] + parts[0, 0, 1]
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    (a, d), (b, e) = (
        (data.oMi[int(body)].act(part[0]), data.oMi[int(body)].rotation @ part[1])
        for body, part in zip(sides, parts, strict=True)
    )
    if kind in (LINE_VERTEX, VERTEX_LINE, POINTS):
        axis = {LINE_VERTEX: d, VERTEX_LINE: e, POINTS: np.zeros(3)}[kind]
        return np.linalg.norm(b - a - ((b - a) @ axis) * axis) - radius
    if kind == EDGES:
        return np.cross(d, e) / np.linalg.norm(np.cross(d, e)) @ (b - a) - radius
    normal, axis = (e, d) if kind in (VERTEX_FACE, RIM_FACE) else (d, e)
    rim = 0.0
    if kind in (FACE_RIM, RIM_FACE):
        # the lowest point of the rim, from two directions within the disc
        across = np.linalg.svd(axis[None])[2][1:]
        rim = np.linalg.norm(axis) * np.linalg.norm(across @ normal)
    return normal @ (b - a) - rim - radius


def _let_touch(model, rows, q):
    """Move the features of the second bodies along normals to where the gaps are zero, as those of closed rows are."""
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    for kind, sides, parts, radius in zip(rows.kind, rows.sides, rows.parts, rows.radius, strict=True):
        if kind == LIMIT:
            continue
        turned = data.oMi[int(sides[1])].rotation
        for _ in range(3):
            # along the slope of the gap, which is the normal, the gap is linear
            gap, moved = _gap(model, (kind, sides, parts, radius), q), parts[1, 0].copy()
            normal = np.array([_slope(model, (kind, sides, parts, radius), q, axis) for axis in np.eye(3)])
            assert np.linalg.norm(turned @ normal) == pytest.approx(1.0)
            parts[1, 0] = moved - gap * normal


def _slope(model, row, q, axis):
    kind, sides, parts, radius = row
    gaps = []
    for k in (-2, -1, 1, 2):
        other = parts.copy()
        other[1, 0] += 1e-3 * k * axis
        gaps.append(_gap(model, (kind, sides, other, radius), q))
    return (gaps[0] - 8 * gaps[1] + 8 * gaps[2] - gaps[3]) / 12e-3


@given(seeds)
@settings(max_examples=40)
def test_gaps_and_their_first_two_derivatives(rng):
    """Along a motion of constant velocity, by differences of gaps from Pinocchio's placements."""
    system, motion, rows, q, v = moving(rng)
    _let_touch(system.model, rows, q)
    accelerate(motion, rows, q, v)
    write_held(motion.mechanism, rows)
    gap, index = np.empty(len(rows.kind)), np.arange(len(rows.kind))
    write_gaps_of(motion.mechanism, random_parts(rng, system.model, 0)._replace(
        kind=rows.kind, sides=rows.sides, parts=rows.parts, radius=rows.radius), index, q, gap)  # fmt: skip
    s = 3e-4 / np.linalg.norm(v)
    for i, row in enumerate(zip(rows.kind, rows.sides, rows.parts, rows.radius, strict=True)):
        before, last, here, after, next_ = (
            _gap(system.model, row, pin.integrate(system.model, q, k * s * v)) for k in (-2, -1, 0, 1, 2)
        )
        rate = (before - 8 * last + 8 * after - next_) / (12 * s)
        change = (-before + 16 * last - 30 * here + 16 * after - next_) / (12 * s * s)
        scale = 1.0 + np.abs(rows.rows[system.nv + i]).max()
        assert gap[i] == pytest.approx(here, abs=1e-11 * scale)
        assert rows.rows[system.nv + i] @ v == pytest.approx(rate, abs=1e-8 * scale * np.linalg.norm(v))
        assert -rows.wanted[i] == pytest.approx(change, abs=1e-5 * scale * np.linalg.norm(v) ** 2)


@given(seeds)
@settings(max_examples=40)
def test_rows_that_stay_closed_by_the_least_forces(rng):
    """Against the pseudoinverse of the Delassus matrix; rows may be there twice."""
    system, motion, rows, q, v = moving(rng)
    accelerate(motion, rows, q, v)
    k = len(rows.kind)
    if not k:
        return
    M = pin.crba(system.model, system.model.createData(), q)
    M = np.triu(M) + np.triu(M, 1).T
    J, wanted = rows.rows[system.nv :], rows.wanted
    W = np.linalg.solve(M, J.T)
    forces = np.linalg.pinv(J @ W, rcond=1e-10, hermitian=True) @ (wanted - J @ motion.free)
    kept, margins = motion.free + W @ forces, np.empty(k)
    size = np.abs(kept).max() + np.abs(motion.free).max()
    # two rows of one joint may ask for different accelerations, which closed contacts do not
    assume(np.abs(J @ kept - wanted).max() < 1e-6 * np.abs(J).max() * size)
    np.testing.assert_allclose(motion.kept, kept, atol=1e-6 * size)
    force_margins(rows, motion.free, 0.0, np.empty(k), margins)
    np.testing.assert_allclose(margins, forces * np.diag(J @ W), atol=1e-6 * np.abs(J).max() * size)
    # what keeps the rows already is not changed
    again = np.empty(system.nv)
    hold(motion.mechanism, rows, motion.kept.copy(), again)
    np.testing.assert_allclose(again, motion.kept, atol=1e-9 * size)
