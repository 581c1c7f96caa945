"""Coulomb friction in scenes: exact motions, sticking without creep, moving walls, energy, refusals."""

import pickle
from contextlib import nullcontext
from itertools import islice

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mbvi
from mbvi import motion, packing

G = 9.81
PROJECTED = [mbvi.Paoli(project_positions=True), mbvi.MoreauJean(project_positions=True)]
PROJECTED += [mbvi.Centered(project_positions=True)]
SCHEMES = [mbvi.Paoli(), mbvi.MoreauJean(), mbvi.Centered(), *PROJECTED, mbvi.StewartTrinkle()]
each_scheme = pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
QUADRUPED = "robots/quadruped/quadruped.urdf"


def on_floor(mu, slope=0.0, **options):
    """A scene with a floor, tilted about y by turning gravity."""
    scene = mbvi.Scene(gravity=(G * np.sin(slope), 0.0, -G * np.cos(slope)), friction=mu, **options)
    scene.add_halfspace((0, 0, 1), 0.0, name="floor")
    return scene


def block(mu, slope=0.0, speed=0.0, **options):
    scene = on_floor(mu, slope, **options)
    scene.add_box((0.2, 0.3, 0.1), 1.0, position=(0, 0, 0.05), velocity=(speed, 0, 0), name="block")
    return scene.build()


def ball(mu, speed, **options):
    scene = on_floor(mu, **options)
    scene.add_sphere(0.1, 1.0, (0, 0, 0.1), (speed, 0, 0), name="ball")
    return scene.build()


@each_scheme
def test_a_block_on_an_incline_sticks_without_creep(scheme):
    problem = block(0.5, np.arctan(0.9999 * 0.5))
    run = mbvi.simulate(problem, scheme, step=1e-3, duration=0.2)
    assert np.abs(run.q - problem.q0).max() <= 1e-12


@each_scheme
def test_a_block_slides_down_an_incline_with_its_exact_acceleration(scheme):
    slope, mu = 0.6, 0.3
    run = mbvi.simulate(block(mu, slope), scheme, step=1e-3, duration=0.2)
    acceleration = G * (np.sin(slope) - mu * np.cos(slope))
    np.testing.assert_allclose(run.v[-1, :3], [0.2 * acceleration, 0.0, 0.0], atol=1e-12)


@each_scheme
def test_a_sliding_ball_rolls_on_with_five_sevenths_of_its_speed(scheme):
    run = mbvi.simulate(ball(0.3, 1.0), scheme, step=1e-3, duration=0.2)
    np.testing.assert_allclose(run.v[-1], [5 / 7, 0.0, 0.0, 0.0, 5 / 0.7, 0.0], atol=1e-12)


@pytest.mark.parametrize("plane", ["xz", "yz"])
def test_a_ball_in_a_planar_scene_rolls_too(plane):
    speed = (1.0, 0, 0) if plane == "xz" else (0, 1.0, 0)
    scene = on_floor(0.3, plane=plane)
    scene.add_sphere(0.1, 1.0, (0, 0, 0.1), speed)
    problem = scene.build()
    assert problem.system.nv == 3
    run = mbvi.simulate(problem, mbvi.Paoli(), step=1e-3, duration=0.2)
    np.testing.assert_allclose(np.abs(run.v[-1]), [5 / 7, 0.0, 5 / 0.7], atol=1e-12)


@each_scheme
def test_a_belt_takes_a_block_along(scheme):
    """A belt moves along itself: no gap changes, and yet it drags."""
    scene = mbvi.Scene(friction=0.25)
    scene.add_halfspace((0, 0, 1), 0.0, motion=motion.Translation((0.5, 0, 0)))
    scene.add_box((0.2, 0.2, 0.1), 1.0, position=(0, 0, 0.05))
    run = mbvi.simulate(scene.build(), scheme, step=1e-3, duration=0.4)
    stop = 0.5 / (0.25 * G)
    np.testing.assert_allclose(run.v[-1], [0.5, 0, 0, 0, 0, 0], atol=1e-12)
    assert run.q[-1, 0] == pytest.approx(0.5 * (0.4 - 0.5 * stop), abs=0.5 * 1e-3)


@pytest.mark.parametrize("mu", [0.05, 0.5])
@pytest.mark.parametrize("scheme", [mbvi.Paoli(), mbvi.MoreauJean(), mbvi.Centered()], ids=repr)
def test_an_oblique_impact_is_exact(scheme, mu):
    """Slip takes mu (1 + e) v_n of the speed, stick two sevenths of it."""
    scene = mbvi.Scene(gravity=(0, 0, 0), friction=mu, restitution=0.5)
    scene.add_halfspace((0, 0, 1), 0.0)
    scene.add_sphere(0.1, 2.0, (0, 0, 0.1015), (1.0, 0, -1.0))
    run = mbvi.simulate(scene.build(), scheme, step=1e-3, duration=0.01)
    lost = min(mu * 1.5, 2 / 7)
    np.testing.assert_allclose(run.v[-1, [0, 2, 4]], [1.0 - lost, 0.5, 2.5 * lost / 0.1], rtol=1e-10)


def test_friction_of_a_pair_goes_before_that_of_the_scene():
    scene = on_floor(0.0)
    for k, name in enumerate("ab"):
        scene.add_box((0.1, 0.1, 0.1), 1.0, position=(k, 0, 0.05), velocity=(0, 1, 0), name=name)
    scene.set_friction("floor", "b", 0.4)
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=0.1)
    np.testing.assert_allclose(run.v[-1].reshape(2, 6)[:, 1], [1.0, 1.0 - 0.4 * G * 0.1], rtol=1e-9)


@given(st.integers(0, 10_000))
@settings(max_examples=15, deadline=None)
def test_without_restitution_the_energy_never_rises(seed):
    rng = np.random.default_rng(seed)
    scene = on_floor(float(rng.uniform(0.1, 1.2)))
    for k in range(3):
        turn, speed = rng.normal(size=3), rng.normal(size=3)
        size = rng.uniform(0.1, 0.3, size=3)
        scene.add_box(size, 1.0, position=(0.1 * k, 0, 0.3 + 0.6 * k), rotation=turn, velocity=speed)
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=0.4)
    # free flight by this scheme raises the energy by h^2 g^2 / 2 a step and body
    assert np.diff(run.energy()).max() <= 3 * 0.5 * (1e-3 * G) ** 2 * (1.0 + 1e-6) + 1e-9


@pytest.mark.parametrize("scheme", PROJECTED, ids=repr)
def test_a_body_that_lands_tilted_is_lifted_and_comes_to_rest(scheme):
    """Contacts that stick are held along their tangents, except where the body could then not turn."""
    scene = on_floor(0.5, restitution=0.5)
    scene.add_box((0.2, 0.3, 0.1), 1.0, position=(0, 0, 0.4), rotation=(0.3, 0.5, 0.2), velocity=(1, 0.3, 0))
    run = mbvi.simulate(scene.build(), scheme, step=1e-3, duration=1.0)
    assert np.abs(run.v[-100:]).max() <= 1e-9
    assert run.q[-1, 2] == pytest.approx(0.05, abs=1e-8)
    assert np.ptp(run.q[-100:], axis=0).max() <= 1e-12


def robot_on_slope():
    """A quadruped on its feet, held by a PD control of its joints."""
    joints = {f"{leg}_{j}_joint": x for leg in ("FL", "FR", "RL", "RR") for j, x in (("thigh", 0.6), ("calf", -1.2))}
    scene = on_floor(0.7, 0.2)
    target = np.tile([0.0, 0.6, -1.2], 4)

    def hold(t, q, v):
        return np.concatenate([np.zeros(6), 200.0 * (target - q[7:]) - 1.5 * v[6:]])

    scene.add_urdf(QUADRUPED, position=(0, 0, 0.36), joints=joints, control=hold)
    return scene.build()


@pytest.mark.parametrize("scheme", [mbvi.Paoli(), *PROJECTED, mbvi.StewartTrinkle()], ids=repr)
def test_the_feet_of_a_robot_on_a_slope_do_not_slip(scheme):
    problem = robot_on_slope()
    run = mbvi.simulate(problem, scheme, step=1e-3, duration=1.0)
    end = problem.at(run.q[-1], run.v[-1])
    # the first one may be the law at the initial state
    step = list(islice(mbvi.steps(end, scheme, step=1e-3), 3))[-1]
    held = step.percussion > 1e-3
    assert held.sum() == 4
    assert np.abs(step.slip[2, held]).max() <= 1e-9


def test_lifting_moves_no_robot_along_the_floor():
    """Contacts that lifting leaves slightly open must bear load in the next step, however long the step is."""
    schemes = mbvi.StewartTrinkle(), mbvi.Centered(project_positions=True)
    ends = [mbvi.simulate(robot_on_slope(), one, step=2e-3, duration=0.6).q[-1, :3] for one in schemes]
    np.testing.assert_allclose(ends[1], ends[0], atol=3e-4)


def test_many_spheres_roll_and_rest_on_each_other():
    """Families of spheres with rotation find the same contacts; their law holds to the residual that was asked."""
    scene = mbvi.Scene(friction=0.5)
    scene.add_container((-0.1, -0.1, 0), (0.1, 0.1))
    scene.add_spheres(*packing.layers((-0.1, -0.1, 0.03), (0.1, 0.1), 0.02, count=60, seed=1), density=2500.0)
    problem = scene.build()
    assert problem.system.nv == 360 and "180 degrees of freedom" in problem.report()
    smooth = mbvi.Scene()
    smooth.add_container((-0.1, -0.1, 0), (0.1, 0.1))
    smooth.add_spheres(*packing.layers((-0.1, -0.1, 0.03), (0.1, 0.1), 0.02, count=60, seed=1), density=2500.0)
    plain = smooth.build()
    np.testing.assert_array_equal(problem.constraints.gap(0.0, problem.q0), plain.constraints.gap(0.0, plain.q0))
    run = mbvi.simulate(problem, step=2e-3, duration=0.4)
    assert "StewartTrinkle" in run.notes[0]
    assert run.penetration().max() <= 1e-3 * 0.02
    # they turn
    assert np.abs(run.v[-1].reshape(-1, 6)[:, 3:]).max() > 1.0


def test_given_functions_have_friction_with_tangents():
    """The paper's own setting: a particle on a plane, launched along it."""
    system = mbvi.LagrangianSystem(lambda q: np.eye(3), lambda t, q, v: np.array([0.0, 0.0, -G]), 3)
    plane = mbvi.GapFunction(lambda q: q[2], lambda q: np.array([0.0, 0, 1]), tangents=lambda q: np.eye(3)[:2])
    problem = mbvi.Problem(system, [plane], [0, 0, 0], [0.6, 0.8, 0], friction=0.5)
    run = mbvi.simulate(problem, mbvi.Paoli(), step=1e-3, duration=0.5)
    stop = 1.0 / (0.5 * G)
    np.testing.assert_allclose(run.q[-1], np.array([0.6, 0.8, 0]) * 0.5 * stop, atol=1e-3)
    assert np.abs(run.v[-1]).max() <= 1e-12
    with pytest.raises(mbvi.InputError, match="no tangents"):
        mbvi.Problem(
            system, [mbvi.GapFunction(plane.f, lambda q: np.array([0.0, 0, 1]))], [0, 0, 0], [0, 0, 0], friction=0.5
        )
    with pytest.raises(mbvi.InputError, match="friction"):
        mbvi.Problem(system, [plane], [0, 0, 0], [0, 0, 0], friction=-0.5)


def test_without_friction_nothing_is_added():
    problem = block(0.0)
    rows = problem.constraints.active(0.0, problem.q0, problem.tolerance)
    assert not problem.constraints.frictional and rows.tangents is None
    step = next(mbvi.steps(problem, mbvi.Paoli(), step=1e-3))
    assert step.slip is None


def test_copies_and_files_keep_friction(tmp_path):
    problem = block(0.5, np.arctan(0.4))
    run = mbvi.simulate(problem, mbvi.Paoli(), step=1e-3, duration=0.05, out=tmp_path / "run.h5")
    again = mbvi.load(tmp_path / "run.h5").problem
    for other in (again, pickle.loads(pickle.dumps(problem))):
        np.testing.assert_array_equal(mbvi.simulate(other, mbvi.Paoli(), step=1e-3, duration=0.05).q, run.q)


def test_schemes_without_friction_say_so():
    problem = block(0.5)
    with pytest.raises(mbvi.UnsuitableError, match="no friction"):
        mbvi.simulate(problem, mbvi.SchatzmanPaoli(), duration=0.1)
    with pytest.raises(mbvi.UnsuitableError, match="Coulomb's law"):
        mbvi.simulate(problem, mbvi.Paoli(), step=1e-3, duration=0.1, solver=mbvi.ProxQP())
    assert "contacts have friction" in mbvi.simulate(ball(0.5, 1.0), duration=0.01).notes[0]


def test_wrong_coefficients_are_refused():
    with pytest.raises(mbvi.InputError, match="friction"):
        mbvi.Scene(friction=-0.1)
    scene = on_floor(0.1)
    with pytest.raises(mbvi.InputError, match="unknown name"):
        scene.set_friction("floor", "nothing", 0.5)
    with pytest.raises(mbvi.InputError, match="friction mu"):
        scene.set_friction("floor", "floor", np.inf)


def test_an_impact_that_would_gain_energy_takes_less_restitution():
    """A tilted rod with high friction (Kane's paradox): its energy rises by a fifth, and is kept with the cap."""
    gained = []
    for cap in (False, True):
        scene = mbvi.Scene(gravity=(0, 0, 0), restitution=0.9, friction=1.05, energy_cap=cap)
        scene.add_halfspace((0, 0, 1), 0.0)
        moves = {"velocity": (0.26, 0, -1.0), "angular_velocity": (0, -1.89, 0)}
        scene.add_capsule(0.01, 1.0, 1.0, position=(0, 0, 0.393), rotation=(0, 0.7, 0), **moves)
        problem = scene.build()
        with nullcontext() if cap else pytest.warns(mbvi.MbviWarning, match="Kane"):
            run = mbvi.simulate(problem, mbvi.Paoli(), step=1e-4, duration=3e-3)
        assert len(run.impacts) == 1
        gained.append(run.energy()[-1] / run.energy()[0] - 1.0)
    assert gained[0] > 0.2
    assert abs(gained[1]) <= 1e-11
    with pytest.raises(mbvi.UnsuitableError, match="cap"):
        mbvi.simulate(problem, mbvi.StewartTrinkle(), step=1e-3, duration=0.1)


@pytest.mark.parametrize("seed", range(8))
def test_a_ball_that_rolls_without_weight_rolls_on(seed):
    """Its contact speeds are rounding of terms that cancel: nothing must be solved for them."""
    rng = np.random.default_rng(seed)
    normal = rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    scene = mbvi.Scene(gravity=(0, 0, 0), friction=0.4)
    scene.add_halfspace(normal, 0.0)
    scene.add_sphere(0.1, 1.0, 0.1005 * normal, rng.normal(size=3) - 2.0 * normal)
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=0.05)
    assert len(run.impacts) == 1
    np.testing.assert_allclose(run.v[-1], run.v[10], rtol=1e-12, atol=1e-12)


@each_scheme
@pytest.mark.parametrize("restitution", [0.0, 0.5])
def test_a_plank_on_rollers_that_turn_against_each_other_swings(scheme, restitution):
    """Timoshenko's experiment: the loads of the rollers differ by what the plank is off, and so does their friction."""
    mu, apart, radius, half, start = 0.25, 0.5, 0.1, 0.025, 0.1
    scene = mbvi.Scene(friction=mu, restitution=restitution)
    for x in (-apart, apart):
        turning = motion.Rotation((0, 1, 0), -np.sign(x) * 60.0, (x, 0, -radius))
        for y in (-0.1, 0.1):
            scene.add_sphere(radius, position=(x, y, -radius), fixed=True, motion=turning)
    scene.add_box((2.0, 0.3, 2 * half), 2.0, position=(start, 0, half), name="plank")
    run = mbvi.simulate(scene.build(), scheme, step=1e-3, duration=0.5, record="contacts")
    frequency = np.sqrt(mu * G / (apart - mu * half))
    np.testing.assert_allclose(run.q[:, 0], start * np.cos(frequency * run.t), atol=2e-4)
    np.testing.assert_allclose(run.v[1:, 0], -start * frequency * np.sin(frequency * run.t[1:]), atol=1e-6)
    # rollers move along themselves: the plank neither sinks nor rises, and they carry it from the first step on
    assert np.abs(run.v[:, 2]).max() < 1e-9 and np.abs(run.q[:, 2] - half).max() < 1e-9
    np.testing.assert_allclose(run.contact_forces("plank")[1:, 2], 2.0 * G, rtol=1e-6)


def test_the_law_at_the_start_takes_the_accuracy_of_the_run():
    """Many contacts that close at the start are solved as those of the steps, not to 1e-6."""
    scene = mbvi.Scene(friction=0.5)
    scene.add_container((-0.1, -0.1, 0), (0.1, 0.1))
    at = 0.02 + 0.04 * np.stack(np.unravel_index(np.arange(75), (5, 5, 3)), axis=1) - [0.1, 0.1, 0.0]
    velocities = np.random.default_rng(1).normal(size=(75, 3))
    scene.add_spheres(at, 0.02, density=2500.0, velocities=velocities)
    start = next(mbvi.steps(scene.build(), mbvi.StewartTrinkle(), step=2e-3))
    assert start.t == 0.0 and len(start.active.gap) > 100
    assert 1e-6 < start.residual <= 1e-3


@pytest.mark.parametrize("scheme", [mbvi.Paoli(), mbvi.Centered(project_positions=True), mbvi.StewartTrinkle()])
@pytest.mark.parametrize("slope", [1.0, 20.0])
def test_a_box_with_immense_friction_never_slips(scheme, slope):
    """On a floor of any slope it stays where it is; after a fall it rolls over its edges, and comes to rest."""
    angle = np.arctan(slope)
    scene = mbvi.Scene(gravity=(9.81 * np.sin(angle), 0, -9.81 * np.cos(angle)), friction=1e6)
    scene.add_halfspace((0, 0, 1))
    scene.add_box((2.0, 0.3, 0.02), 1.0, position=(0, 0, 0.01))
    problem = scene.build()
    run = mbvi.simulate(problem, scheme, step=1e-3, duration=0.05)
    assert np.abs(run.q - problem.q0).max() <= 1e-12
    scene = mbvi.Scene(friction=1e6)
    scene.add_halfspace((0, 0, 1))
    scene.add_box((0.2, 0.3, 0.1), 1.0, position=(0, 0, 0.3), velocity=(1, 0.5, 0), angular_velocity=(3, 2, 1))
    run = mbvi.simulate(scene.build(), scheme, step=1e-3, duration=0.6)
    assert run.residual.max() <= 1e-7
