"""The scheme for piles where contacts bounce: no energy is gained, impacts follow the law (8), heaps come to rest."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mbvi
from mbvi import packing
from mbvi.projection import Projector
from mbvi.schemes.gap_bounds.newton_bounds import newton_bounds
from mbvi.schemes.gap_bounds.reach import groups
from mbvi_studies.chart.errors import fitted_order, path_errors, worst_errors
from support.orders import STEPS

H = 1e-3


def linear_walls(rng, n, m, e, gaps, force=0.0):
    """A point of n coordinates between m planes, of a random mass matrix; gaps [m] at the start."""
    A = rng.normal(size=(n, n))
    M = A @ A.T + 0.1 * np.eye(n)
    J, pull = rng.normal(size=(m, n)), force * rng.normal(size=n)
    system = mbvi.LagrangianSystem(mass=lambda q: M, force=lambda t, q, v: pull, dim=n)
    walls = [mbvi.GapFunction(lambda q, k=k: float(J[k] @ q + gaps[k]), lambda q, k=k: J[k]) for k in range(m)]
    return mbvi.Problem(system, walls, np.zeros(n), rng.normal(size=n), restitution=e, length=1.0), M, J


@given(seed=st.integers(0, 2**32 - 1), one=st.booleans(), touching=st.floats(0, 1))
@settings(max_examples=60)
def test_the_kinetic_energy_never_rises(seed, one, touching):
    """Without forces, whatever the gaps, and also where each contact has an e of its own."""
    rng = np.random.default_rng(seed)
    n, m = rng.integers(1, 6), rng.integers(1, 9)
    gaps = np.where(rng.random(m) < touching, 0.0, 5.0 * H * rng.random(m))
    problem, M, J = linear_walls(rng, n, m, np.full(m, rng.random()) if one else rng.random(m), gaps)
    v, scheme, projector = problem.v0.copy(), mbvi.StewartTrinkle(), Projector(1e-9)
    q = problem.q0.copy()
    for k in range(6):
        step = scheme.step(problem, k * H, q, v, H, projector)
        assert step.v @ M @ step.v <= v @ M @ v * (1.0 + 1e-12)
        assert (J @ step.q + gaps).min() >= -1e-8
        assert (step.percussion >= 0.0).all()
        np.testing.assert_allclose(M @ (step.v - v), step.active.jacobian.T @ step.percussion, atol=1e-8)
        q, v = step.q, step.v


@given(seed=st.integers(0, 2**32 - 1), e=st.sampled_from([0.0, 0.3, 1.0]) | st.floats(0, 1))
@settings(max_examples=60)
def test_several_impacts_at_once_follow_the_law_8(seed, e):
    """Where all walls touch, a step gives the velocity that `Paoli` gives at the same state."""
    rng = np.random.default_rng(seed)
    n, m = rng.integers(1, 6), rng.integers(1, 9)
    problem, M, J = linear_walls(rng, n, m, e, np.zeros(m))
    step = mbvi.StewartTrinkle().step(problem, 0.0, problem.q0.copy(), problem.v0.copy(), H, Projector(1e-9))
    if e > 0.0 or (J @ problem.v0 <= 0.0).all():
        np.testing.assert_allclose(step.v, mbvi.impact(problem.v0, M, J, e), atol=1e-8)
    # without an impact the velocity stays
    if (J @ problem.v0 >= 0.0).all():
        np.testing.assert_allclose(step.v, problem.v0, atol=1e-12)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=40)
def test_bounds_are_met_by_the_reversed_velocity(seed):
    """Which is why no energy is gained: -s v with the largest e of the impacts, or 0 where there is none."""
    rng = np.random.default_rng(seed)
    m = 8
    gaps = np.where(rng.random(m) < 0.5, 0.0, 2.0 * H * rng.random(m))
    problem, _, _ = linear_walls(rng, 4, m, rng.random(m), gaps, force=100.0)
    rows = problem.constraints.active(0.0, problem.q0, 1.0)
    motion, e = problem.system.free_motion(0.0, problem.q0, problem.v0, H), rows.restitution
    bounds = newton_bounds(problem, rows, problem.v0, H, motion, groups(problem, rows))
    s = e[bounds.impact].max(initial=0.0)
    assert (-s * rows.speeds(problem.v0) >= bounds.lower - 1e-14)[~bounds.open].all()
    assert not (bounds.impact & bounds.open).any()


def balls(positions, speeds, e, masses=None):
    """Spheres of radius 0.1 on a line, without gravity."""
    scene = mbvi.Scene(gravity=(0, 0, 0), restitution=e)
    for k, (x, u) in enumerate(zip(positions, speeds, strict=True)):
        mass = 1.0 if masses is None else masses[k]
        scene.add_sphere(0.1, mass, position=(x, 0, 0), velocity=(u, 0, 0), name=f"ball {k}")
    return scene.build()


@pytest.mark.parametrize("e", [0.3, 0.8, 1.0])
@pytest.mark.parametrize("masses", [None, [3.0, 1.0, 0.2, 5.0]])
def test_a_cradle_whose_balls_touch_does_as_paolis(e, masses):
    problem = balls([-0.001, 0.2, 0.4, 0.6], [1.0, 0.0, 0.0, 0.0], e, masses)
    ends = [
        mbvi.simulate(problem, scheme, step=0.63e-3, duration=0.01, residual=1e-12).v[-1]
        for scheme in (mbvi.StewartTrinkle(), mbvi.Paoli())
    ]
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-11)
    assert ends[0][9] > 0.1


def test_a_cradle_whose_balls_do_not_touch_passes_the_blow_on():
    problem = balls(0.205 * np.arange(4), [1.0, 0.0, 0.0, 0.0], 1.0)
    run = mbvi.simulate(problem, mbvi.StewartTrinkle(), step=H, duration=0.05)
    np.testing.assert_allclose(run.v[-1, ::3], [0.0, 0.0, 0.0, 1.0], atol=1e-12)


@pytest.mark.parametrize("gap", [1e-5, 2e-4])
def test_gaps_that_a_blow_closes_within_a_step_count_as_closed_in_the_next(gap):
    """The second ball strikes the two others at once: the law (8), then it strikes the first."""
    problem = balls((0.2 + gap) * np.arange(4), [1.0, 0.0, 0.0, 0.0], 1.0)
    run = mbvi.simulate(problem, mbvi.StewartTrinkle(), step=H, duration=0.05)
    np.testing.assert_allclose(run.v[-1, ::3], [-1 / 3, 0.0, 2 / 3, 2 / 3], atol=1e-12)
    assert run.penetration().max() < 1e-12


@pytest.mark.parametrize(("gravity", "allowed"), [(0.0, 1e-12), (9.81, 2e-5)])
def test_an_elastic_gas_keeps_its_energy(gravity, allowed):
    """To rounding; with a weight up to steps in which a ball meets two others, whose place then is not that of w."""
    scene = mbvi.Scene(gravity=(0, 0, -gravity), restitution=1.0)
    scene.add_container((-0.5, -0.5, 0), (0.5, 0.5))
    scene.add_halfspace((0, 0, -1), -1.0)
    centres, radii = packing.lattice((3, 3, 3), 0.1, 0.25, (-0.35, -0.35, 0.15), jitter=1e-2, seed=1)
    speeds = np.random.default_rng(0).normal(size=(27, 3))
    scene.add_spheres(centres, radii, 1.0, velocities=speeds)
    problem = scene.build()
    run = mbvi.simulate(problem, mbvi.StewartTrinkle(), step=H, duration=0.3, residual=1e-12)
    assert len(run.impacts) > 20
    # in a constant field from the first step on: the start is at another time of its step
    energy = run.energy()[1:]
    np.testing.assert_allclose(energy, energy[0], rtol=allowed)


@pytest.mark.parametrize("e", [0.2, 0.7, 1.0])
def test_a_ball_leaves_the_floor_with_its_share_of_the_speed(e):
    scene = mbvi.Scene(restitution=e)
    scene.add_halfspace((0, 0, 1))
    scene.add_sphere(0.1, position=(0, 0, 0.537))
    run = mbvi.simulate(scene.build(), mbvi.StewartTrinkle(), step=H, duration=0.5)
    rises = np.flatnonzero((run.v[1:, 2] > 0.0) & (run.v[:-1, 2] < 0.0))
    assert len(run.impacts) == len(rises) > 0
    assert run.v[rises + 1, 2] == pytest.approx(-e * run.v[rises, 2], rel=1e-14)
    assert run.impacts[0].after == pytest.approx(-e * run.impacts[0].before, rel=1e-14)
    assert run.penetration().max() == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("e", [0.5, 1.0])
def test_a_ball_on_a_floor_is_of_order_one(e):
    case = next(case for case in mbvi.reference.references(e) if case.name == "bouncing ball")
    found = np.array([worst_errors(case, mbvi.StewartTrinkle(), h, path_errors) for h in STEPS])
    assert fitted_order(STEPS, found[:, 0]) >= 0.9


def test_a_ball_comes_to_rest_and_stays():
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0, 0, 1))
    scene.add_sphere(0.1, position=(0, 0, 0.2))
    run = mbvi.simulate(scene.build(), mbvi.StewartTrinkle(), step=H, duration=1.0)
    late = run.t > 0.6
    np.testing.assert_allclose(run.q[late, 2], 0.1, atol=1e-15)
    np.testing.assert_allclose(run.v[late], 0.0, atol=1e-15)


def grains(count, e, radius=0.02, robot=False):
    """Spheres of a lattice over an open box, and a quadruped above them."""
    n = int(np.ceil(count ** (1 / 3) - 1e-9))
    width = 2.2 * radius * n
    scene = mbvi.Scene(restitution=e)
    scene.add_container((0.0, 0.0, 0.0), (width, width))
    spheres = packing.lattice((n, n, -(-count // n**2)), radius, 2.2 * radius, jitter=0.05 * radius, seed=0)
    centres = spheres.positions[:count]
    # above the middle of the box
    centres = centres - (centres.min(axis=0) + centres.max(axis=0)) / 2.0 + width * np.array([0.5, 0.5, 0.6])
    scene.add_spheres(centres, radius, 1.0)
    if robot:
        scene.add_urdf(mbvi.robot("quadruped"), position=(width / 2, width / 2, width + 0.7))
    return scene.build()


@pytest.mark.parametrize("e", [0.4, 0.8])
def test_a_pile_comes_to_rest_where_its_grains_bounce(e):
    problem = grains(8, e)
    run = mbvi.simulate(problem, mbvi.StewartTrinkle(), step=2e-3, duration=1.0, every=10)
    assert run.penetration().max() < 1e-6 * 0.02
    speed = np.sqrt((run.v**2).mean(axis=1))
    assert speed.max() > 0.2 and speed[-1] < 0.05
    assert run.energy()[-1] < run.energy()[0]


@pytest.mark.slow
@pytest.mark.parametrize("robot", [False, True])
def test_a_thousand_grains_stay_out_of_each_other(robot):
    """At e = 0.5, and with a quadruped on them at e = 0, by the default scheme."""
    radius = 0.05 if robot else 0.02
    problem = grains(1000, 0.0 if robot else 0.5, radius, robot)
    run = mbvi.simulate(problem, step=H, duration=0.6, residual=1e-3, every=20)
    assert run.scheme == "StewartTrinkle"
    assert run.penetration().max() < 1e-2 * radius
    assert run.residual.max() <= 1e-3
