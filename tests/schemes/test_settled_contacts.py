"""The position projection on cases worked out by hand, a unit mass with gaps along its axes, and on a robot."""

from typing import NamedTuple

import numpy as np
import pytest

import mbvi
from mbvi.projection import DenseMetric, FreeMotion, Projector
from mbvi.schemes import Step
from mbvi.schemes.positions import position_projection
from mbvi.schemes.positions.closed_contacts import Applied
from mbvi.schemes.positions.nearby_rows import NearbyRows
from mbvi.schemes.positions.position_projection import project_positions
from support.robot_problems import problem_of

STEP, DRIFT, TOLERANCE = 1.0, 0.5, 1e-8


class Found(NamedTuple):
    """How far the mass moved, its velocity after, the constraints of the law, their gaps and percussions."""

    moved: np.ndarray
    v: np.ndarray
    law: list
    gap: np.ndarray
    percussion: np.ndarray


def settle(end, law, *, x, w, v=(0.0, 0.0, 0.0), e=0.0):
    """Settle a step whose law took x to w; `end` are the gaps along the first axes at its end, at the origin."""
    w, v, x, J, law = (np.array(a, dtype=float) for a in (w, v, x, np.eye(3)[: len(end)], law))
    planes = [
        mbvi.GapFunction(lambda q, k=k, gap=gap: q[k] + gap, lambda q, k=k: np.eye(3)[k]) for k, gap in enumerate(end)
    ]
    system = mbvi.LagrangianSystem(mass=lambda q: np.eye(3), force=lambda t, q, v: np.zeros(3), dim=3)
    problem = mbvi.Problem(system, planes, np.ones(3), np.zeros(3), restitution=e)
    where = -DRIFT * w
    rows = problem.constraints.active(0.0, where, 1.0)
    of_law = np.isin(rows.constraint, np.flatnonzero(law))
    rows = mbvi.constraints.rows.take(rows, of_law)
    J = rows.jacobian
    step = Step(STEP, np.zeros(3), w, rows, np.array([J @ (w - x), J @ x, J @ w, J @ v]), 0.0)
    applied = Applied(STEP - DRIFT, where, v, STEP, FreeMotion(x, DenseMetric(np.eye(3))))
    new = project_positions(problem, applied, step, Projector(), NearbyRows(problem, STEP, linear=False))
    return Found(new.q, new.v, new.active.constraint.tolist(), new.active.gap, new.percussion)


def test_without_restitution_all_contacts_in_penetration_are_raised():
    """One that opens too; its velocity stays."""
    found = settle([-1e-3, -1e-3], [True, True], x=(-1, 0.5, 0), w=(0, 0.5, 0))
    np.testing.assert_allclose(found.moved, [1e-3, 1e-3, 0], atol=1e-15)
    np.testing.assert_allclose(found.gap, [0.0, 0.0], atol=1e-15)
    np.testing.assert_allclose(found.v, [0, 0.5, 0], atol=1e-15)
    np.testing.assert_allclose(found.percussion, [1.0, 0.0], atol=1e-15)


def test_what_is_no_deeper_than_the_tolerance_stays():
    found = settle([-0.9 * TOLERANCE], [True], x=(-1, 0, 0), w=(0, 0, 0))
    np.testing.assert_array_equal(found.moved, 0.0)
    np.testing.assert_array_equal(found.v, 0.0)


@pytest.mark.parametrize(("rate", "raised"), [(0.5 * TOLERANCE, True), (4e-4, True), (6e-4, False)])
def test_with_restitution_a_contact_is_raised_that_does_not_leave_within_two_steps(rate, raised):
    found = settle([-1e-3], [True], x=(rate, 0, 0), w=(rate, 0, 0), e=0.5)
    assert found.moved.any() == raised


@pytest.mark.parametrize("e", [0.0, 0.5])
def test_a_contact_that_bounces_keeps_its_penetration(e):
    found = settle([-1e-3, -1e-3], [True, True], x=(-1, 0.5, 0), w=(0, 0.5, 0), v=(0, 0.5, 0), e=e)
    np.testing.assert_allclose(found.moved, [1e-3, 0.0 if e else 1e-3, 0], atol=1e-15)


def test_a_row_that_joins_bears_no_load_while_it_is_open():
    """It is active at the end of the step, and open where the law acts."""
    found = settle([-1e-3, 0.5 * TOLERANCE], [True, False], x=(-1, -1, 0), w=(0, -1, 0), v=(0, -1, 0))
    assert found.law == [0, 1]
    # with a load the mass would have stayed where the law acts, at y = 0.5
    np.testing.assert_allclose(found.moved, [1e-3, 0, 0], atol=TOLERANCE)
    np.testing.assert_allclose(found.v, 0.0, atol=1e-12)


def test_a_row_that_joins_is_kept_from_sinking():
    """It would have sunk by 0.1; the law with it ends where it touches."""
    found = settle([-1e-3, -0.1], [True, False], x=(-1, -1, 0), w=(0, -1, 0), v=(0, -1, 0))
    np.testing.assert_allclose(found.moved, [1e-3, 0.1, 0], atol=1e-12)
    np.testing.assert_allclose(found.gap, [0, 0], atol=1e-12)
    np.testing.assert_allclose(found.v, [0, 0, 0], atol=1e-12)


def test_each_penetration_is_removed_and_no_gap_made_smaller(monkeypatch, rng):
    """From states near those of a run, in which contacts are open or penetrate."""
    problem, h, scheme = problem_of("solo12", "fall", 0.0), 1e-3, mbvi.Centered(project_positions=True)
    run = mbvi.simulate(problem, scheme, step=h, duration=0.4, progress=False)
    made, raised, project = [], 0, position_projection._with_tangent_velocity
    monkeypatch.setattr(
        position_projection, "_with_tangent_velocity", lambda *found: made.append(project(*found)) or made[-1]
    )
    for t, q, v in list(zip(run.t[:-1], run.q[:-1], run.v[:-1], strict=True))[::2]:
        sunk = problem.system.integrate(q, 1e-6 * rng.normal(size=problem.system.nv))
        before = problem.constraints.active(t, sunk, problem.tolerance)
        made.clear()
        step = scheme.step(problem, t, sunk, v, h, Projector())
        if not made:
            continue
        raised += 1
        closed = (step.percussion > 0.0) & (np.abs(h * step.after) <= problem.tolerance)
        # what strikes at the end of the step is raised in the next
        closed &= np.isin(step.active.constraint, before.constraint)
        assert (step.active.gap[closed] >= -problem.tolerance).all()
        # the velocity takes nothing below zero
        assert (step.after >= -np.maximum(step.active.gap, 0.0) / (0.5 * h) - 1e-9).all()
        assert step.residual <= 1e-9
    assert raised >= 50
