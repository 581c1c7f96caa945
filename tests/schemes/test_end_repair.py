"""Position repair at the end of a step: what is deep is pushed out, and nothing else moves."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import mbvi
from mbvi.projection import Projector
from mbvi.projection.acceptance import Acceptance, StatedDepth
from mbvi.projection.coulomb.frictional_laws import FrictionalLaws
from mbvi.schemes.positions.end_repair import near_rows, repair

EDGE = 0.04


def poured(count, e=0.0, seed=0, friction=0.0):
    """Boxes of a lattice with random turns over an open box."""
    scene = mbvi.Scene(restitution=e, friction=friction)
    scene.add_container((-0.2, -0.2, 0.0), (0.2, 0.2))
    layer, row, column = np.unravel_index(np.arange(count), (-(-count // 25), 5, 5))
    places = 0.075 * np.stack([row - 2, column - 2, layer], axis=1) + [0.0, 0.0, 0.05]
    turns = Rotation.random(count, random_state=seed).as_matrix()
    scene.add_boxes(places, (EDGE, EDGE, EDGE), 1.0, rotations=turns)
    return scene.build()


def standing(rng, count=9):
    """Boxes on a floor, far from each other."""
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1))
    scene.add_boxes([(0.2 * k, 0, EDGE / 2) for k in range(count)], (EDGE, EDGE, EDGE), rng.uniform(0.1, 10.0))
    return scene.build()


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=10)
def test_deep_boxes_are_pushed_out_and_the_others_stay(seed):
    rng = np.random.default_rng(seed)
    problem, allowed = standing(rng), 1e-3 * EDGE
    q = problem.q0.reshape(-1, 7).copy()
    deep = rng.random(len(q)) < 0.5
    q[deep, 2] -= rng.uniform(2.0, 50.0, deep.sum()) * allowed
    rows = near_rows(problem, 0.0, q.ravel(), allowed)
    metric = problem.system.metric(q.ravel())
    place, moved, at_end = repair(problem, 0.0, q.ravel(), rows, metric, Projector(1e-6), allowed)
    assert at_end.gap.min(initial=0.0) >= -allowed
    np.testing.assert_array_equal(place.reshape(-1, 7)[~deep], q[~deep])
    # the nearest configuration: straight up
    np.testing.assert_allclose(moved.reshape(-1, 6)[:, [0, 1, 3, 4, 5]], 0.0, atol=1e-12)
    assert (np.abs(place.reshape(-1, 7)[deep, 2] - EDGE / 2) <= allowed).all()


def test_without_deep_contacts_nothing_moves():
    problem = standing(np.random.default_rng(0))
    q, allowed = problem.q0.copy(), 1e-3 * EDGE
    q[2] -= 0.9 * allowed
    rows = near_rows(problem, 0.0, q, allowed)
    place, moved, at_end = repair(problem, 0.0, q, rows, problem.system.metric(q), Projector(1e-6), allowed)
    assert place is q and at_end is rows and not moved.any()


def test_what_is_jammed_stays_as_deep_as_it_is():
    """Between two walls that are nearer to each other than the box is wide."""
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1))
    scene.add_halfspace((0, 0, -1), -EDGE)
    scene.add_box((EDGE, EDGE, EDGE), position=(0, 0, EDGE / 2))
    problem = scene.build()
    q = problem.q0.copy()
    # turned about a horizontal axis its corners stand out on both sides
    q[3:] = Rotation.from_euler("x", 0.2).as_quat()
    rows = near_rows(problem, 0.0, q, 1e-5)
    place, _, at_end = repair(problem, 0.0, q, rows, problem.system.metric(q), Projector(1e-6), 1e-5)
    assert np.isfinite(place).all() and at_end.gap.min() >= rows.gap.min() - 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("e", [0.0, 0.5])
def test_two_hundred_boxes_poured_need_few_projections(e, monkeypatch):
    """The second of a step is the one that pushes out what is deep."""
    problem, count = poured(200, e), 0
    original = Projector.project

    def counted(self, *arguments):
        nonlocal count
        count += 1
        return original(self, *arguments)

    monkeypatch.setattr(Projector, "project", counted)
    deepest = 0.0
    steps = 0
    for step in mbvi.steps(problem, mbvi.StewartTrinkle(), step=2e-3, residual=1e-3):
        steps += 1
        found = problem.constraints.active(step.t, step.q, 0.0).gap.min(initial=0.0)
        assert step.active.gap.min(initial=0.0) == pytest.approx(found, abs=1e-6 * EDGE)
        deepest = max(deepest, -found)
        if step.t > 0.6:
            break
    assert deepest < 1.5e-3 * EDGE
    assert count <= (2.1 if e == 0.0 else 3.1) * steps


@pytest.mark.slow
@pytest.mark.parametrize("depth", [1e-2, 1e-4])
def test_long_steps_do_not_sink_boxes_deeper_than_accepted(depth):
    """At 4 ms some repairs do not reach the depth; such a step is retried."""
    scene = mbvi.Scene()
    side, pitch = 6, 1.8 * EDGE
    cells = np.stack(np.meshgrid(*[np.arange(side)] * 3, indexing="ij"), -1).reshape(-1, 3)
    cells = cells[np.argsort(cells[:, 2], kind="stable")][:200]
    scene.add_container((0.0, 0.0, 0.0), (side * pitch, side * pitch))
    turns = Rotation.random(200, random_state=1).as_matrix()
    scene.add_boxes(pitch * (cells + 0.5) + [0.0, 0.0, 0.05], (EDGE, EDGE, EDGE), 1.0, rotations=turns)
    run = mbvi.simulate(scene.build(), mbvi.StewartTrinkle(), step=4e-3, duration=0.6, depth=depth, progress=False)
    assert run.penetration().max() <= depth * 0.5 * EDGE


@pytest.mark.slow
@pytest.mark.parametrize("shift", [1e-9, 5e-9, 6e-9])
def test_rows_that_would_sink_too_deep_are_solved_to_a_smaller_residual(shift):
    """These pours ended in an error: an answer of the residual that was asked let a row sink by 1.0 to 1.4 depths."""
    problem = poured(200)
    q = problem.q0.copy()
    q[0] += shift
    for step in mbvi.steps(problem.at(q, problem.v0), mbvi.StewartTrinkle(), step=2e-3, residual=1e-3):
        if step.t > 0.3:
            break
    assert step.t > 0.3


def test_friction_of_rows_that_would_sink_too_deep_is_solved_to_a_smaller_residual():
    """A third of the depth that an answer of the residual leaves is stated: the law is solved until it holds."""
    problem, h = poured(150, friction=0.5), 2e-3
    step = next(step for step in mbvi.steps(problem, step=h) if step.t > 0.2)
    rows, metric = problem.constraints.active(step.t, step.q, 2e-3), problem.system.metric(step.q)
    x, lower = step.v + [0.0, 0.0, -9.81 * h, 0.0, 0.0, 0.0] * 150, -np.maximum(rows.gap, 0.0) / h
    levers, jointed = problem.constraints.levers, np.zeros(len(x), bool)

    def depth(found):
        return h * float((lower - rows.jacobian @ found.velocity).max())

    given = x, metric, rows, lower, 3e-2, np.inf
    rough = FrictionalLaws(1e-6, False, Acceptance()).project(*given)
    assert len(lower) > 64 and depth(rough) > 0.0
    stated = StatedDepth(depth(rough) / 3.0, 1e-9, h, levers, jointed)
    fine = FrictionalLaws(1e-6, False, Acceptance(stated)).project(*given)
    assert depth(fine) <= stated.depth
    assert fine.residual < rough.residual
