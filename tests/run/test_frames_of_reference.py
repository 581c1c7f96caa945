"""Neither a motion nor which impacts a run records depends on the velocity of the frame in which the scene is seen."""

from functools import partial

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbvi
from mbvi.constraints.carried import Place, carried, with_mean_rates
from mbvi.run.fixed_steps import taking
from support.paths import ROBOTS

pytestmark = pytest.mark.filterwarnings("ignore::mbvi.MbviWarning")
STEP, DURATION = 5e-3, 0.3
SCHEMES = {
    "Paoli": mbvi.Paoli(),
    "MoreauJean": mbvi.MoreauJean(),
    "SchatzmanPaoli": mbvi.SchatzmanPaoli(),
    "Centered": mbvi.Centered(),
    "Centered, projected": mbvi.Centered(project_positions=True),
    "StewartTrinkle": mbvi.StewartTrinkle(),
}


def tower(velocity, e, seed, floor=False, friction=0.0):
    """Return a ball, a box and a capsule, one above the other, whose percussions are unique.

    Without a floor they fly towards each other. With one they fall, and both floor and bodies have the velocity. The
    floor has no motion where no velocity is given.
    """
    motion = None if velocity is None else mbvi.motion.Translation(velocity)
    velocity = velocity or (0.0, 0.0, 0.0)
    rng = np.random.default_rng(seed)
    scene = mbvi.Scene(gravity=(0, 0, -9.81 if floor else 0.0), restitution=e, friction=friction)
    if floor:
        scene.add_halfspace((0, 0, 1), name="floor", motion=motion)
    adds = (
        partial(scene.add_sphere, 0.05), partial(scene.add_box, (0.2, 0.16, 0.1)), partial(scene.add_capsule, 0.04, 0.1)
    )  # fmt: skip
    for k, add in enumerate(adds):
        place, own = (*rng.uniform(-0.01, 0.01, 2), 0.07 + 0.13 * k), np.asarray(velocity) - [0, 0, 0.8 * k]
        turn = Rotation.from_rotvec(rng.uniform(-0.3, 0.3, 3) + 0.5 * np.pi * (k == 2) * np.eye(3)[1]).as_matrix()
        spin = {} if k == 0 else {"rotation": turn, "angular_velocity": rng.uniform(-1.0, 1.0, 3)}
        add(rng.uniform(0.5, 2.0), position=place, velocity=own, **spin)
    return scene.build()


def run_of(problem, scheme):
    return mbvi.simulate(problem, scheme, step=STEP, duration=DURATION, progress=False)


def by_constraint(impact):
    """Return percussions and rates before and after of an impact, and its points, in the order of names and points."""
    values = np.column_stack([impact.percussion, impact.before, impact.after])
    order = sorted(range(len(values)), key=lambda k: (impact.constraints[k], *values[k].round(6)))
    return [impact.constraints[k] for k in order], values[order]


def same_impacts(runs):
    """Assert that runs have the same impacts."""
    run, *others = runs
    assert len(run.impacts) > 1
    for other in others:
        times = [one.time for one in run.impacts]
        assert len(other.impacts) == len(times)
        np.testing.assert_allclose([one.time for one in other.impacts], times, rtol=0.0, atol=1e-12)
        for one, two in zip(run.impacts, other.impacts, strict=True):
            (names, values), (expected, known) = by_constraint(two), by_constraint(one)
            assert names == expected
            np.testing.assert_allclose(values, known, rtol=0.0, atol=1e-8)


VELOCITIES = [None, (0.0, 0.0, 0.0), (4.0, 0.0, 0.0), (0.0, -3.0, 0.5), (2.0, 2.0, -2.0)]


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("floor", [False, True])
@pytest.mark.parametrize("name", SCHEMES)
def test_scenes_that_move_as_a_whole_have_the_impacts_of_those_at_rest(name, floor, seed):
    same_impacts([run_of(tower(v, 0.3 * (seed % 2), seed, floor), SCHEMES[name]) for v in VELOCITIES])


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("floor", [False, True])
@pytest.mark.parametrize(
    ("name", "friction"), [(one, mu) for one in SCHEMES for mu in (0.0, 0.3) if mu == 0.0 or one != "SchatzmanPaoli"]
)
def test_scenes_that_move_as_a_whole_move_as_those_at_rest(name, floor, seed, friction):
    places = []
    for velocity in VELOCITIES:
        run = run_of(
            tower(velocity, 0.3 * (seed % 2) if friction == 0.0 else 0.0, seed, floor, friction), SCHEMES[name]
        )
        # centres of the box, the capsule and the ball
        centres = np.stack([run.q[:, k : k + 3] for k in (0, 7, 14)], axis=1)
        places.append(centres - np.outer(run.t, velocity or np.zeros(3))[:, None])
    for place in places[1:]:
        np.testing.assert_allclose(place, places[0], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("ground", ["fields", "boxes"])
@pytest.mark.parametrize("name", SCHEMES)
def test_a_box_slides_from_one_ground_onto_the_next_also_where_both_move(name, ground):
    places = []
    for velocity in [(0.0, 0.0, 0.0), (0.0, 0.0, 0.2), (0.4, -0.3, 0.2)]:
        scene, motion = mbvi.Scene(), mbvi.motion.Translation(velocity)
        if ground == "fields":
            scene.add_heightfield(np.zeros((3, 3)), size=(2.0, 1.75), position=(0.375, 0.0, 0.0), motion=motion)
        else:
            scene.add_box((2.0, 1.75, 0.1), position=(0.375, 0.0, -0.05), motion=motion)
        scene.add_heightfield(np.zeros((3, 3)), size=(1.0, 1.75), position=(-1.125, 0.0, 0.0), motion=motion)
        turn, own = Rotation.from_euler("z", 0.3).as_matrix(), np.array([-1.9, 0.5, 0.0]) + velocity
        scene.add_box((0.2, 0.3, 0.1), position=(0.02, 0.01, 0.05), rotation=turn, mass=1.0, velocity=own)
        run = mbvi.simulate(scene.build(), SCHEMES[name], step=2e-3, duration=0.4, progress=False)
        assert not run.impacts
        places.append(run.q[:, :3] - np.outer(run.t, velocity))
    # the box has passed the rim
    assert places[0][-1, 0] < -0.7
    for place in places[1:]:
        np.testing.assert_allclose(place, places[0], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("floor", [False, True])
@pytest.mark.parametrize("name", [name for name in SCHEMES if name != "SchatzmanPaoli"])
def test_the_same_with_friction(name, floor, seed):
    same_impacts([run_of(tower(v, 0.0, seed, floor, friction=0.3), SCHEMES[name]) for v in VELOCITIES])


@pytest.mark.parametrize("name", ["Paoli", "Centered, projected"])
def test_the_loop_and_steps_of_python_record_the_same_where_few_states_are_kept(name):
    """The loop keeps the states between recorded ones for its impacts alone."""
    for velocity in VELOCITIES[1:3]:
        problem, scheme = tower(velocity, 0.0, 1), SCHEMES[name]
        runs = [
            mbvi.simulate(problem, scheme, step=STEP, duration=DURATION, every=every, progress=False)
            for every in (1, 7)
        ]
        with pytest.MonkeyPatch.context() as patched:
            patched.setattr(taking, "compiled_loop", lambda *_: None)
            runs.append(run_of(problem, scheme))
        same_impacts(runs)


def listed(contacts):
    """Return names and percussions of contacts, in their order."""
    return sorted((one.name, round(float(one.percussion), 5)) for one in contacts)


@pytest.mark.parametrize("name", ["Paoli", "Centered, projected", "Adaptive", "Simulator"])
def test_contacts_that_last_are_the_same_between_recorded_states(name):
    """Those of two boxes, one upon the other, which a floor carries on by more than their size."""
    found = []
    for speed in (0.0, 4.0, 40.0):
        scene, velocity = mbvi.Scene(friction=0.3), (speed, 0.0, 0.0)
        scene.add_halfspace((0, 0, 1), name="floor", motion=mbvi.motion.Translation(velocity))
        for size, place in [((0.2, 0.2, 0.1), (0, 0, 0.05)), ((0.16, 0.16, 0.1), (0.01, 0, 0.15))]:
            scene.add_box(size, mass=1.0, position=place, velocity=velocity)
        problem = scene.build()
        if name == "Simulator":
            simulator = mbvi.Simulator(problem, mbvi.Adaptive(1e-4), step=0.1)
            simulator.step(3)
            found.append([listed(simulator.contacts)])
            continue
        scheme, steps = (mbvi.Adaptive(1e-4), {"every": 5}) if name == "Adaptive" else (SCHEMES[name], {"every": 100})
        steps |= {} if name == "Adaptive" else {"step": 1e-3}
        run = mbvi.simulate(problem, scheme, duration=0.4, record="contacts", progress=False, **steps)
        found.append([listed(run.contacts(t)) for t in run.t[1:]])
    assert all(len(one) == 8 for one in found[0])
    for other in found[1:]:
        for one, two in zip(other, found[0], strict=True):
            assert [name for name, _ in one] == [name for name, _ in two]
            np.testing.assert_allclose([p for _, p in one], [p for _, p in two], atol=1e-3)


def test_contacts_of_a_load_on_a_plate_that_slides_are_the_same_between_recorded_states():
    """The compiled loop takes the steps; the plate slides on a floor at rest by more than its size."""
    scene = mbvi.Scene(friction=0.3)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_box((0.2, 0.2, 0.1), mass=1.0, position=(0, 0, 0.05), velocity=(4.0, 0, 0), name="plate")
    scene.add_box((0.16, 0.16, 0.1), mass=1.0, position=(0.01, 0, 0.15), velocity=(4.0, 0, 0), name="load")
    scene.set_friction("plate", "floor", 0.0)
    run = mbvi.simulate(
        scene.build(), mbvi.Paoli(), step=1e-3, duration=0.4, record="contacts", every=100, progress=False
    )
    np.testing.assert_allclose(run.q[-1, [0, 7]], [1.6, 1.61], atol=1e-6)
    for t in run.t[1:]:
        assert [one.name for one in run.contacts(t)].count("plate | floor") == 4
        assert len(run.contacts(t)) == 8


class Turntable:
    """A motion that turns about the vertical and rises."""

    def pose(self, t):
        return Rotation.from_rotvec((0.0, 0.0, 2.0 * t)).as_matrix(), np.array([0.1, 0.2, 0.3]) * t

    def twist(self, t):
        place, velocity, spin = self.pose(t)[1], np.array([0.1, 0.2, 0.3]), np.array([0.0, 0.0, 2.0])
        return velocity - np.cross(spin, place), spin


def test_points_are_carried_as_their_bodies_move():
    """Each body keeps the coordinates of a point in its own axes, also a wall with a prescribed motion."""
    rng, scene = np.random.default_rng(0), mbvi.Scene()
    scene.add_halfspace((0, 0, 1), name="table", motion=Turntable())
    scene.add_halfspace((0, 0, 1), offset=-1.0, name="floor")
    for k in range(2):
        scene.add_box((0.2, 0.2, 0.1), position=(0.1, 0.0, 0.2 + 0.2 * k), name=f"box {k}")
    problem = scene.build()

    def drawn(t):
        """Return a place, and of each name the rotation and the origin there."""
        q = np.empty((2, 7))
        q[:, :3], q[:, 3:] = rng.normal(size=(2, 3)), Rotation.random(2, rng).as_quat()
        poses = {f"box {k}": (Rotation.from_quat(q[k, 3:]).as_matrix(), q[k, :3]) for k in range(2)}
        return Place(t, q.ravel()), poses | {"floor": (np.eye(3), np.zeros(3)), "table": Turntable().pose(t)}

    (before, old), (after, new) = drawn(0.3), drawn(0.7)
    numbers = np.arange(len(problem.constraints))
    point = rng.normal(size=(len(numbers), 3))
    found, seen = carried(problem.constraints, numbers, point, before, after), set()
    for k in numbers:
        sides = problem.constraints.name(k).split(" | ")
        expected = [new[s][0] @ old[s][0].T @ (point[k] - old[s][1]) + new[s][1] for s in sides]
        # a wall is the first body of its pairs, and the second in their names
        np.testing.assert_allclose(sorted(found[:, k].tolist()), sorted(np.array(expected).tolist()), atol=1e-13)
        seen.update(sides)
    assert seen == set(old)


def test_walls_have_their_mean_velocities_in_a_step():
    scene, h = mbvi.Scene(friction=(0.3, 0.01, 0.01)), 1e-3
    scene.add_halfspace((0, 0, 1), name="table", motion=Turntable())
    scene.add_sphere(0.1, position=(0.4, 0.3, 0.1))
    problem = scene.build()
    rows = problem.constraints.active(0.0, problem.q0, 0.01)
    found = with_mean_rates(problem.constraints, rows, 0.0, problem.q0, h)
    turn, place = Turntable().pose(h)
    mean = (turn @ rows.point[0] + place - rows.point[0]) / h
    axes = np.concatenate([rows.normal, rows.tangents.axes[0]])
    # angles vanish to second order
    np.testing.assert_allclose(found.rate, -axes[0] @ mean, atol=1e-6)
    np.testing.assert_allclose(found.tangents.rate, [*-axes[1:] @ mean, *-axes @ [0.0, 0.0, 2.0]], atol=1e-6)
    assert np.abs(rows.tangents.rate - found.tangents.rate).max() > 1e-4


@pytest.mark.parametrize("name", ["Centered", "Centered, projected"])
def test_a_robot_on_a_floor_that_moves_has_the_impacts_of_one_at_rest(name):
    """Its base turns about the velocity of the floor alone: the retraction of others depends on the frame."""
    runs = []
    for speed in (0.0, -3.0, 60.0):
        scene, rotation = mbvi.Scene(friction=0.3), Rotation.from_rotvec((0.0, 0.2, 0.0)).as_matrix()
        scene.add_halfspace((0, 0, 1), name="floor", motion=mbvi.motion.Translation((0.0, speed, 0.0)))
        own = (0.3, speed, -1.0, 0.0, 1.0, 0.0)
        scene.add_urdf(
            ROBOTS / "hopper/hopper.urdf", base="free", position=(0, 0, 0.75), rotation=rotation, base_velocity=own
        )
        runs.append(mbvi.simulate(scene.build(), SCHEMES[name], step=2e-3, duration=0.6, progress=False))
        np.testing.assert_allclose(
            runs[-1].q[:, :3] - np.outer(runs[-1].t, [0.0, speed, 0.0]), runs[0].q[:, :3], atol=1e-9
        )
    # percussions of two edges of a foot are not unique
    listed = [[(round(one.time, 9), sorted(one.constraints)) for one in run.impacts] for run in runs]
    assert len(listed[0]) > 2
    assert listed[1] == listed[2] == listed[0]


def test_points_are_carried_by_links():
    """A robot that moves as one rigid body carries points on any link as that body."""
    rng, scene = np.random.default_rng(1), mbvi.Scene()
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(ROBOTS / "hopper/hopper.urdf", position=(0, 0, 1), joints={"knee": 0.4}, name="hopper")
    problem = scene.build()
    numbers = np.arange(problem.constraints.limits, len(problem.constraints))
    point, old, new = rng.normal(size=(len(numbers), 3)), problem.q0.copy(), problem.q0.copy()
    for q in (old, new):
        q[:3], q[3:7] = rng.normal(size=3), Rotation.random(1, rng).as_quat()[0]
    turn, back = (Rotation.from_quat(q[3:7]).as_matrix() for q in (new, old))
    expected = (point - old[:3]) @ back @ turn.T + new[:3]
    found = carried(problem.constraints, numbers, point, Place(0.0, old), Place(0.0, new))
    kinds = set()
    for k, name in enumerate(map(problem.constraints.name, numbers)):
        on_floor = name.endswith("| floor")
        other = point[k] if on_floor else expected[k]
        both = sorted([other.tolist(), expected[k].tolist()])
        np.testing.assert_allclose(sorted(found[:, k].tolist()), both, atol=1e-12)
        kinds.add(on_floor)
    assert kinds == {True, False}
