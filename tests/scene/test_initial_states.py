"""How a scene starts: rotations in every form, the velocity of a free base, and one problem from many states."""

import cProfile
import itertools
import pstats
from functools import partial

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import mbvi
from support.paths import ROBOTS

QUADRUPED, HOPPER = ROBOTS / "quadruped/quadruped.urdf", ROBOTS / "hopper/hopper.urdf"
MESH = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]), np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
BOX = """<robot name="brick"><link name="brick">
<inertial><mass value="{m}"/><origin xyz="{c}"/>
<inertia ixx="{i[0]}" iyy="{i[1]}" izz="{i[2]}" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><origin xyz="{c}"/><geometry><box size="0.1 0.2 0.3"/></geometry></collision></link></robot>"""

# what turns a rotation into what a user may give
FORMS = {
    "matrix": lambda turn: turn.as_matrix(),
    "nested lists": lambda turn: turn.as_matrix().tolist(),
    "quaternion": lambda turn: turn.as_quat(),
    "other quaternion": lambda turn: (-turn.as_quat()).tolist(),
    "roll, pitch, yaw": lambda turn: turn.as_euler("xyz"),
    "scipy": lambda turn: turn,
}
turns = st.builds(
    lambda *parts: Rotation.from_rotvec(np.array(parts)), *[st.floats(-1.5, 1.5, allow_subnormal=False)] * 3
)
seeds = st.integers(0, 2**32 - 1)


def brick(folder, centre=(0, 0, 0)):
    """A URDF of one link: a homogeneous box of 2 kg about a point of its frame."""
    moments = 2.0 / 12.0 * np.array([0.2**2 + 0.3**2, 0.1**2 + 0.3**2, 0.1**2 + 0.2**2])
    path = folder / "brick.urdf"
    path.write_text(BOX.format(m=2.0, i=moments.tolist(), c=" ".join(map(str, centre))))
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("urdf")


@given(turns)
def test_every_form_of_a_rotation_is_the_same_rotation(folder, turn):
    for form in FORMS.values():
        rotation = form(turn)
        scene = mbvi.Scene()
        scene.add_urdf(brick(folder), rotation=rotation)
        for k, add in enumerate((scene.add_capsule, scene.add_cylinder)):
            add(0.1, 0.3, rotation=rotation, position=(5 * (k + 1), 0, 0))
        scene.add_box((1, 1, 1), rotation=rotation, position=(-5, 0, 0))
        scene.add_boxes([(0, 5, 0), (0, 9, 0)], (1, 1, 1), 1.0, rotations=rotation)
        scene.add_convex(MESH[0], [(0, -5, 0), (0, -9, 0)], 1.0, rotations=rotation)
        scene.add_surface(*MESH, rotation=rotation, position=(0, 0, -9), name="sheet")
        items = scene._items
        found = [items.robots[0].rotation, items.surfaces[0].rotation, *(b.rotation for b in items.bodies)]
        assert len(found) == 9
        for matrix in found:
            np.testing.assert_allclose(matrix, turn.as_matrix(), atol=1e-12)


@given(st.integers(1, 6), seeds)
def test_many_rotations_are_taken_one_each(count, seed):
    given_turns = Rotation.random(count, random_state=seed)
    places = 5.0 * np.arange(count)[:, None] * np.ones(3)
    for rotations in (given_turns, given_turns.as_quat(), given_turns.as_matrix(), given_turns.as_quat().tolist()):
        scene = mbvi.Scene()
        scene.add_boxes(places, (1, 1, 1), 1.0, rotations=rotations)
        found = np.array([body.rotation for body in scene._items.bodies])
        np.testing.assert_allclose(found, given_turns.as_matrix(), atol=1e-12)


@given(st.lists(st.floats(-10, 10), min_size=3, max_size=3))
def test_angles_are_those_of_a_urdf(angles):
    scene = mbvi.Scene()
    scene.add_box((1, 1, 1), rotation=angles)
    np.testing.assert_allclose(scene._items.bodies[0].rotation, pin.rpy.rpyToMatrix(*angles), atol=1e-12)


@given(turns, st.floats(-3e-6, 3e-6))
def test_a_quaternion_is_of_unit_length_within_rounding_and_its_norm_is_said(turn, off):
    rotation = (1.0 + off) * turn.as_quat()
    scene = mbvi.Scene()
    if abs(off) < 0.99e-6:
        scene.add_box((1, 1, 1), rotation=rotation)
        np.testing.assert_allclose(scene._items.bodies[0].rotation, turn.as_matrix(), atol=1e-12)
    elif abs(off) > 1.01e-6:
        with pytest.raises(mbvi.InputError, match=r"rotation: .*norm 1.* got (1|0\.99999)"):
            scene.add_box((1, 1, 1), rotation=rotation)


@pytest.mark.parametrize(
    ("rotation", "message"),
    [
        ((0, 0, 0, 2), "divide it by its norm; got 2"),
        ((0, 0, 0, 0), "got 0"),
        (Rotation.random(2, random_state=0), r"shape \(2, 3, 3\); it must be one rotation"),
        (Rotation.random(1, random_state=0), r"shape \(1, 3, 3\); it must be one rotation"),
        (Rotation, "gives no matrix"),
        ((0, 0), r"shape \(2,\)"),
        ((np.nan, 0, 0), "finite"),
        (np.eye(4), r"shape \(4, 4\)"),
        (-np.eye(3), "no rotation matrix"),
        ("upright", "numbers"),
        (None, "numbers"),
    ],
)
def test_what_is_no_rotation_is_refused(rotation, message):
    scene = mbvi.Scene()
    for add in (
        lambda: scene.add_box((1, 1, 1), rotation=rotation),
        lambda: scene.add_urdf(HOPPER, rotation=rotation),
        lambda: scene.add_surface(*MESH, rotation=rotation),
    ):
        with pytest.raises(mbvi.InputError, match=message):
            add()


def test_rows_of_angles_are_refused_for_many_bodies():
    # three of them would look like a matrix
    for count in (2, 3, 4):
        with pytest.raises(mbvi.InputError, match="rotation"):
            mbvi.Scene().add_boxes(np.eye(count, 3), (1, 1, 1), 1.0, rotations=np.full((count, 3), 0.3))


def root_pose(problem, q):
    """Where the link of a brick's frame is: shapes (3, 3) and (3,)."""
    place = problem.system.placements(q, np.array([1]))[0]
    return place[:3].T, place[3]


@given(turns, seeds)
def test_the_velocity_of_a_free_base_is_in_the_world_frame(folder, turn, seed):
    random = np.random.default_rng(seed)
    position, velocity = random.normal(size=3), random.normal(size=6)
    scene = mbvi.Scene(gravity=(0, 0, 0))
    scene.add_urdf(HOPPER, position=position, rotation=turn, base_velocity=velocity)
    problem = scene.build()
    h = 1e-5
    (R0, x0), (R1, x1) = (root_pose(problem, problem.system.integrate(problem.q0, s * problem.v0)) for s in (-h, h))
    np.testing.assert_allclose((x1 - x0) / (2 * h), velocity[:3], atol=1e-8)
    spin = Rotation.from_matrix(R1 @ R0.T).as_rotvec() / (2 * h)
    np.testing.assert_allclose(spin, velocity[3:], atol=1e-8)


@pytest.mark.parametrize("seed", range(4))
def test_a_brick_flies_as_a_box_of_the_same_inertia(folder, seed):
    """Its frame stands off its centre of mass, whose velocity is then another."""
    random = np.random.default_rng(seed)
    turn, centre = Rotation.random(random_state=seed), random.normal(size=3)
    position, velocity = random.normal(size=3) + np.array([0, 0, 9]), 2.0 * random.normal(size=6)
    robot, body = mbvi.Scene(), mbvi.Scene()
    robot.add_urdf(brick(folder, centre.tolist()), position=position, rotation=turn, base_velocity=velocity)
    arm = turn.apply(centre)
    body.add_box(
        (0.1, 0.2, 0.3), 2.0, position=position + arm, rotation=turn, angular_velocity=velocity[3:],
        velocity=velocity[:3] + np.cross(velocity[3:], arm),
    )  # fmt: skip
    scheme = mbvi.EventDriven(tolerance=1e-10)
    one, other = (mbvi.simulate(scene.build(), scheme, duration=1.0) for scene in (robot, body))
    for t in np.linspace(0.0, 1.0, 5):
        R, x = root_pose(one.problem, one.at(t)[0])
        q = other.at(t)[0]
        np.testing.assert_allclose(x + R @ centre, q[:3], atol=1e-7)
        np.testing.assert_allclose(R, Rotation.from_quat(q[3:]).as_matrix(), atol=1e-7)


def test_a_fixed_base_has_no_velocity():
    scene = mbvi.Scene()
    with pytest.raises(mbvi.InputError, match="base_velocity is that of a free base"):
        scene.add_urdf(HOPPER, base="fixed", base_velocity=(0, 0, 0, 0, 0, 1e-9))
    scene.add_urdf(HOPPER, base="fixed", base_velocity=np.zeros(6))
    for wrong in ((1, 2, 3), np.full(6, np.nan), "abcdef", None):
        with pytest.raises(mbvi.InputError, match="base_velocity"):
            mbvi.Scene().add_urdf(HOPPER, base_velocity=wrong)


@pytest.mark.parametrize("plane", ["xy", "xz", "yz"])
@pytest.mark.parametrize("reduce", [mbvi.REDUCTIONS, ()])
def test_the_velocity_of_a_planar_base(folder, plane, reduce):
    axes = np.eye(3)[["xyz".index(letter) for letter in plane]]
    normal = np.cross(*axes)
    random = np.random.default_rng(3)
    turn = Rotation.from_rotvec(0.7 * normal)
    velocity, rate = random.normal(size=2) @ axes, 1.3
    scene = mbvi.Scene(gravity=(0, 0, 0), plane=plane)
    scene.add_urdf(brick(folder), rotation=turn, base_velocity=[*velocity, *(rate * normal)])
    problem = scene.build(reduce)
    run = mbvi.simulate(problem, mbvi.EventDriven(tolerance=1e-10), duration=1.0)
    R, x = root_pose(problem, run.q[-1])
    np.testing.assert_allclose(x, velocity, atol=1e-7)
    start, _ = root_pose(problem, run.q[0])
    np.testing.assert_allclose(R @ start.T, Rotation.from_rotvec(rate * normal).as_matrix(), atol=1e-7)
    for out, message in (([*normal, 0, 0, 0], "velocity out of"), ([0, 0, 0, *axes[0]], "turns it out of")):
        bad = mbvi.Scene(plane=plane, gravity=(0, 0, 0))
        bad.add_urdf(brick(folder), base_velocity=out)
        with pytest.raises(mbvi.InputError, match=f"brick starts with .*{message}"):
            bad.build(reduce)


def quadruped():
    scene = mbvi.Scene(restitution=0.3)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(QUADRUPED, position=(0, 0, 0.6), base_velocity=(0.2, 0, 0, 0, 1, 0), locked=["FL_hip_joint"])
    scene.add_sphere(0.1, position=(0, 0, 1.1))
    return scene.build()


def grains(boxes, spheres, seed=4):
    """Boxes and spheres in a container, with a paddle that moves on its own."""
    random = np.random.default_rng(seed)
    scene = mbvi.Scene(restitution=0.2)
    scene.add_container((-0.5, -0.5, 0), (0.5, 0.5))
    scene.add_box((0.3, 0.3, 0.1), position=(0, 0, 0.05), motion=mbvi.motion.Oscillation((0, 0, 0.04), 2.0))
    layers = 1 + (boxes + spheres) // 16
    cells = np.array(list(itertools.product(range(layers), range(4), range(4))))[: boxes + spheres, ::-1]
    places = 0.22 * cells + [-0.33, -0.33, 0.3]
    turns = Rotation.random(boxes, random_state=seed)
    shape, spin = (0.1, 0.12, 0.08), random.normal(size=(boxes, 3))
    falls, flies = (random.normal(size=(n, 3)) - [0, 0, 2] for n in (boxes, spheres))
    scene.add_boxes(places[:boxes], shape, 1.0, rotations=turns, velocities=falls, angular_velocities=spin)
    scene.add_spheres(places[boxes:], 0.08, 1.0, velocities=flies)
    return scene.build()


def planar():
    scene = mbvi.Scene(plane="xz", restitution=0.4)
    scene.add_halfspace((0, 0, 1))
    scene.add_box((0.2, 0.2, 0.1), position=(0, 0, 0.3), angular_velocity=(0, 2, 0))
    scene.add_urdf(HOPPER, position=(1, 0, 0.8))
    scene.add_spheres([(0.05, 0, 0.6), (0.3, 0, 0.5)], 0.1, 1.0)
    return scene.build()


def oscillator():
    system = mbvi.LagrangianSystem(mass=lambda q: np.eye(2), force=lambda t, q, v: -q + [np.cos(3 * t), 0], dim=2)
    walls = [mbvi.GapFunction(lambda q: q[0], lambda q: np.array([1.0, 0])),
             mbvi.GapFunction(lambda q: 1 - q[1], lambda q: np.array([0, -1.0]))]  # fmt: skip
    return mbvi.Problem(system, walls, [1.0, 0.2], [0.0, 0.4], restitution=0.7)


# on both sides of the sizes at which constraints are found in other ways
PROBLEMS = {
    "quadruped": quadruped,
    "boxes": lambda: grains(9, 3),
    "spheres": lambda: grains(2, 40),
    "crowd": lambda: grains(64, 2),
    "planar": planar,
    "functions": oscillator,
}
LARGE = ("boxes", "spheres", "crowd")
SCHEMES = {"Paoli": mbvi.Paoli(), "Centered": mbvi.Centered(project_positions=True)}


def another(problem, seed):
    """A state of a problem: where it starts, with other velocities."""
    random = np.random.default_rng(seed)
    return problem.q0.copy(), problem.v0 + 0.2 * random.normal(size=len(problem.v0)), 0.1 * seed


def built(make, state):
    """The problem built at a state, sharing nothing with any other."""
    p = make()
    q, v, t = state
    return mbvi.Problem(
        p.system, p.constraints.constraints, q, v, restitution=p.restitution, t0=t, length=p.length, scene=p.scene
    )


def record(step):
    return step.t, step.q.tobytes(), step.v.tobytes()


@pytest.mark.parametrize("scheme", SCHEMES)
@pytest.mark.parametrize("kind", PROBLEMS)
def test_runs_that_share_constraints_are_those_of_each_alone(kind, scheme):
    make, scheme, count = PROBLEMS[kind], SCHEMES[scheme], 40 if kind in LARGE else 150
    h = 4e-3
    states = [another(make(), seed) for seed in (1, 2)]
    problems = [built(make, state) for state in states]
    alone = [[record(s) for s in itertools.islice(mbvi.steps(p, scheme, step=h), count)] for p in (make(), *problems)]
    shared = make()
    runs = [mbvi.steps(p, scheme, step=h) for p in (shared, *(shared.at(*state) for state in states))]
    random, together = np.random.default_rng(0), [[], [], []]
    while min(map(len, together)) < count:
        k = int(random.integers(3))
        more = min(int(random.integers(1, 20)), count - len(together[k]))
        together[k] += [record(s) for s in itertools.islice(runs[k], more)]
    assert together == alone


@pytest.mark.parametrize("kind", ["quadruped", "boxes", "planar", "functions"])
def test_a_run_from_another_state_is_that_of_a_problem_built_there(kind, tmp_path):
    make = PROBLEMS[kind]
    problem = make()
    state = another(problem, 3)
    mbvi.simulate(problem, step=2e-3, duration=0.1)
    new = problem.at(*state, check=True)
    assert (new.t0, new.q0.tobytes(), new.v0.tobytes()) == (state[2], state[0].tobytes(), state[1].tobytes())
    assert {k for k, x in vars(new).items() if x is not vars(problem)[k]} <= {"q0", "v0", "t0"}
    one, other = (mbvi.simulate(p, step=2e-3, duration=0.2) for p in (new, built(make, state)))
    for name in ("t", "q", "v"):
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes()
    assert one.problem is new


@pytest.mark.parametrize("kind", PROBLEMS)
def test_wrong_states_are_refused_without_the_full_check(kind):
    problem = PROBLEMS[kind]()
    q, v = problem.q0.copy(), problem.v0.copy()
    for k in range(0, len(q), max(1, len(q) // 7)):
        bad = q.copy()
        bad[k] = (np.nan, np.inf)[k % 2]
        with pytest.raises(mbvi.InputError, match=r"finite"):
            problem.at(bad, v)
    bad = v.copy()
    bad[-1] = -np.inf
    huge = np.full(len(v), 1e300)
    for wrong in ((q, bad), (q, huge), (q[:-1], v), (q, v[None]), (q.astype(str), v), (q, None), (q, v, np.nan)):
        with pytest.raises(mbvi.InputError):
            problem.at(*wrong)
    with pytest.raises(mbvi.InputError, match="check"):
        problem.at(q, v, check=np.zeros(2))
    assert problem.at(q.tolist(), v.astype(np.float32).astype(float)).q0.tobytes() == q.tobytes()
    # a copy keeps what it was given, whatever becomes of the arrays
    new = problem.at(q, v)
    q[:] = np.nan
    assert np.isfinite(new.q0).all()
    with pytest.raises(ValueError, match="read-only"):
        new.q0[0] = 0.0


def calls(function):
    """Return how many functions a call enters, those of libraries included."""
    profile = cProfile.Profile()
    profile.runcall(function)
    return pstats.Stats(profile).total_calls


def test_another_state_builds_nothing():
    """As many calls for a box as for a hundred boxes and a robot, and few of them."""
    counts = []
    for bodies in (1, 100):
        scene = mbvi.Scene()
        scene.add_halfspace((0, 0, 1))
        scene.add_boxes([(0, k, 1) for k in range(bodies)], size=(0.1, 0.1, 0.1), mass=1.0)
        if bodies > 1:
            scene.add_urdf(QUADRUPED, position=(2, 0, 1))
        problem = scene.build()
        new = problem.at(problem.q0, problem.v0)
        assert new.system is problem.system and new.constraints is problem.constraints
        counts.append(calls(partial(problem.at, problem.q0.copy(), problem.v0.copy())))
    assert counts[0] == counts[1] < 60


def test_a_quaternion_of_another_state_is_of_unit_length():
    problem = quadruped()
    q = problem.q0.copy()
    q[3:7] *= 1.0 + 1e-5
    with pytest.raises(mbvi.InputError, match="quaternion"):
        problem.at(q, problem.v0)


def test_the_full_check_is_that_of_a_new_problem():
    problem = quadruped()
    q = problem.q0.copy()
    q[2] -= 0.5
    problem.at(q, problem.v0)
    with pytest.raises(mbvi.InadmissibleStartError, match="penetrates"):
        problem.at(q, problem.v0, check=True)
    flat = planar()
    names, q = list(flat.system.bodies), flat.q0.copy()
    q[-2] = 0.1
    with pytest.raises(mbvi.InputError, match="outside the plane xz"):
        flat.at(q, flat.v0, check=True)
    turned = flat.q0.copy()
    start = flat.system.parts[0].nq
    turned[start + 3 : start + 7] = Rotation.from_rotvec([0.2, 0, 0]).as_quat()
    with pytest.raises(mbvi.InputError, match=f"q has {names[-3]} outside the plane"):
        flat.at(turned, flat.v0, check=True)
    later = mbvi.simulate(flat, step=1e-3, duration=0.3)
    flat.at(later.q[-1], later.v[-1], later.t[-1])
