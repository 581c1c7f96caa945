"""Walls with a prescribed motion in the compiled loop: bodies whose joints turn and slide at constant speeds."""

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

import mbvi
from mbvi import motion
from mbvi.constraints.mechanism.walls import wall_joints
from mbvi.run.fixed_steps import taking
from mbvi.run.loop.loop_scope import is_compiled
from mbvi.system.mechanisms.joined import joined

pytestmark = pytest.mark.filterwarnings("ignore::mbvi.MbviWarning")
SCHEMES = {
    "Paoli": mbvi.Paoli(),
    "MoreauJean": mbvi.MoreauJean(theta=0.7),
    "Centered": mbvi.Centered(),
    "Centered, projected": mbvi.Centered(project_positions=True),
    "StewartTrinkle": mbvi.StewartTrinkle(),
}


class Given:
    """The motion of another one as an object of a user's own class, which kernels do not know."""

    def __init__(self, known):
        self.pose, self.twist = known.pose, known.twist


def drawn_motion(rng):
    kind = rng.integers(3)
    if kind == 0:
        return motion.Translation(rng.uniform(-0.4, 0.4, 3) * [1.0, 1.0, 0.3])
    if kind == 1:
        return motion.Rotation(rng.normal(size=3) * [0.1, 0.1, 1.0], rng.uniform(-2, 2), rng.uniform(-0.2, 0.2, 3))
    return motion.Oscillation(rng.uniform(-5e-3, 5e-3, 3), rng.uniform(2.0, 12.0), rng.uniform(0.0, 6.0))


def drawn_scene(seed, same=lambda motion: motion):
    """Bodies that fall on a container, a tray, half-spaces, or a block and a post, which move; and what they meet."""
    rng = np.random.default_rng(seed)
    scene = mbvi.Scene(friction=rng.choice([0.0, 0.5]), restitution=rng.choice([0.0, 0.4, 1.0]))
    first, second = same(drawn_motion(rng)), same(drawn_motion(rng))
    ground = seed % 4
    if ground == 0:
        scene.add_container((-0.6, -0.6, 0.0), (0.6, 0.6), motion=first)
    elif ground == 1:
        scene.add_box((1.6, 1.6, 0.2), position=(0, 0, -0.1), motion=first)
        scene.add_halfspace((0, 0, 1), -0.5)
    elif ground == 2:
        scene.add_halfspace((0.05, 0, 1), 0.0, motion=first)
        scene.add_halfspace((-1, 0.1, 0.2), -0.8, motion=second)
    else:
        scene.add_halfspace((0, 0, 1), 0.0)
        scene.add_box((0.4, 0.4, 0.3), position=(0, 0, 0.15), motion=first)
        scene.add_cylinder(0.1, 0.4, position=(-0.5, 0.1, 0.2), motion=second)
    for k in range(rng.integers(2, 5)):
        place = {"position": (*rng.uniform(-0.3, 0.3, 2), 0.45 + 0.2 * k), "velocity": rng.normal(scale=0.3, size=3)}
        turned = {"rotation": Rotation.random(rng=rng).as_matrix(), "angular_velocity": rng.normal(size=3)}
        kind = rng.integers(4)
        if kind == 0:
            scene.add_sphere(0.05, 0.3, **place)
        elif kind == 1:
            scene.add_capsule(0.04, 0.1, 0.4, **place, **turned)
        elif kind == 2:
            scene.add_cylinder(0.05, 0.08, 0.4, **place, **turned)
        else:
            scene.add_box(rng.uniform(0.06, 0.15, 3), 0.5, **place, **turned)
    return scene.build()


def run_of(problem, scheme, duration=0.5, **options):
    return mbvi.simulate(problem, scheme, step=2e-3, duration=duration, progress=False, **options)


def decided(problem, scheme):
    """Return how long a run is decided by more than the rounding of its start, at most 0.5 s; at least 0.3 s.

    A cylinder that lies flat has the lowest point of its rim where rounding puts it, and turns as friction there says.
    """
    run, until = run_of(problem, scheme), 0.5
    for by in (-3e-14, -1e-14, 1e-14, 3e-14):
        moved = problem.v0.copy()
        moved[:3] += by
        other = run_of(problem.at(problem.q0, moved), scheme)
        # a tenth of what `assert_same` allows
        parted = (np.abs(run.q - other.q).max(axis=1) > 1e-9) | (np.abs(run.v - other.v).max(axis=1) > 1e-7)
        until = min([until, *(run.t[parted][:1] - 2e-3)])
    assert until > 0.3
    return until


def assert_same(run, other):
    # with friction percussions are known to 1e-9 of the largest velocity
    np.testing.assert_allclose(run.q, other.q, rtol=0.0, atol=1e-8)
    np.testing.assert_allclose(run.v, other.v, rtol=0.0, atol=1e-6)
    assert [one.time for one in run.impacts] == pytest.approx([one.time for one in other.impacts], abs=1e-12)
    for one, two in zip(run.impacts, other.impacts, strict=True):
        # of a step with projected positions the order of rows is not that of their constraints
        (names, numbers), (expected, known) = by_name(one), by_name(two)
        assert names == expected
        np.testing.assert_allclose(numbers, known, rtol=1e-6, atol=1e-7)


def by_name(impact):
    numbers = np.column_stack([impact.percussion, impact.before])
    order = sorted(range(len(numbers)), key=lambda k: (impact.constraints[k], *numbers[k].round(5)))
    return [impact.constraints[k] for k in order], numbers[order]


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("name", SCHEMES)
def test_drawn_scenes_move_as_by_steps_of_python(name, seed, monkeypatch):
    problem, loops, made = drawn_scene(seed), [], taking.compiled_loop
    assert is_compiled(problem, SCHEMES[name])
    monkeypatch.setattr(taking, "compiled_loop", lambda *_: None)
    until = decided(problem, SCHEMES[name])
    python = run_of(problem, SCHEMES[name], duration=until)
    monkeypatch.setattr(taking, "compiled_loop", lambda *given: loops.append(made(*given)) or loops[-1])
    run = run_of(problem, SCHEMES[name], duration=until)
    taken, *left = loops[0].codes.tolist()
    assert taken >= 1 and sum(left) <= 25
    assert_same(run, python)


@pytest.mark.parametrize("robot", ["quadruped", "hopper"])
@pytest.mark.parametrize("name", SCHEMES)
def test_robots_on_a_table_that_shakes_move_as_by_steps_of_python(name, robot, monkeypatch):
    scene, shakes = mbvi.Scene(friction=0.6), motion.Oscillation((4e-3, 0, 3e-3), 3.0)
    scene.add_box((3.0, 3.0, 0.2), position=(0, 0, -0.1), motion=shakes)
    scene.add_urdf(mbvi.robot(robot), position=(0, 0, 0.5))
    problem = scene.build()
    run = run_of(problem, SCHEMES[name], duration=0.3)
    monkeypatch.setattr(taking, "compiled_loop", lambda *_: None)
    assert run.impacts
    assert_same(run, run_of(problem, SCHEMES[name], duration=0.3))


def test_runs_of_one_problem_have_the_same_bytes_and_begin_with_shorter_ones():
    problem, scheme = drawn_scene(0), mbvi.Centered(project_positions=True)
    run, again, shorter = (run_of(problem, scheme, duration=t) for t in (0.5, 0.5, 0.3))
    assert run.q.tobytes() == again.q.tobytes() and run.v.tobytes() == again.v.tobytes()
    assert run.q[: len(shorter.q)].tobytes() == shorter.q.tobytes()
    built = run_of(drawn_scene(0), scheme)
    assert built.q.tobytes() == run.q.tobytes()
    later = run_of(problem.at(run.q[100], run.v[100], run.t[100]), scheme, duration=0.2)
    np.testing.assert_allclose(later.q, run.q[100:201], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_motions_of_users_classes_are_those_of_the_library(seed):
    known, given = drawn_scene(seed), drawn_scene(seed, same=Given)
    scheme = mbvi.Centered(project_positions=True)
    assert is_compiled(known, scheme) and not is_compiled(given, scheme)
    until = decided(known, scheme)
    assert_same(run_of(known, scheme, duration=until), run_of(given, scheme, duration=until))


@pytest.mark.parametrize("seed", range(12))
def test_joints_of_walls_move_them_as_prescribed(seed):
    rng = np.random.default_rng(seed)
    each = [drawn_motion(rng) for _ in range(3)]
    scene = mbvi.Scene()
    scene.add_box((0.1, 0.1, 0.1), position=(0, 0, 5.0))
    problem = scene.build()

    made = wall_joints(joined(problem.system), problem.system, each)
    model, data = made.system.model, made.system.model.createData()
    for t in rng.uniform(-3.0, 3.0, 4):
        coordinates = made.prescribed.motion[:, 0] * t + made.prescribed.motion[:, 1]
        q, v = np.concatenate([problem.q0, coordinates]), np.concatenate([problem.v0, made.prescribed.motion[:, 0]])
        pin.forwardKinematics(model, data, q, v)
        for one in each:
            wall = made.walls[one]
            pose, (turn, place), (velocity, spin) = data.oMi[wall.body], one.pose(t), one.twist(t)
            np.testing.assert_allclose(pose.rotation, turn, atol=1e-14)
            np.testing.assert_allclose(pose.act(-wall.origin), place, atol=1e-14)
            twist = pose.act(data.v[wall.body])
            np.testing.assert_allclose(twist.linear, velocity, atol=1e-12)
            np.testing.assert_allclose(twist.angular, spin, atol=1e-12)


@pytest.mark.parametrize("name", SCHEMES)
def test_a_box_on_a_belt_slides_until_it_moves_with_it(name):
    mu, speed, h, g = 0.4, 1.5, 1e-3, 9.81
    scene = mbvi.Scene(friction=mu)
    scene.add_halfspace((0, 0, 1), name="belt", motion=motion.Translation((speed, 0, 0)))
    scene.add_box((0.2, 0.2, 0.1), 2.0, position=(0, 0, 0.05))
    run = mbvi.simulate(scene.build(), SCHEMES[name], step=h, duration=0.6, progress=False)
    slides = speed / (mu * g)
    exact = np.where(run.t < slides, 0.5 * mu * g * run.t**2, speed * run.t - 0.5 * speed * slides)
    np.testing.assert_allclose(run.q[:, 0], exact, rtol=0.0, atol=1.1 * speed * h)
    np.testing.assert_allclose(run.v[-1, 0], speed, rtol=0.0, atol=1e-12)


def test_contacts_of_walls_that_stand_and_move_are_recorded_in_the_order_of_their_constraints(monkeypatch):
    # numbers of constraints: first walls that stand still, then shapes, then walls that move
    scene = mbvi.Scene(friction=0.5)
    scene.add_halfspace((1, 0, 0), -0.1, name="side")
    scene.add_halfspace((0, 0, 1), name="belt", motion=motion.Translation((-0.5, 0, 0)))
    scene.add_box((0.2, 0.2, 0.1), 2.0, position=(0, 0, 0.05), name="low")
    scene.add_box((0.1, 0.1, 0.1), 1.0, position=(0, 0, 0.15), name="high")
    problem, runs = scene.build(), []
    for python in (False, True):
        if python:
            monkeypatch.setattr(taking, "compiled_loop", lambda *_: None)
        runs.append(run_of(problem, mbvi.Centered(project_positions=True), record="contacts", duration=0.2))
    for t in (0.05, 0.15, 0.2):
        one, two = (sorted(run.contacts(t), key=lambda c: (c.name, *c.point.round(6))) for run in runs)
        assert {c.name for c in one} == {"low | side", "low | belt", "low | high"}
        assert [c.name for c in one] == [c.name for c in two]
        np.testing.assert_allclose([c.point for c in one], [c.point for c in two], atol=1e-9)
        for run in runs:
            lifted = [c.percussion * c.normal + c.tangential for c in run.contacts(t) if c.name != "low | high"]
            assert sum(lifted)[2] == pytest.approx(3.0 * 9.81 * 2e-3, rel=1e-6)


def test_steps_that_the_loop_leaves_to_python_go_on_from_there(monkeypatch):
    """Every third step is Python's: the loop goes on from its state."""
    problem, made = drawn_scene(1), taking.compiled_loop

    def interrupted(*given):
        loop = made(*given)
        run, calls = loop.run, []

        def one_step(state, done, whole):
            calls.append(done)
            return (state, done, False) if len(calls) % 3 == 0 else run(state, done, min(whole, done + 1))

        loop.run = one_step
        return loop

    expected = run_of(problem, mbvi.Centered(project_positions=True), duration=0.3)
    monkeypatch.setattr(taking, "compiled_loop", interrupted)
    assert_same(run_of(problem, mbvi.Centered(project_positions=True), duration=0.3), expected)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("name", SCHEMES)
def test_simulators_take_the_steps_of_simulate(name, seed):
    problem = drawn_scene(seed)
    run, simulator = run_of(problem, SCHEMES[name], duration=0.3), mbvi.Simulator(problem, SCHEMES[name], step=2e-3)
    for state in simulator.reset():
        assert np.isfinite(state).all()
    for k in range(1, len(run.t)):
        q, v = simulator.step()
        np.testing.assert_allclose(q, run.q[k], rtol=0.0, atol=1e-8)
        np.testing.assert_allclose(v, run.v[k], rtol=0.0, atol=1e-6)
    last = q.tobytes()
    simulator.reset()
    assert simulator.step(len(run.t) - 1)[0].tobytes() == last


def test_a_simulator_names_the_contacts_at_walls_that_move():
    scene = mbvi.Scene()
    scene.add_halfspace((1, 0, 0), -1.0, name="side")
    scene.add_halfspace((0, 0, 1), name="table", motion=motion.Oscillation((0, 0, 2e-3), 3.0))
    scene.add_box((0.2, 0.2, 0.1), 2.0, position=(0, 0, 0.05), name="low")
    scene.add_box((0.1, 0.1, 0.1), 1.0, position=(0, 0, 0.15), name="high")
    simulator = mbvi.Simulator(scene.build(), mbvi.Centered(project_positions=True), step=1e-3)
    simulator.step(120)
    forces = {}
    for contact in simulator.contacts:
        forces[contact.name] = forces.get(contact.name, 0.0) + contact.force * contact.normal[2]
    # the acceleration of the table in the middle of the step
    lift = 9.81 - 2e-3 * (6.0 * np.pi) ** 2 * np.sin(6.0 * np.pi * 0.1195)
    assert forces == pytest.approx({"low | high": lift, "low | table": 3.0 * lift}, rel=2e-3)
