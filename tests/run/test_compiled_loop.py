"""Runs by the compiled loop are those of the Python step."""

import pickle
import signal
from typing import NamedTuple

import numpy as np
import pytest

import mbvi
from mbvi.constraints.mechanism.tables import copy_row
from mbvi.run.accuracy import projector_of
from mbvi.run.fixed_steps import taking
from mbvi.run.loop import compiled_loop
from mbvi.run.loop.compiled_loop import Patience
from mbvi.run.recording.recorder import Recorder
from mbvi.run.sleeping import Sleepers
from mbvi.run.tunnelling import TunnellingGuard
from mbvi.schemes import Step, stewart_trinkle
from mbvi.schemes.gap_bounds import open_gaps
from mbvi.schemes.kernels.records import BOUNCES
from mbvi.schemes.kernels.stewart_trinkle import lower_to_the_end
from mbvi.schemes.positions import position_projection
from mbvi.schemes.step import NO_RATES
from mbvi_studies.published_robots import PUBLISHED as PUBLISHED_ROBOTS
from mbvi_studies.published_robots import published_robot
from support.loop_arguments import (
    among_boxes,
    arguments_of_call,
    carried,
    hopper,
    on_block,
    on_rubble,
    one_ball,
    one_box,
    pile_of_six,
    quadruped,
    small_heap,
    struck,
    swaying,
    tied,
    tumbling,
    two_hoppers,
)  # fmt: skip
from support.paths import ROBOTS, real_robot
from support.robot_problems import OWN, built_once, problem_of

STEP = 1e-3
SCHEMES = [mbvi.Paoli(), mbvi.MoreauJean(), mbvi.Centered(), mbvi.Centered(project_positions=True)]
each_scheme = pytest.mark.parametrize("scheme", [*SCHEMES, mbvi.StewartTrinkle()], ids=repr)
pytestmark = pytest.mark.filterwarnings("ignore::mbvi.MbviWarning")


class States(NamedTuple):
    """States from which single steps are taken."""

    t: np.ndarray
    q: np.ndarray
    v: np.ndarray


def copied(problem):
    return pickle.loads(pickle.dumps(problem))


def by_python(monkeypatch, problem, scheme, **options):
    """Run a copy of a problem without the loop."""
    with monkeypatch.context() as patched:
        patched.setattr(taking, "compiled_loop", lambda *_: None)
        return mbvi.simulate(copied(problem), scheme, progress=False, **options)


def same_bytes(run, other):
    for name in ("t", "q", "v", "residual"):
        np.testing.assert_array_equal(getattr(run, name), getattr(other, name), err_msg=name)
    np.testing.assert_array_equal(run.penetration(), other.penetration())
    assert len(run.impacts) == len(other.impacts)
    for one, two in zip(run.impacts, other.impacts, strict=True):
        for name, value in vars(two).items():
            np.testing.assert_array_equal(getattr(one, name), value, err_msg=name)
    assert run.notes == other.notes
    assert run.complete == other.complete


# one step


def step_of_the_loop(problem, scheme, start):
    """Return a function that takes one step of the loop from a state: None where it leaves the step to Python."""
    problem.system.start()
    projector, _ = projector_of(problem, scheme, None, None, None)
    recorder, guard = Recorder(problem, 2, scheme.timing), TunnellingGuard(problem, scheme, STEP)
    loop = taking.compiled_loop(problem, scheme, projector, recorder, guard, STEP, 10**9, 10**9)
    none = problem.constraints.active(*start, problem.tolerance)

    def take(i, t, q, v):
        # a run leaves out attempts of the loop after several that took no step
        loop._patience = Patience()
        state, done, _ = loop.run(Step(t, q, v, none, NO_RATES, 0.0), i, i + 1)
        if done == i:
            # what is left to Python is taken by it, as in a run
            scheme.step(problem, problem.t0 + i * STEP, q, v, STEP, projector)
        return state if done == i + 1 else None

    return take


def spread_by_rounding(problem, scheme, t, q, v, step):
    """How far steps of the scheme from states that differ by rounding are from a step, relative to the largest."""
    rng, most, scale = np.random.default_rng(0), 0.0, max(1.0, np.abs(step.v).max())
    for _ in range(8):
        projector, _ = projector_of(problem, scheme, None, None, None)
        near = problem.system.integrate(q, 1e-15 * rng.normal(size=len(v)))
        other = scheme.step(problem, t, near, v, STEP, projector)
        most = max(most, np.abs(other.v - step.v).max() / scale)
    return most


def steps_that_agree(problem, scheme, steps, disturbance=0.0, spread=0.0, run=None):
    """Compare single steps from states; yield those of the scheme, None where the loop leaves one to it.

    The states are those of a given run, or those that the compared steps of the scheme lead to, or those of a new run,
    each coordinate disturbed by some `disturbance` [m or rad]. Where Coulomb's law may have several answers, velocities
    may differ by `spread`, relative to the largest: by so much they differ from other starts, too; or by a few times
    what rounding of the state makes of the scheme's own step.
    """
    if disturbance:
        with pytest.MonkeyPatch.context() as patched:
            run = by_python(patched, problem, scheme, step=STEP, duration=steps * STEP)
        moves = disturbance * np.random.default_rng(0).normal(size=run.v.shape)
        q = np.array([problem.system.integrate(*pair) for pair in zip(run.q, moves, strict=True)])
        run = States(run.t, q, run.v)
    other = copied(problem)
    other.system.start()
    projector, _ = projector_of(other, scheme, None, None, None)
    t, q, v = (problem.t0, problem.q0, problem.v0) if run is None else (run.t[0], run.q[0], run.v[0])
    take = step_of_the_loop(copied(problem), scheme, (t, q))
    for i in range(steps if run is None else len(run.t) - 1):
        if run is not None:
            t, q, v = run.t[i], run.q[i], run.v[i]
        state = take(i, t, q, v)
        step = scheme.step(other, problem.t0 + i * STEP, q, v, STEP, projector)
        if state is not None:
            may_differ = step.slip is not None and not projector.friction.start.unique
            least = max(spread, 1e-12) if may_differ else 1e-12
            largest = max(1.0, np.abs(step.q).max(), np.abs(step.v).max())
            # position projections of kernels and of Python round in different orders
            rounds = may_differ or scheme.project_positions
            if rounds and np.abs(state.v - step.v).max() > least * largest:
                least = max(least, 10.0 * spread_by_rounding(other, scheme, step.t - STEP, q, v, step))
            scale = least * largest
            np.testing.assert_allclose(state.q, step.q, rtol=0.0, atol=scale, err_msg=f"step {i}")
            np.testing.assert_allclose(state.v, step.v, rtol=0.0, atol=scale, err_msg=f"step {i}")
            assert state.active.constraint.tolist() == step.active.constraint.tolist()
            # those of the end of a step differ as far as velocities do
            moved = STEP * scale if isinstance(scheme, mbvi.StewartTrinkle) else 0.0
            np.testing.assert_allclose(state.active.gap, step.active.gap, rtol=0.0, atol=1e-12 + moved)
            np.testing.assert_array_equal(state.active.restitution, step.active.restitution)
            most = least / 1e-12 * np.abs(step.rates).max(initial=1.0)
            J, p, unique = step.active.jacobian, state.rates[0] - step.percussion, 0
            if spread and step.slip is not None:
                J = np.concatenate([J, step.active.tangents.jacobian])
                p = np.concatenate([p, (state.slip[0] - step.slip[0]).ravel()])
            if (spread or step.slip is None) and len(p) and np.linalg.matrix_rank(J) < len(p):
                # rows that depend on each other: only what their percussions do together is unique
                np.testing.assert_allclose(J.T @ p, 0.0, rtol=0.0, atol=1e-11 * most)
                unique = 1
            np.testing.assert_allclose(state.rates[unique:], step.rates[unique:], rtol=0.0, atol=1e-11 * most)
            if step.slip is not None:
                np.testing.assert_allclose(state.slip[unique:], step.slip[unique:], rtol=0.0, atol=1e-11 * most)
        yield None if state is None else step
        t, q, v = problem.t0 + (i + 1) * STEP, step.q, step.v


def share_that_agrees(problem, scheme, steps, spread=0.0):
    """Compare single steps from the states of a run; return the share of those that the loop takes."""
    return np.mean([step is not None for step in steps_that_agree(problem, scheme, steps, spread=spread)])


@each_scheme
@pytest.mark.parametrize("name", ["double_pendulum", "hopper", "quadruped"])
def test_a_step_is_that_of_the_scheme(name, scheme):
    assert share_that_agrees(problem_of(name, "fall", 0.0), scheme, 200) == 1.0


@each_scheme
@pytest.mark.parametrize("mu", [0.0, 0.6])
@pytest.mark.parametrize("scene", [quadruped, hopper, on_rubble])
def test_a_step_that_bounces_or_sticks_is_that_of_the_scheme(scene, mu, scheme):
    assert share_that_agrees(scene(0.5, mu), scheme, 150) > 0.8


# mu, and the lengths of torsional and rolling friction
RESISTING = (0.6, 0.02, 0.005)


@each_scheme
@pytest.mark.parametrize("scene", [hopper, swaying])
def test_a_step_with_torsional_and_rolling_friction_is_that_of_the_scheme(scene, scheme):
    problem, resisted = scene(0.2, RESISTING), 0
    steps = [*steps_that_agree(problem, scheme, 80, spread=SPREAD)]
    assert np.mean([step is not None for step in steps]) > 0.8
    for step in steps:
        resisted += step is not None and step.slip is not None and bool(step.slip[0, :, 2:].any())
    assert resisted > 0


# with friction percussions of feet that loops connect are not unique, which this comparison does not know
@pytest.mark.parametrize(
    ("scheme", "mu"), [*((scheme, mu) for scheme in SCHEMES for mu in (0.0, 0.6)), (mbvi.StewartTrinkle(), 0.0)]
)
def test_a_step_with_loops_is_that_of_the_scheme(scheme, mu):
    assert share_that_agrees(tied(0.5, mu), scheme, 150) > 0.8


@pytest.mark.parametrize(
    ("e", "disturbance", "least", "fewest"),
    [(0.0, 0.0, 100, 1), (0.0, 1e-6, 100, 0), (0.002, 1e-6, 20, 0)],
    ids=["rests", "sinks", "with restitution"],
)
def test_a_step_that_raises_sticking_contacts_is_that_of_the_scheme(e, disturbance, least, fewest, monkeypatch):
    """With friction the scheme projects positions by searches, and the loop in one kernel; some rows change places."""
    calls, raised, reordered, project = [], 0, 0, position_projection._with_tangent_velocity
    monkeypatch.setattr(
        position_projection, "_with_tangent_velocity", lambda *args: calls.append(args) or project(*args)
    )
    for step in steps_that_agree(swaying(e, 0.6), SCHEMES[-1], 200, disturbance):
        if step is not None and calls:
            raised += 1
            reordered += bool((np.diff(step.active.constraint) < 0).any())
        calls.clear()
    assert raised >= least
    assert reordered >= fewest


def dropped(name, e, mu):
    """A published robot that turns, and lands on some feet in some ten steps."""
    scene = mbvi.Scene(restitution=e, friction=mu)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(real_robot(PUBLISHED_ROBOTS[name].file), position=(0, 0, 5))
    problem = scene.build()
    q, v, rows = problem.q0.copy(), problem.v0.copy(), problem.constraints
    floor = [k for k in range(len(rows)) if rows.name(k).endswith("| floor")]
    q[2] += 0.005 - float(rows.gap(0.0, q)[floor].min())
    v += 0.5 * np.random.default_rng(0).normal(size=len(v))
    return problem.at(q, v)


@pytest.mark.slow
@pytest.mark.parametrize("scheme", [mbvi.Paoli(), SCHEMES[-1]], ids=repr)
def test_a_step_of_a_robot_of_hulls_on_rubble_is_that_of_the_scheme(scheme):
    scene = mbvi.Scene(restitution=0.0, friction=0.6)
    scene.add_heightfield(0.04 * np.random.default_rng(0).random((64, 64)), (4.0, 4.0), name="rubble")
    scene.add_urdf(real_robot(PUBLISHED_ROBOTS["go2"].file), position=(0.03, 0.02, 0.37))
    taken = [step is not None for step in steps_that_agree(scene.build(), scheme, 250, spread=SPREAD)]
    assert np.mean(taken) > 0.9


@pytest.mark.parametrize("e", [0.0, 0.4])
@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
def test_a_step_on_several_meshes_is_that_of_the_scheme(scheme, e, monkeypatch):
    """A box lies across two fields, and a ball and a capsule go from a field to a roof, one of them too fast."""
    scene = mbvi.Scene(restitution=e, friction=0.4)
    rng = np.random.default_rng(5)
    for name, x in (("left", -1.0), ("right", 1.0)):
        scene.add_heightfield(0.04 * rng.random((32, 32)), (2.0, 2.0), position=(x, 0, 0), name=name)
    corners = [(-1, -1, 0), (1, -1, 0), (-1, 0, 0.5), (1, 0, 0.5), (-1, 1, 0), (1, 1, 0)]
    faces = [[0, 1, 3], [0, 3, 2], [2, 3, 5], [2, 5, 4]]
    scene.add_surface(corners, faces, one_sided=True, position=(0, 1.5, 0), name="roof")
    scene.add_box((0.5, 0.2, 0.1), position=(0.0, 0, 0.15), rotation=(0.1, 0.2, 0.0), name="box")
    scene.add_sphere(0.1, position=(-0.5, 0.6, 0.2), velocity=(2.0, 1.0, 0.0), name="ball")
    scene.add_capsule(0.04, 0.2, position=(0.8, 0.3, 0.4), velocity=(-1.0, 1.0, -60.0), name="capsule")
    problem = scene.build()
    # in which the fast one is stopped
    run = by_python(monkeypatch, problem, scheme, step=STEP, duration=300 * STEP)
    taken = [step is not None for step in steps_that_agree(problem, scheme, 300, spread=SPREAD, run=run)]
    assert np.mean(taken) > 0.9


@pytest.mark.parametrize("mu", [0.0, 0.6])
@pytest.mark.parametrize("e", [0.0, 0.05])
@pytest.mark.parametrize(("name", "steps"), [("solo12", 150), ("go2", 150), ("anymal", 150)])
def test_a_step_that_projects_positions_by_searches_is_that_of_the_scheme(name, steps, e, mu, monkeypatch):
    """Of robots on their hulls, also where contacts bounce beside closed ones, and where bodies move far."""
    calls, taken, raised, project = [], 0, 0, position_projection._with_tangent_velocity
    monkeypatch.setattr(
        position_projection, "_with_tangent_velocity", lambda *args: calls.append(args) or project(*args)
    )
    problem = dropped(name, e, mu)
    for disturbance in (0.0, 1e-6):
        for step in steps_that_agree(problem, SCHEMES[-1], steps, disturbance):
            taken, raised = taken + (step is not None), raised + (step is not None and len(calls) > 0)
            calls.clear()
    # Coal measures a few pairs
    assert taken > 1.9 * steps
    assert raised >= 5


@pytest.mark.parametrize("mu", [0.0, 0.6])
@pytest.mark.parametrize("e", [0.0, 0.002, 0.5])
@pytest.mark.parametrize("scene", [quadruped, hopper, swaying, on_block, lambda e, mu: dropped("solo12", e, mu)])
def test_no_step_is_left_to_python_because_positions_are_projected(scene, e, mu, loops):
    mbvi.simulate(scene(e, mu), SCHEMES[-1], step=STEP, duration=0.25, progress=False)
    assert not loops[0].codes[BOUNCES]
    # of calls that take no step there are three at least before the loop waits
    assert loops[0].codes.sum() < 50


def in_a_vise(mu):
    """A hopper whose trunk is held by two boxes that overlap it, and another one that has sunk into the floor.

    The knee of the first is beyond its limit.
    """
    scene = mbvi.Scene(restitution=0.0, friction=mu)
    scene.add_halfspace((0, 0, 1), name="floor")
    for x, name in ((0.0, "held"), (3.0, "loose")):
        scene.add_urdf(ROBOTS / "hopper/hopper.urdf", position=(x, 0, 1.0), joints={"knee": 0.4}, name=name)
    for z in (1.149, 0.851):
        scene.add_box((0.04, 0.04, 0.2), position=(0.1, 1, z), fixed=True, name=f"jaw at {z}")
    problem = scene.build()
    rows, q = problem.constraints, problem.q0.copy()
    names, gap = [rows.name(k) for k in range(len(rows))], rows.gap(0.0, q)
    (knee,) = [k for k, name in enumerate(names) if name.startswith("held/knee upper")]
    floor = [k for k, name in enumerate(names) if name.startswith("loose/") and name.endswith("| floor")]
    held, loose = problem.system.located_parts()
    q[held.q + held.system.nq - 1] += gap[knee] + 1e-3
    q[held.q + 1] = 1.0
    q[loose.q + 2] -= gap[floor].min() + 1e-3
    count, v = 5, problem.v0
    moves = 1e-6 * np.random.default_rng(0).normal(size=(count, len(v)))
    return problem, States(
        STEP * np.arange(count), np.array([problem.system.integrate(q, m) for m in moves]), np.array([v] * count)
    )


@pytest.mark.parametrize("mu", [0.0, 0.6])
def test_what_can_be_raised_beside_contacts_that_contradict_each_other_is_as_by_the_scheme(mu, monkeypatch):
    found, displace = [], position_projection.displacement_of_groups
    monkeypatch.setattr(
        position_projection, "displacement_of_groups", lambda *args: found.append(displace(*args)) or found[-1]
    )
    problem, states = in_a_vise(mu)
    taken = [step is not None for step in steps_that_agree(problem, SCHEMES[-1], 4, spread=SPREAD, run=states)]
    # a law whose rows contradict each other by their rounding may take another solver
    assert sum(taken) >= 2
    assert sum(one is not None for one in found) >= 4


@pytest.mark.parametrize("mu", [0.0, 0.6])
@pytest.mark.parametrize(("e", "where"), [(0.0, stewart_trinkle), (0.5, open_gaps)])
def test_a_step_that_removes_penetration_by_its_displacement_is_that_of_the_scheme(e, where, mu, monkeypatch):
    """Of contacts at rest, and of those that would close another contact as they bounce."""
    found, compute = [], where.displacing_velocity
    monkeypatch.setattr(where, "displacing_velocity", lambda *args: found.append(compute(*args)) or found[-1])
    assert None not in list(steps_that_agree(swaying(e, mu), mbvi.StewartTrinkle(), 200))
    assert sum(removes for _, removes in found) >= 50


def test_contacts_deep_or_without_a_row_at_the_end_of_a_step_are_left_to_python():
    s, gap = arguments_of_call(9, "lower_to_the_end", swaying(0.0, 0.6), mbvi.StewartTrinkle())
    s.ahead.size[0], deep = 0, stewart_trinkle.RETRY_DEPTH * s.scales.length
    copy_row(s.rows, 0, s.ahead)
    for depth in (0.9 * deep, 1.1 * deep):
        s.ahead.gap[0] = -depth
        assert lower_to_the_end(s, gap) == (depth < deep)
    assert gap[0] == -0.9 * deep
    s.ahead.gap[0], s.ahead.number[0] = 0.0, s.rows.number.max() + 1
    assert not lower_to_the_end(s, gap)


def test_the_loop_takes_steps_in_which_contacts_with_friction_bounce():
    problem, bounced = swaying(0.8, 0.6), 0
    for step in steps_that_agree(problem, SCHEMES[-1], 150):
        bounced += step is not None and bool((STEP * step.after[step.percussion > 0.0] > problem.tolerance).any())
    assert bounced >= 5


# relative difference of velocities of boxes whose contacts jam, from one start of the law and another
SPREAD = 1e-9
SEVERAL = [struck, two_hoppers, among_boxes, one_box, one_ball, small_heap, tumbling]


@each_scheme
@pytest.mark.parametrize("mu", [0.0, 0.6])
# at rest percussions of connected bodies are unique only but for what the connection bears, which is not compared
@pytest.mark.parametrize("scene", [*SEVERAL, carried, pile_of_six])
def test_a_step_of_several_bodies_is_that_of_the_scheme(scene, mu, scheme):
    share = share_that_agrees(scene(0.5, mu), scheme, 150, SPREAD)
    # Coal measures some pairs of hoppers
    assert share == 1.0 if scene is not two_hoppers else share > 0.9


@pytest.mark.parametrize("mu", [0.0, 0.6])
@pytest.mark.parametrize("scheme", [SCHEMES[-1], mbvi.StewartTrinkle()], ids=repr)
def test_a_step_of_many_balls_is_that_of_the_scheme(mu, scheme):
    scene = mbvi.Scene(restitution=0.3, friction=mu)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_box((0.4, 0.4, 0.1), 2.0, position=(0.2, 0.2, 0.05), name="box")
    for k in range(14):
        place = (0.21 * (k % 3) + 0.03 * (k // 9), 0.21 * (k // 3 % 3), 0.23 + 0.22 * (k // 9))
        scene.add_sphere(0.1, 0.5, position=place, velocity=(0.3, 0.1 * k, -0.5))
    assert share_that_agrees(scene.build(), scheme, 80, SPREAD) == 1.0


@pytest.mark.parametrize("mu", [0.0, 0.6])
@pytest.mark.parametrize("scene", SEVERAL)
def test_a_step_of_several_bodies_that_have_sunk_is_that_of_the_scheme(scene, mu):
    """Rows that join the law of free bodies act where it does, also those of spheres among each other."""
    steps = list(steps_that_agree(scene(0.0, mu), SCHEMES[-1], 150, 1e-6, SPREAD))
    assert np.mean([step is not None for step in steps]) > 0.9


@pytest.mark.parametrize(("scene", "e", "scheme"), [(struck, 0.0, 3), (one_box, 0.5, 0), (small_heap, 0.0, 3)])
def test_a_step_of_several_bodies_with_rolling_friction_is_that_of_the_scheme(scene, e, scheme):
    steps = [*steps_that_agree(scene(e, RESISTING), SCHEMES[scheme], 80, 1e-6, SPREAD)]
    assert np.mean([step is not None for step in steps]) > 0.9
    assert any(step.slip is not None and step.slip[0, :, 2:].any() for step in steps if step is not None)


@pytest.mark.slow
@each_scheme
@pytest.mark.parametrize("mu", [0.0, 0.6])
@pytest.mark.parametrize("scene", SEVERAL)
def test_a_step_of_several_bodies_that_come_to_rest_is_that_of_the_scheme(scene, mu, scheme):
    assert share_that_agrees(scene(0.0, mu), scheme, 250, SPREAD) > 0.9


def controlled_hoppers(controls):
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0, 0, 1), name="floor")
    for x, control in enumerate(controls):
        scene.add_urdf(ROBOTS / "hopper/hopper.urdf", position=(x, 0, 0.5), control=control, name=f"hopper {x}")
    scene.add_box((0.2, 0.2, 0.2), 1.0, position=(3, 0, 0.2), angular_velocity=(1, 0, 0))
    return scene.build()


def pull(t, q, v, tau):
    tau[6] = 3.0 * np.sin(20.0 * t) - 0.1 * v[6]
    tau[7] = -5.0 * q[8]


TRAJECTORY = mbvi.PDControl(
    [[0.0, 0.5], [0.4, 0.2], [0.1, 0.9]], [20.0, 30.0], 0.5, times=[0.0, 0.021, 0.06], limit=[4.0, 6.0]
)
PUSH = mbvi.PDControl([0.3, 0.6], 15.0, [0.2, 0.4], torque=[0.5, -0.5])
CONTROLS = {
    "the second": lambda: [None, TRAJECTORY],
    "the first, compiled": lambda: [mbvi.CompiledControl(pull, 9, 8), None],
    "two": lambda: [TRAJECTORY, PUSH],
    "three": lambda: [mbvi.ConstantTorque([1.0, -2.0]), TRAJECTORY, PUSH],
}


@each_scheme
@pytest.mark.parametrize("name", CONTROLS)
def test_robots_with_controls_move_as_by_the_python_step(name, scheme):
    assert share_that_agrees(controlled_hoppers(CONTROLS[name]()), scheme, 100) > 0.8


@pytest.mark.slow
@each_scheme
@pytest.mark.parametrize("name", OWN)
def test_a_thousand_steps_are_those_of_the_scheme(name, scheme):
    assert share_that_agrees(problem_of(name, "limits", 0.5), scheme, 1000) > 0.0


PUBLISHED = ["go2", "g1", "talos", "panda", "solo12", "anymal", "ur5"]


@built_once
def published(name):
    return problem_of("ur5", "fall", 0.0) if name == "ur5" else published_robot(name, 0.02)


@pytest.mark.slow
@each_scheme
@pytest.mark.parametrize("name", PUBLISHED)
def test_a_thousand_steps_of_a_published_robot_are_those_of_the_scheme(name, scheme):
    assert share_that_agrees(published(name), scheme, 1000) > 0.0


@pytest.mark.slow
@pytest.mark.parametrize("name", PUBLISHED)
def test_steps_of_a_published_robot_that_lands_are_those_of_stewart_trinkle(name):
    # where it lies on its hulls, a step of this scheme by Python takes up to seconds
    assert share_that_agrees(published(name), mbvi.StewartTrinkle(), 300) > 0.2


# whole runs


@pytest.mark.parametrize("every", [1, 7])
@pytest.mark.parametrize("mu", [0.0, 0.6])
@pytest.mark.parametrize("e", [0.0, 0.5])
@pytest.mark.parametrize("scene", [quadruped, hopper])
def test_a_run_has_the_bytes_of_the_python_step(scene, e, mu, every, loops, monkeypatch):
    problem = scene(e, mu)
    # the last step is shortened
    run = mbvi.simulate(copied(problem), mbvi.Paoli(), step=STEP, duration=0.1503, every=every, progress=False)
    assert loops[0] is not None
    assert loops[0].codes[0] > 0
    assert run.impacts
    same_bytes(run, by_python(monkeypatch, problem, mbvi.Paoli(), step=STEP, duration=0.1503, every=every))


@pytest.mark.parametrize("name", ["double_pendulum", "arm", "biped"])
def test_a_run_at_joint_limits_has_the_bytes_of_the_python_step(name, loops, monkeypatch):
    problem = problem_of(name, "limits", 0.5)
    run = mbvi.simulate(copied(problem), mbvi.Paoli(), step=STEP, duration=0.3, progress=False)
    assert loops[0].codes[0] > 0
    assert run.impacts or name == "double_pendulum"
    same_bytes(run, by_python(monkeypatch, problem, mbvi.Paoli(), step=STEP, duration=0.3))


@each_scheme
def test_a_run_of_any_scheme_is_close_to_that_of_the_python_step(scheme, monkeypatch):
    problem = quadruped(0.0, 0.0)
    run = mbvi.simulate(copied(problem), scheme, step=STEP, duration=0.1, progress=False)
    other = by_python(monkeypatch, problem, scheme, step=STEP, duration=0.1)
    np.testing.assert_allclose(run.q, other.q, rtol=0.0, atol=1e-11)
    np.testing.assert_allclose(run.v, other.v, rtol=0.0, atol=1e-9)
    assert [one.constraints for one in run.impacts] == [one.constraints for one in other.impacts]


@each_scheme
@pytest.mark.parametrize("mu", [0.0, 0.6])
@pytest.mark.parametrize("scene", SEVERAL)
def test_a_run_of_several_bodies_is_close_to_that_of_the_python_step(scene, mu, scheme, loops, monkeypatch):
    problem = scene(0.5, mu)
    run = mbvi.simulate(copied(problem), scheme, step=STEP, duration=0.15, progress=False)
    assert loops[0] is not None
    other = by_python(monkeypatch, problem, scheme, step=STEP, duration=0.15)
    np.testing.assert_allclose(run.q, other.q, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(run.v, other.v, rtol=0.0, atol=1e-7)
    # those that are linked take part in one impact
    assert [one.constraints for one in run.impacts] == [one.constraints for one in other.impacts]
    assert run.notes == other.notes


@pytest.mark.parametrize("scene", [among_boxes, one_box, one_ball])
def test_the_loop_takes_short_runs_of_bodies_with_a_robot_and_without(scene, loops, monkeypatch):
    problem, scheme = scene(0.0, 0.0), mbvi.Centered(project_positions=True)
    run = mbvi.simulate(copied(problem), scheme, step=STEP, duration=0.05, progress=False)
    assert loops[0].codes[0] > 0
    other = by_python(monkeypatch, problem, scheme, step=STEP, duration=0.05)
    np.testing.assert_allclose(run.q, other.q, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(run.v, other.v, rtol=0.0, atol=1e-11)


def test_bodies_at_rest_sleep_only_where_the_loop_leaves_steps_to_python(tmp_path, loops, monkeypatch):
    """Boxes at rest beside a robot that moves, and a box beside one with more rows than the loop has room for."""
    slept = []
    find = Sleepers._set
    monkeypatch.setattr(Sleepers, "_set", lambda self, islands: slept.append(len(islands)) or find(self, islands))
    run = mbvi.simulate(among_boxes(0.0, 0.6), mbvi.Paoli(), step=STEP, duration=0.4, progress=False)
    assert loops[0].codes[0] > 0
    assert not slept
    assert run.complete
    mbvi.simulate(sole(tmp_path, 51, stone=True), mbvi.Paoli(), step=STEP, duration=0.16, progress=False)
    assert loops[1].codes[1] > 0
    assert slept


# steps that are left to Python


def test_the_loop_measures_hulls_that_overlap(loops, monkeypatch):
    problem = on_block(0.0, 0.0)
    run = mbvi.simulate(copied(problem), mbvi.Paoli(), step=STEP, duration=0.2, progress=False)
    left, done = loops[0].codes[2], loops[0].codes[0]
    assert left == 0
    assert done > 0
    same_bytes(run, by_python(monkeypatch, problem, mbvi.Paoli(), step=STEP, duration=0.2))


def sole(tmp_path, count, stone=False):
    """A body of boxes, each of which stands on a floor with four corners; a stone may lie beside it, on two floors."""
    places = (f'<origin xyz="{0.1 * (k % 8)} {0.1 * (k // 8)} 0"/>' for k in range(count))
    boxes = "".join(
        f'<collision>{place}<geometry><box size="0.05 0.05 0.05"/></geometry></collision>' for place in places
    )
    inertia = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
    path = tmp_path / "sole.urdf"
    path.write_text(f'<robot name="sole"><link name="base">{inertia}{boxes}</link></robot>')
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(path, position=(0, 0, 0.03))
    if stone:
        scene.add_box((0.1, 0.1, 0.1), position=(3, 0, 0.05), name="stone")
        scene.add_halfspace((0, 0, 1), name="floor below")
    # all corners, also those between others
    return scene.build(reduce=("rest",))


@pytest.mark.parametrize("count", [100, 101])
def test_the_loop_goes_on_after_steps_with_too_many_rows(count, tmp_path, loops, monkeypatch):
    problem = sole(tmp_path, count)
    run = mbvi.simulate(copied(problem), mbvi.Paoli(), step=STEP, duration=0.1, progress=False)
    assert run.impacts
    assert (loops[0].codes[1] > 0) == (count > 100)
    same_bytes(run, by_python(monkeypatch, problem, mbvi.Paoli(), step=STEP, duration=0.1))


def moving(problem, speed):
    v0 = problem.v0.copy()
    v0[2] = speed
    return mbvi.Problem(
        problem.system, problem.constraints.constraints, problem.q0, v0, restitution=problem.restitution,
        length=problem.length, scene=problem.scene,
    )  # fmt: skip


@pytest.mark.parametrize("scheme", SCHEMES[:3], ids=repr)
def test_a_swift_body_passes_through_nothing(scheme, loops, monkeypatch):
    problem = moving(on_block(0.5, 0.0), -300.0)
    # in every step the loop is tried
    monkeypatch.setattr(compiled_loop, "_ATTEMPTS", 100)
    run = mbvi.simulate(copied(problem), scheme, step=STEP, duration=0.02, progress=False)
    assert loops[0].codes[5] > 0
    assert "would have passed through another" in run.notes[-1]
    other = by_python(monkeypatch, problem, scheme, step=STEP, duration=0.02)
    np.testing.assert_allclose(run.q, other.q, rtol=1e-9, atol=1e-9)
    assert run.notes == other.notes


@pytest.mark.parametrize("scheme", SCHEMES[:3], ids=repr)
@pytest.mark.parametrize("speed", [30.0, 300.0])
def test_a_swift_body_that_meets_nothing_stays_in_the_loop(scheme, speed, loops, monkeypatch):
    """It moves off by many times its thickness in a step."""
    problem = moving(on_block(0.5, 0.0), speed)
    run = mbvi.simulate(copied(problem), scheme, step=STEP, duration=0.02, progress=False)
    assert loops[0].codes[5] == 0
    other = by_python(monkeypatch, problem, scheme, step=STEP, duration=0.02)
    np.testing.assert_allclose(run.q, other.q, rtol=1e-12, atol=1e-12)
    assert run.notes == other.notes


def test_a_run_that_diverges_ends_with_the_same_error(monkeypatch):
    control = mbvi.PDControl(np.zeros(2), 1e9, 1e9)
    scene = mbvi.Scene()
    scene.add_urdf(
        ROBOTS / "double_pendulum/double_pendulum.urdf", base="fixed", control=control, velocity={"elbow": 1.0}
    )
    problem = scene.build()
    with pytest.raises(mbvi.MbviError) as found:
        mbvi.simulate(copied(problem), mbvi.Paoli(), step=STEP, duration=1.0, progress=False)
    with pytest.raises(type(found.value)) as expected:
        by_python(monkeypatch, problem, mbvi.Paoli(), step=STEP, duration=1.0)
    assert str(found.value) == str(expected.value)
    np.testing.assert_array_equal(found.value.run.q, expected.value.run.q)


def test_an_interrupted_run_keeps_what_was_done():
    problem = problem_of("double_pendulum", "fall", 0.5)

    def interrupt(*_):
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, interrupt)
    signal.setitimer(signal.ITIMER_REAL, 0.3)
    try:
        with pytest.raises(KeyboardInterrupt) as caught:
            mbvi.simulate(copied(problem), mbvi.Paoli(), step=1e-5, duration=100.0, every=100, progress=False)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    run = caught.value.run
    assert not run.complete
    assert len(run.t) > 10
    whole = mbvi.simulate(copied(problem), mbvi.Paoli(), step=1e-5, duration=run.t[-1], every=100, progress=False)
    np.testing.assert_array_equal(run.q[:10], whole.q[:10])


# notes, files and bars


def test_a_file_and_a_bar_are_those_of_the_run(tmp_path, monkeypatch, capsys):
    problem, path = quadruped(0.5, 0.6), tmp_path / "run.h5"
    run = mbvi.simulate(copied(problem), mbvi.Paoli(), step=STEP, duration=0.15, out=path, progress=True)
    assert "150/150" in capsys.readouterr().err
    same_bytes(run, by_python(monkeypatch, problem, mbvi.Paoli(), step=STEP, duration=0.15))
    loaded = mbvi.load(path)
    np.testing.assert_array_equal(loaded.q, run.q)
    assert loaded.notes == run.notes
    assert [one.time for one in loaded.impacts] == [one.time for one in run.impacts]


# where there is no loop


REFUSED = {
    "Schatzman and Paoli": (lambda: hopper(0.5, 0.0), mbvi.SchatzmanPaoli(), {}),
    "projected positions": (lambda: hopper(0.5, 0.0), mbvi.Paoli(project_positions=True), {}),
    "a chosen solver": (lambda: hopper(0.5, 0.0), mbvi.Paoli(), {"solver": mbvi.DualActiveSet()}),
}


@pytest.mark.parametrize("case", REFUSED)
def test_other_runs_go_by_the_python_step(case, loops):
    build, scheme, options = REFUSED[case]
    run = mbvi.simulate(build(), scheme, step=STEP, duration=0.2, progress=False, **options)
    assert loops == [None]
    assert run.complete
    assert run.impacts


def test_without_calls_by_address_the_run_is_the_same_and_says_so(loops, monkeypatch):
    problem = quadruped(0.5, 0.6)
    run = mbvi.simulate(copied(problem), mbvi.Paoli(), step=STEP, duration=0.15, progress=False)
    monkeypatch.setattr("mbvi.system.mechanisms.articulated.reason_for_bindings", lambda: "another library")
    other = mbvi.simulate(copied(problem), mbvi.Paoli(), step=STEP, duration=0.15, progress=False)
    assert loops[0] is not None
    assert loops[1] is None
    np.testing.assert_array_equal(run.q, other.q)
    np.testing.assert_array_equal(run.v, other.v)
    assert other.notes == (*run.notes, "Pinocchio was called through its Python bindings: another library")
