"""What is left out of a model changes nothing: each reduction on and off, or against a model that spells it out."""

import json

import numpy as np
import pytest

import mbvi
from mbvi.constraints import HalfSpaceContacts, SignedDistances
from mbvi.geometry.shapes.shapes import PlacedShape, Sphere
from mbvi.scene.saved.description import describe, restore
from mbvi.system import FreeBodies
from support.paths import ROBOTS, real_robot
from support.poses import places_of

HOPPER = ROBOTS / "hopper" / "hopper.urdf"
EVERY_SCHEME = (mbvi.Paoli(), mbvi.MoreauJean(), mbvi.Centered(), mbvi.SchatzmanPaoli(), mbvi.StewartTrinkle())


def same_motion(one, other, scheme, duration=0.4, tolerance=1e-10, **options):
    """Run two problems and compare where their shapes are, at every instant."""
    names = [s.name for s in one.scene.shapes if s.body]
    assert names
    runs = [mbvi.simulate(p, scheme, duration=duration, **options) for p in (one, other)]
    assert len(runs[0].t) == len(runs[1].t)
    for q, r in zip(runs[0].q, runs[1].q, strict=True):
        np.testing.assert_allclose(places_of(one, q, names), places_of(other, r, names), rtol=0, atol=tolerance)
    np.testing.assert_allclose(runs[0].energy(), runs[1].energy(), rtol=0, atol=100 * tolerance)
    return runs


# --- joints that never move


def hopper(text, tmp_path, e=0.5, **more):
    file = tmp_path / "hopper.urdf"
    file.write_text(text)
    scene = mbvi.Scene(restitution=e)
    scene.add_halfspace(normal=(0, 0, 1), name="floor")
    scene.add_urdf(file, position=(0, 0, 0.7), velocity=more.pop("velocity", {"hip": 2.0}), **more)
    return scene


def knee_fixed(text, angle):
    """The hopper's URDF with its knee welded at an angle."""
    start = text.index('<joint name="knee"')
    end = text.index("</joint>", start)
    knee = text[start:end].replace('type="revolute"', 'type="fixed"')
    assert knee.count("<origin") == 1 and "rpy" not in knee
    return text[:start] + knee.replace("<origin ", f'<origin rpy="0 {angle} 0" ') + text[end:]


def knee_without_range(text, angle):
    limits = 'lower="-0.1" upper="2.2"'
    assert limits in text
    return text.replace(limits, f'lower="{angle}" upper="{angle}"')


@pytest.mark.parametrize("scheme", EVERY_SCHEME, ids=lambda s: type(s).__name__)
def test_a_locked_joint_moves_as_a_fixed_one(scheme, tmp_path):
    text = HOPPER.read_text()
    e = 0.0 if isinstance(scheme, mbvi.StewartTrinkle) else 0.5
    locked = hopper(text, tmp_path, e, joints={"knee": 0.4}, locked=["knee"]).build()
    welded = hopper(knee_fixed(text, 0.4), tmp_path, e).build()
    assert locked.system.nv == welded.system.nv == 7
    assert "joint hopper/knee: locked, at 0.4; saves 1 degree of freedom, 2 rows" in locked.report()
    runs = same_motion(locked, welded, scheme, step=1e-3)
    assert runs[0].impacts


@pytest.mark.parametrize("scheme", EVERY_SCHEME, ids=lambda s: type(s).__name__)
def test_a_joint_without_range_moves_the_same_with_and_without(scheme, tmp_path):
    e = 0.0 if isinstance(scheme, mbvi.StewartTrinkle) else 0.5
    scene = hopper(knee_without_range(HOPPER.read_text(), 0.25), tmp_path, e)
    reduced, full = scene.build(), scene.build(reduce=())
    assert (reduced.system.nv, full.system.nv) == (7, 8)
    assert (
        "joint hopper/knee: its limits leave no range, at 0.25; saves 1 degree of freedom, 2 rows" in reduced.report()
    )
    assert "no range" not in full.report()
    # these two step otherwise where a constraint, here the full model's limits, is active: equal to their own order
    own = isinstance(scheme, mbvi.Centered | mbvi.SchatzmanPaoli)
    tolerance, duration = (1e-5, 0.2) if own else (1e-10, 0.4)
    same_motion(reduced, full, scheme, duration, tolerance, step=1e-3)


def test_a_joint_that_something_asks_for_stays(tmp_path):
    text = knee_without_range(HOPPER.read_text(), 0.25)
    # a control counts it, and a velocity is an impact of its limits
    for more in ({"control": lambda t, q, v: np.zeros(8)}, {"velocity": {"knee": 1.0}}):
        assert hopper(text, tmp_path, **more).build().system.nv == 8


def test_a_locked_joint_keeps_damping_files_and_replay(tmp_path):
    text = HOPPER.read_text().replace('<axis xyz="0 1 0"/>', '<axis xyz="0 1 0"/><dynamics damping="0.3"/>', 1)
    scene = hopper(text, tmp_path, joints={"knee": 0.4}, locked=["knee", "knee"])
    scene.add_urdf(HOPPER, position=(2, 0, 0.7), name="other")
    problem = scene.build()
    assert problem.system.parts[0].damping.tolist() == [0] * 6 + [0.3]
    run = mbvi.simulate(problem, mbvi.Paoli(), step=1e-3, duration=0.05)
    run.save(tmp_path / "run.h5")
    run.replay_html(tmp_path / "run.html")
    again = mbvi.load(tmp_path / "run.h5").problem
    assert again.report() == problem.report()
    np.testing.assert_array_equal(again.q0, problem.q0)
    names = [s.name for s in problem.scene.shapes]
    np.testing.assert_array_equal(places_of(again, run.q[-1], names), places_of(problem, run.q[-1], names))


def test_locks_that_cannot_be_are_refused(tmp_path):
    def add(**more):
        return hopper(HOPPER.read_text(), tmp_path, velocity={}, **more)

    for more, words in (
        ({"locked": ["elbow"]}, "no joint 'elbow' to lock; known are hip, knee"),
        ({"locked": ["knee"], "joints": {"knee": 3.0}}, "'knee' is locked at 3, outside its limits"),
        ({"locked": ["knee", "hip"], "base": "fixed"}, "all joints of hopper are locked"),
    ):
        with pytest.raises(mbvi.InputError, match=words):
            add(**more)
    with pytest.raises(mbvi.InputError, match="'hip' is locked and cannot have a velocity"):
        hopper(HOPPER.read_text(), tmp_path, locked=["hip"])
    with pytest.raises(mbvi.InputError, match="unknown reduction 'joint'; known are joints, "):
        add().build(reduce=["joint"])


# --- pairs that can never meet

ARMS = {
    "arm": (ROBOTS / "arm" / "arm.urdf", "fixed", 25),
    "biped": (ROBOTS / "biped" / "biped.urdf", "free", 80),
    "hopper": (HOPPER, "free", 4),
    "panda": ("panda_description/urdf/panda.urdf", "fixed", 25),
    "ur5": ("ur_description/urdf/ur5_robot.urdf", "fixed", 5),
}


def robot_scene(name):
    file, base, _ = ARMS[name]
    scene = mbvi.Scene(restitution=0.5)
    path = real_robot(file) if isinstance(file, str) else file
    if base == "fixed":
        scene.add_halfspace((0, 0, 1), -2.0 if name == "ur5" else -0.01, name="floor")
        scene.add_halfspace((1, 0, 0.3), -0.5, name="wall")
        scene.add_box((0.3, 0.3, 0.3), position=(0, 0, 4), fixed=True)
    scene.add_urdf(path, base=base, name=name, position=(0, 0, 0))
    return scene


def bounds_of(problem):
    """Pairs that are left out because they are always apart, and by how much at least."""
    kept = [one for one in problem.scene.omitted if one.why.startswith("always apart")]
    return {one.what.removeprefix("pair "): float(one.why.split("by ")[1].split(" m")[0]) for one in kept}


def gaps_by_name(problem, q):
    gaps = {}
    for constraint in problem.constraints.constraints:
        if hasattr(constraint, "nearest"):
            for name, gap in zip(constraint.names, constraint.gap(0.0, q), strict=True):
                # a half-space comes second in its names
                gaps[name] = gap
                gaps[" | ".join(reversed(name.split(" | ")))] = gap
    return gaps


@pytest.mark.parametrize("name", ARMS)
@pytest.mark.filterwarnings("ignore")
def test_pairs_left_out_keep_their_distance_within_the_limits(name, rng):
    scene = robot_scene(name)
    full, reduced = scene.build(reduce=()), scene.build(mbvi.REDUCTIONS)
    bounds, model = bounds_of(reduced), full.system.model
    assert len(bounds) >= ARMS[name][2] and all(bound > 0.0 for bound in bounds.values())
    # nothing is lost on the way: what is not asked is named
    assert len(full.constraints) - len(reduced.constraints) == len(bounds)
    joints = [j for j in range(1, model.njoints) if model.nvs[j] == 1]
    least = dict.fromkeys(bounds, np.inf)
    # what the ranges of joints that slide are widened by
    slide = 0.05 * float(np.median([s.shape.bound for s in full.scene.shapes if s.body]))
    for k in range(150):
        q = full.q0.copy()
        for j in joints:
            i = model.idx_qs[j]
            low, high = model.lowerPositionLimit[i], model.upperPositionLimit[i]
            widen = 0.05 if "R" in model.joints[j].shortname().removeprefix("JointModel")[0] else slide
            # every other at the very ends, where two things are nearest as a rule
            x = rng.random() if k % 2 else rng.integers(2)
            q[i] = low - widen + x * (high - low + 2 * widen)
        gaps = gaps_by_name(full, q)
        for pair in bounds:
            least[pair] = min(least[pair], gaps[pair])
    # Coal's own precision
    assert all(least[pair] >= bound - 1e-6 for pair, bound in bounds.items())


CHAIN = """<robot name="chain">
  <link name="base"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><origin xyz="0 -1 0"/><geometry><sphere radius="0.1"/></geometry></collision></link>
  <link name="crank"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
  </link>
  <link name="ball"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><geometry><sphere radius="0.1"/></geometry></collision></link>
  <joint name="turn" type="revolute"><parent link="base"/><child link="crank"/><axis xyz="0 0 1"/>
    <limit lower="{lower}" upper="0.5" effort="1" velocity="1"/></joint>
  <joint name="slide" type="prismatic"><parent link="crank"/><child link="ball"/><origin xyz="1 0 0"/>
    <axis xyz="1 0 0"/><limit lower="0" upper="0.01" effort="1" velocity="1"/></joint>
</robot>"""


@pytest.mark.parametrize("base", ["fixed", "free"])
def test_a_pair_that_can_just_meet_is_kept(base, tmp_path):
    # two balls on a circle meet at this angle; limits are held to 0.05 rad
    meet = 2 * np.arcsin(0.1)
    for lower, bounded in ((meet - 0.01, 0), (meet + 0.045, 0), (meet + 0.06, 1)):
        (tmp_path / "chain.urdf").write_text(CHAIN.format(lower=lower - np.pi / 2))
        scene = mbvi.Scene()
        scene.add_urdf(tmp_path / "chain.urdf", base=base)
        problem = scene.build(["pairs"])
        assert len(bounds_of(problem)) == bounded
        if bounded:
            # at the widened limits
            nearest = 2 * np.sin(0.5 * (lower - 0.05)) - 0.2
            (bound,) = bounds_of(problem).values()
            assert 0.2 * nearest < bound < nearest


def test_a_robot_moves_the_same_without_pairs_that_never_meet():
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0, 0, 1), -0.01, name="floor")
    scene.add_urdf(ROBOTS / "arm" / "arm.urdf", base="fixed")
    scene.add_sphere(0.05, 2.0, position=(0.45, 0.05, 0.9), velocity=(0, 0, -3))
    problems = [scene.build(reduce=reduce) for reduce in (["pairs"], [])]
    assert len(problems[0].constraints) < len(problems[1].constraints)
    runs = [mbvi.simulate(p, mbvi.Paoli(), step=1e-3, duration=0.5) for p in problems]
    assert runs[0].impacts
    np.testing.assert_allclose(runs[0].q, runs[1].q, rtol=0, atol=1e-12)
    np.testing.assert_allclose(runs[0].v, runs[1].v, rtol=0, atol=1e-10)


# --- rotations of spheres


def test_spheres_move_as_bodies_that_turn():
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0.1, 0, 1), name="floor")
    places, speeds = [(0, 0, 0.5), (1, 0, 0.3)], [(0.3, 0.2, -1), (0, 0, 0)]
    scene.add_spheres(places, 0.1, [1.0, 2.0], velocities=speeds)
    reduced = scene.build()
    assert "rotation of 2 spheres: no friction can turn them; saves 6 degrees of freedom" in reduced.report()
    ball, masses = Sphere(0.1), np.array([1.0, 2.0])
    system = FreeBodies(masses, np.array([ball.inertia(m) for m in masses]), np.array([0, 0, -9.81]), ("a", "b"))
    shapes = [PlacedShape(name, ball, k, np.eye(3), np.zeros(3)) for k, name in ((1, "a"), (2, "b"))]
    floor = HalfSpaceContacts(system, [scene._items.walls["floor"]] * 2, shapes, ("a", "b"), np.full(2, 0.5))
    q0 = np.concatenate([[*place, 0, 0, 0, 1] for place in places])
    v0 = np.concatenate([[*speed, 0, 0, 0] for speed in speeds])
    full = mbvi.Problem(system, [floor], q0, v0, length=0.1)
    runs = [mbvi.simulate(p, mbvi.Paoli(), step=1e-3, duration=0.5) for p in (reduced, full)]
    assert len(runs[0].impacts) >= 2
    centres = runs[0].q.reshape(-1, 2, 3), runs[1].q.reshape(-1, 2, 7)[:, :, :3]
    np.testing.assert_allclose(*centres, rtol=0, atol=1e-12)


# --- bodies at rest


def tower_and_ball(e):
    """Boxes that stand on each other until a ball comes."""
    scene = mbvi.Scene(restitution=e)
    scene.add_halfspace((0, 0, 1), name="floor")
    c, s = np.cos(0.3), np.sin(0.3)
    for k in range(3):
        turn = [[c, -s, 0], [s, c, 0], [0, 0, 1]]
        scene.add_box((0.2, 0.2, 0.1), position=(0.01 * (k % 2), 0.02 * k, 0.05 + 0.1 * k), rotation=turn)
    scene.add_sphere(0.05, 1.0, (1.0, 0.05, 0.26), (-6.0, 0, 1))
    return scene


# the compiled loop measures what stands still, too
@pytest.mark.usefixtures("python_steps")
@pytest.mark.parametrize("scheme", EVERY_SCHEME, ids=lambda s: type(s).__name__)
def test_what_stands_still_is_measured_once_and_moves_the_same(scheme, monkeypatch):
    scene = tower_and_ball(0.0 if isinstance(scheme, mbvi.StewartTrinkle) else 0.3)
    asked, measure = [0], SignedDistances._measure

    def counted(self, places, pairs, *arguments):
        asked[0] += len(pairs)
        return measure(self, places, pairs, *arguments)

    monkeypatch.setattr(SignedDistances, "_measure", counted)
    runs, counts = [], []
    for reduce in (["rest"], []):
        asked[0] = 0
        runs.append(mbvi.simulate(scene.build(reduce), scheme, step=1e-3, duration=0.12))
        counts.append(asked[0])
        runs.append(mbvi.simulate(scene.build(reduce), scheme, step=1e-3, duration=0.2))
    assert not runs[0].impacts and runs[1].impacts
    # two contacts a step, and hardly one where noise now and then adds up to more than rounding; these two keep moving
    own = isinstance(scheme, mbvi.SchatzmanPaoli | mbvi.StewartTrinkle)
    assert counts[1] > 200 and (own or counts[0] < counts[1] / 5)
    for kept, asked_again in zip(runs[:2], runs[2:], strict=True):
        np.testing.assert_allclose(kept.q, asked_again.q, rtol=0, atol=1e-10)


def test_what_is_kept_at_rest_does_not_show_in_later_runs():
    problem = tower_and_ball(0.3).build()
    first, second = (mbvi.simulate(problem, mbvi.Paoli(), step=1e-3, duration=0.2) for _ in range(2))
    fresh = mbvi.simulate(tower_and_ball(0.3).build(), mbvi.Paoli(), step=1e-3, duration=0.2)
    for later in (second, fresh):
        np.testing.assert_allclose(later.q, first.q, rtol=0, atol=1e-14)


def test_files_without_reductions_come_back_whole(tmp_path):
    problem = hopper(knee_without_range(HOPPER.read_text(), 0.25), tmp_path).build()
    assert (problem.system.nv, restore(describe(problem)).system.nv) == (7, 7)
    text = json.loads(describe(problem))
    del text["reduce"]
    assert restore(json.dumps(text)).system.nv == 8
