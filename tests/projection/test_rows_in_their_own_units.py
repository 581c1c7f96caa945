"""No row is violated by more than the stated depth, however little it weighs beside the others."""

from typing import NamedTuple

import numpy as np
import pytest
from scipy.sparse import csr_array

from mbvi.errors import ProjectionError
from mbvi.projection import Acceptance, AcceptedDepth, DenseMetric, DiagonalMetric, Projector, StatedDepth
from mbvi.projection.coulomb.one_contact import coulomb_defect

H, TOLERANCE, DEPTH = 1e-3, 1e-8, 1e-6
SEEDS = range(6)


class Tangents(NamedTuple):
    friction: np.ndarray
    jacobian: np.ndarray
    rate: None = None
    resistance: None = None
    bound: None = None


class Rows(NamedTuple):
    constraint: np.ndarray
    jacobian: np.ndarray
    restitution: np.ndarray
    tangents: Tangents
    rate: None = None


def rows_of(normals, tangents, mu, sparse=False):
    kind = csr_array if sparse else np.ascontiguousarray
    count = len(normals)
    return Rows(np.arange(count), kind(normals), np.zeros(count), Tangents(mu, kind(tangents.reshape(2 * count, -1))))


def some_of(rows, count):
    tangents = rows.tangents._replace(
        friction=rows.tangents.friction[:count], jacobian=rows.tangents.jacobian[: 2 * count]
    )
    return Rows(rows.constraint[:count], rows.jacobian[:count], rows.restitution[:count], tangents)


def projector(jointed, tolerance=TOLERANCE):
    stated = StatedDepth(DEPTH, tolerance, H, lambda numbers: 1.0, jointed)
    return Projector(friction_residual=1e-3, stated=stated)


def trunk_and_fingers(rng, contacts=40, fingers=10):
    """Contacts of a heavy trunk, and limits of light fingers that hang on it and strike them."""
    heavy, inertia = 24, 10.0 ** rng.uniform(-6, -4, size=fingers)
    mass = np.concatenate([rng.uniform(1.0, 40.0, size=heavy), inertia])
    normals, tangents = np.zeros((contacts + fingers, len(mass))), np.zeros((contacts + fingers, 2, len(mass)))
    normals[:contacts, :heavy] = rng.normal(size=(contacts, heavy))
    # a floor on which all contacts can open
    normals[:contacts, 0] = 3.0
    tangents[:contacts, :, :heavy] = rng.normal(size=(contacts, 2, heavy))
    normals[contacts:, heavy:] = np.diag(rng.choice([-1.0, 1.0], size=fingers))
    # a finger that touches the floor as well couples both
    normals[:4, heavy : heavy + 4] = 0.05 * np.eye(4)
    x = np.concatenate([rng.normal(size=heavy) - 2.0 * (np.arange(heavy) == 0), 10.0 * rng.normal(size=fingers)])
    mu = np.concatenate([np.full(contacts, 0.4), np.zeros(fingers)])
    return x, DenseMetric(np.diag(mass)), rows_of(normals, tangents, mu)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_light_finger_keeps_its_limit_beside_many_contacts(seed):
    x, metric, rows = trunk_and_fingers(np.random.default_rng(seed))
    lower = np.zeros(len(rows.constraint))
    solver = projector(np.ones(len(x), bool))
    # contacts that are partly new, as of bodies that tumble: Newton's method was not tried on these
    solver.frictional(0.9 * x, metric, some_of(rows, 45), lower[:45])
    found = solver.frictional(x, metric, rows, lower)
    closing = lower - rows.jacobian @ found.velocity
    assert (rows.jacobian @ x)[40:].min() < -1.0
    assert H * closing.max() <= DEPTH
    assert found.residual <= 1e-6
    # percussions lead to that velocity, and those of limits act only where they hold
    wide = np.concatenate([rows.jacobian[:, None], rows.tangents.jacobian.reshape(len(lower), 2, -1)], axis=1)
    change = np.einsum("akj,ak->j", wide, found.percussion.reshape(-1, 3))
    assert np.allclose(metric.matrix.diagonal() * (found.velocity - x), change, atol=1e-9 * np.abs(change).max())
    assert (np.abs(closing[40:]) * found.percussion.reshape(-1, 3)[40:, 0] <= 1e-9).all()


def natural(rows, w, percussion, mass):
    """Return the natural map of each contact and its largest scaled speed, in rows of unit normal entries."""
    J, T = rows.jacobian.toarray(), rows.tangents.jacobian.toarray().reshape(len(rows.constraint), 2, -1)
    scale = 1.0 / np.sqrt((J * J / mass).sum(axis=1))
    u = np.concatenate([(J @ w)[:, None], T @ w], axis=1) * scale[:, None]
    p = percussion.reshape(-1, 3) / scale[:, None]
    return np.array([coulomb_defect(a, b, mu[None]) for a, b, mu in zip(u, p, rows.tangents.friction, strict=True)])


def robot_among_grains(rng, grains=60, joints=8):
    """A mechanism whose links touch grains, which touch each other; its limits are rows without friction."""
    n, m, limits = joints + 3 * grains, 3 * grains, 4
    mass = np.concatenate([rng.uniform(0.5, 20.0, size=joints), np.repeat(rng.uniform(0.1, 0.3, size=grains), 3)])
    normals, tangents = np.zeros((m + limits, n)), np.zeros((m + limits, 2, n))
    for a in range(m):
        axes, first = np.linalg.qr(rng.normal(size=(3, 3)))[0], int(rng.integers(grains))
        second = (first + 1 + int(rng.integers(3))) % grains
        place = joints + 3 * first
        normals[a, place : place + 3], tangents[a, :, place : place + 3] = axes[0], axes[1:]
        if a % 10 == 0:
            normals[a, :joints], tangents[a, :, :joints] = rng.normal(size=joints), rng.normal(size=(2, joints))
        elif a % 3:
            place = joints + 3 * second
            normals[a, place : place + 3], tangents[a, :, place : place + 3] = -axes[0], -axes[1:]
    normals[m:, :limits] = np.eye(limits)
    mu = np.concatenate([np.full(m, 0.3), np.zeros(limits)])
    return rng.normal(size=n), mass, rows_of(normals, tangents, mu, sparse=True), np.arange(n) < joints


@pytest.mark.parametrize("seed", SEEDS)
def test_a_robot_among_grains_has_its_own_residual(seed):
    x, mass, rows, jointed = robot_among_grains(np.random.default_rng(seed))
    lower = np.zeros(len(rows.constraint))
    own = rows.jacobian.toarray()[:, jointed].any(axis=1)
    assert own.any() and not own.all()
    # the stated depth of grains is not what is tested
    found = projector(jointed)
    found.acceptance.stated = found.acceptance.stated._replace(depth=1.0)
    found = found.frictional(x, DiagonalMetric(mass), rows, lower)
    off = natural(rows, found.velocity, found.percussion, mass)
    J, T = rows.jacobian.toarray(), rows.tangents.jacobian.toarray().reshape(len(lower), 2, -1)
    scale = 1.0 / np.sqrt((J * J / mass).sum(axis=1))
    speed = np.maximum(np.abs(J @ x), np.abs(T @ x).max(axis=1)) * scale
    assert off[own].max() <= 1e-6 * speed[own].max()
    assert off.max() <= 1e-3 * speed.max()


@pytest.mark.parametrize("seed", SEEDS)
def test_a_robot_among_grains_has_its_own_residual_without_friction(seed):
    x, mass, rows, jointed = robot_among_grains(np.random.default_rng(seed))
    J, count = rows.jacobian, len(rows.constraint)
    dense = J.toarray()
    own = dense[:, jointed].any(axis=1)
    solver = projector(jointed)
    solver.acceptance.stated = solver.acceptance.stated._replace(depth=1.0)
    solver.accepted = AcceptedDepth(1e-2, 1.0, lambda numbers: 1.0)
    w, p, residual = solver.project(x, DiagonalMetric(mass), J, np.zeros(count), rows.constraint, H)
    lengths = np.sqrt((dense * dense / mass).sum(axis=1))
    off, speed = np.abs(np.minimum(p * lengths, dense @ w / lengths)), np.abs(dense @ x) / lengths
    assert off[own].max() <= 1e-6 * speed[own].max()
    assert residual <= 1e-2 and off.max() <= 1e-2 * speed.max()
    # the others keep their looser residual
    assert off[~own].max() > 1e-6 * speed.max()
    assert np.allclose(mass * (w - x), dense.T @ p, atol=1e-9 * np.abs(mass * x).max())


def test_an_answer_that_sinks_deeper_than_stated_is_refused():
    acceptance = projector(np.ones(2, bool)).acceptance
    numbers, levers = np.array([3, 7]), np.array([1.0, 0.1])
    acceptance.stated = acceptance.stated._replace(levers=lambda n: levers[: len(n)])
    acceptance.check(1e-9, 1e-6, numbers, np.array([0.9 * DEPTH / H, 9.0 * DEPTH / H]), dict)
    with pytest.raises(ProjectionError, match=r"let a row sink by 1\.1e") as raised:
        acceptance.check(1e-9, 1e-6, numbers, np.array([0.0, 11.0 * DEPTH / H]), dict)
    assert raised.value.constraint == 7
    with pytest.raises(ProjectionError):
        acceptance.check(1e-9, 1e-6, numbers, np.array([np.nan, 0.0]), dict)


@pytest.mark.parametrize(("residual", "second"), [(1e-6, 1e-3), (1e-3, 1e-2), (1e-9, 1e-6), (0.05, 0.05)])
def test_the_second_bound_holds_within_its_block(residual, second):
    acceptance = Acceptance()
    with acceptance.second_bound():
        assert acceptance.bound(residual) == pytest.approx(second, rel=1e-12)
    assert acceptance.bound(residual) == residual
