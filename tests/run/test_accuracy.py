"""The accuracy of runs: piles stay within the depth they were given, and notes say what followed from it."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.sparse import csr_array
from scipy.spatial.transform import Rotation

import mbvi
from mbvi.projection import AcceptedDepth, DiagonalMetric, Projector
from mbvi.projection.dense.scaled_qp import ScaledQP
from mbvi.run.accuracy import smallest_size
from mbvi_studies.chart import piles
from support.paths import ROBOTS

H = 2e-3


def spheres(seed, count=40, ratio=1.0):
    """Spheres of one density and radii within 1 : `ratio`, close above the floor of a box."""
    rng = np.random.default_rng(seed)
    radii = 0.02 * ratio ** -rng.random(count)
    places = np.stack(np.unravel_index(rng.permutation(count), (4, 4, -(-count // 16))), axis=1)
    centres = 0.044 * (places + 0.5) + 0.001 * rng.uniform(-1, 1, (count, 3))
    scene = mbvi.Scene()
    scene.add_container((0, 0, 0), (0.176, 0.176))
    velocity = rng.uniform(-1, 1, (count, 3))
    scene.add_spheres(centres, radii, density=2500.0, name="grain")
    problem = scene.build()
    return problem.at(problem.q0, velocity.ravel())


def boxes(seed, count=20):
    rng = np.random.default_rng(seed)
    places = np.stack(np.unravel_index(rng.permutation(count), (3, 3, -(-count // 9))), axis=1)
    turns = Rotation.random(count, random_state=seed).as_matrix()
    scene = mbvi.Scene()
    scene.add_container((0, 0, 0), (0.22, 0.22))
    scene.add_boxes(0.072 * places + [0.038, 0.038, 0.038], (0.04, 0.04, 0.04), 1.0, rotations=turns)
    return scene.build()


def worst(problem, run, size):
    """Return the deepest penetration of the recorded configurations, in sizes."""
    gaps = (problem.constraints.active(0.0, q, problem.tolerance).gap for q in run.q)
    return -min(gap.min(initial=0.0) for gap in gaps) / size


@settings(max_examples=8)
@example(seed=0, exponent=-2.0, ratio=1.0, h=H)
@given(
    seed=st.integers(0, 1000), exponent=st.floats(-6.0, -1.0), ratio=st.floats(1.0, 4.0), h=st.sampled_from([5e-4, H])
)
def test_spheres_stay_within_the_accepted_depth(seed, exponent, ratio, h):
    problem, depth = spheres(seed, ratio=ratio), 10.0**exponent
    run = mbvi.simulate(problem, mbvi.StewartTrinkle(), step=h, duration=60 * h, depth=depth, progress=False)
    size = smallest_size(problem)
    assert worst(problem, run, size) <= depth
    assert run.penetration().max() <= depth * size


@pytest.mark.slow
@settings(max_examples=6)
@given(seed=st.integers(0, 1000), exponent=st.floats(-4.0, -1.0))
def test_boxes_stay_within_the_accepted_depth(seed, exponent):
    problem, depth = boxes(seed), 10.0**exponent
    run = mbvi.simulate(problem, mbvi.StewartTrinkle(), step=H, duration=0.25, depth=depth, progress=False)
    assert worst(problem, run, 0.02) <= depth


@pytest.mark.slow
@pytest.mark.parametrize("depth", [1e-2, 1e-3, 1e-4])
def test_a_mixed_pile_stays_within_the_accepted_depth(depth):
    problem = piles.mixed(60).problem()
    run = mbvi.simulate(problem, mbvi.StewartTrinkle(), step=H, duration=0.4, depth=depth, progress=False)
    assert worst(problem, run, 0.02) <= depth


@given(
    seed=st.integers(0, 1000),
    spread=st.floats(0.0, 6.0),
    speed=st.floats(1e-1, 1e3),
    depth=st.floats(1e-9, 1e-7),
    unit=st.sampled_from([1e-3, 1.0, 1e3]),
)
def test_no_rate_is_off_by_more_than_a_quarter_of_the_depth_per_step(seed, spread, speed, depth, unit):
    """Whatever the masses: a residual bounds the scaled rows, of which the lightest body's is the longest."""
    n, rng = 40, np.random.default_rng(seed)
    masses = 10.0 ** rng.uniform(-0.5 * spread, 0.5 * spread, n)
    x = -speed * rng.uniform(0.5, 1.0, n)

    def residual(unit, lever):
        """Return the residual of the QP in another unit of length, with the rows that it is for."""
        qp = ScaledQP(unit * x, DiagonalMetric(masses), csr_array(np.eye(n)), np.zeros(n), 1.0)
        return AcceptedDepth(np.inf, unit * depth, lambda numbers: lever).residual(qp, np.arange(n), H), qp

    found, qp = residual(1.0, 1.0)
    # the rate error of a row whose scaled slack is at the tolerance
    off = found * qp.largest * qp.scale * qp.lengths
    assert off.max() == pytest.approx(depth / (4.0 * H), rel=1e-12)
    # a gap that is an angle counts with its lever
    assert residual(unit, 2.0)[0] == pytest.approx(0.5 * found, rel=1e-9)


def test_the_residual_follows_from_speed_and_step():
    """One body of 1 kg that falls at 2 m/s: a quarter of the depth, in a step, is what the residual leaves of it."""
    n = 120
    J, x = csr_array(np.eye(n)), np.full(n, -2.0)
    projector = Projector(1e-6, None, AcceptedDepth(1e-3, 1e-6, lambda numbers: 1.0))
    projector.project(x, DiagonalMetric(np.ones(n)), J, np.zeros(n), np.arange(n), 1e-3)
    assert projector.strictest == projector.loosest == pytest.approx(1e-6 / (4 * 1e-3 * 2.0))
    # a projection that names no step keeps the residual
    before = projector.strictest
    projector.project(x, DiagonalMetric(np.ones(n)), J, np.zeros(n), np.arange(n))
    assert projector.strictest == projector.loosest == before
    # slower bodies are not solved worse than by the relative depth
    projector.project(1e-3 * x, DiagonalMetric(np.ones(n)), J, np.zeros(n), np.arange(n), 1e-3)
    assert (projector.strictest, projector.loosest) == (before, 1e-3)


def test_notes_state_the_depth_and_the_residuals_it_gave():
    run = mbvi.simulate(spheres(1), step=H, duration=0.1, progress=False)
    assert "depth = 0.001 was accepted: 2e-05 m, relative to the smallest body's 0.02 m" in run.notes
    (stated,) = [note for note in run.notes if note.startswith("the accepted depth gave residuals of ")]
    low, high = (float(word) for word in stated.split() if "e-" in word)
    assert 0.0 < low <= high <= 1e-3
    assert run.residual.max() <= 1.05 * high
    # the same as asking for it
    given_depth = mbvi.simulate(spheres(1), step=H, duration=0.1, depth=1e-3, progress=False)
    assert (given_depth.q == run.q).all() and given_depth.notes == run.notes


def test_a_residual_alone_is_used_as_it_is():
    run = mbvi.simulate(spheres(1), step=H, duration=0.1, residual=1e-9, progress=False)
    assert run.residual.max() <= 1e-9
    assert not any("depth" in note for note in run.notes)


def test_scenes_with_dense_rows_keep_their_residual():
    problem = spheres(1, count=8)
    plain, same = (
        mbvi.simulate(problem, mbvi.StewartTrinkle(), step=H, duration=0.1, progress=False, **accuracy)
        for accuracy in ({}, {"residual": 1e-6})
    )
    assert (plain.q == same.q).all() and plain.notes == same.notes
    assert not any("depth" in note for note in plain.notes)


def test_steps_by_hand_take_a_depth():
    problem = spheres(2)
    run = mbvi.simulate(problem, mbvi.StewartTrinkle(), step=H, duration=20 * H, depth=1e-4, progress=False)
    walk = mbvi.steps(problem, mbvi.StewartTrinkle(), step=H, depth=1e-4)
    for _ in range(20):
        step = next(walk)
    assert (step.q == run.q[-1]).all()


def test_the_size_of_the_smallest_body():
    scene = mbvi.Scene()
    scene.add_container((-1, -1, 0), (1, 1))
    scene.add_box((0.3, 0.2, 0.4), 1.0, position=(0, 0, 0.5))
    assert smallest_size(scene.build()) == pytest.approx(0.1)
    scene.add_capsule(0.05, 0.3, 1.0, position=(0.5, 0, 0.5))
    scene.add_spheres([[-0.5, 0, 0.5]], 0.07, 1.0)
    assert smallest_size(scene.build()) == pytest.approx(0.05)
    # the world does not move, and links of robots do not count beside free bodies
    scene.add_box((0.01, 0.01, 0.01), position=(0.5, 0.5, 0.005), fixed=True)
    scene.add_urdf(ROBOTS / "hopper/hopper.urdf", position=(-0.5, -0.5, 2.0))
    assert smallest_size(scene.build()) == pytest.approx(0.05)
    free = mbvi.Problem(mbvi.LagrangianSystem(lambda q: np.eye(2), lambda t, q, v: np.zeros(2), 2), [], [0, 0], [0, 0])
    assert smallest_size(free) == pytest.approx(0.1)


@pytest.mark.parametrize("value", [0.0, -1e-3, np.nan, np.inf, "deep"])
def test_a_depth_that_is_not_positive_is_refused(value):
    problem = spheres(1)
    with pytest.raises(mbvi.InputError, match="depth must be"):
        mbvi.simulate(problem, step=H, duration=0.1, depth=value)
    with pytest.raises(mbvi.InputError, match="depth must be"):
        mbvi.steps(problem, step=H, depth=value)


def test_depth_and_residual_exclude_each_other():
    problem = spheres(1)
    with pytest.raises(mbvi.InputError, match="depth or residual, not both"):
        mbvi.simulate(problem, step=H, duration=0.1, depth=1e-3, residual=1e-6)
    with pytest.raises(mbvi.InputError, match="depth or residual, not both"):
        mbvi.steps(problem, step=H, depth=1e-3, residual=1e-6)


@pytest.mark.parametrize("scheme", [mbvi.Paoli(), mbvi.Centered(project_positions=True), mbvi.EventDriven()])
def test_a_scheme_that_penetrates_on_its_own_takes_no_depth(scheme):
    step = {} if isinstance(scheme, mbvi.EventDriven) else {"step": H}
    with pytest.raises(mbvi.UnsuitableError, match="does not take a depth"):
        mbvi.simulate(spheres(1, count=3), scheme, duration=0.1, depth=1e-3, **step)
