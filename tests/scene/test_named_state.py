"""States by the names of robots, joints, bodies and spheres."""

import numpy as np
import pytest

import mbvi
from support.paths import DATA, ROBOTS, real_robot

HOPPER = ROBOTS / "hopper/hopper.urdf"


def everything(plane=None, friction=0.5):
    scene = mbvi.Scene(friction=friction, plane=plane)
    scene.add_halfspace((0, 0, 1))
    scene.add_urdf(HOPPER, position=(0, 0, 2), name="hopper")
    scene.add_box((0.1, 0.1, 0.1), mass=1.0, position=(1, 0, 1), name="box")
    scene.add_spheres([(2, 0, 1), (3, 0, 1)], radius=0.1, mass=1.0, name="balls")
    return scene.build()


PANDA = real_robot("panda_description/urdf/panda.urdf")


@pytest.mark.parametrize("robot", [HOPPER, PANDA], ids=["hopper", "panda"])
def test_every_joint_is_written_where_pinocchio_has_it(robot):
    scene = mbvi.Scene()
    name = scene.add_urdf(robot, position=(0, 0, 2), mimic=False)
    problem = scene.build()
    model = problem.model()
    for k, joint in enumerate(model.names):
        if model.nqs[k] != 1:
            continue
        q, v = problem.state(q={name: {joint: 0.125}}, v={name: {joint: 0.5}})
        expected = problem.q0.copy(), problem.v0.copy()
        expected[0][model.idx_qs[k]], expected[1][model.idx_vs[k]] = 0.125, 0.5
        np.testing.assert_array_equal(q, expected[0])
        np.testing.assert_array_equal(v, expected[1])


@pytest.mark.parametrize("several", [False, True])
def test_joints_that_follow_others_are_led(several):
    """Those of a file, and those that a scene couples to them, on another robot too."""
    scene = mbvi.Scene()
    scene.add_urdf(HOPPER, position=(0, 0, 2), joints={"knee": 0.5}, name="hopper")
    scene.add_urdf(PANDA, base="fixed", name="panda")
    if several:
        scene.couple("hopper/knee", "panda/panda_finger_joint2", ratio=-2.0, offset=0.5)
    problem = scene.build(reduce=[])
    model = problem.model("panda")
    q, v = problem.state({"panda": {"panda_finger_joint1": 0.02}}, {"panda": {"panda_finger_joint1": 0.3}})
    assert np.abs(problem.system.gaps(q)).max() <= 1e-15
    np.testing.assert_array_equal(v, problem.system.tangent(q, v).round(12))
    fingers = [model.getJointId(f"panda_finger_joint{k}") for k in (1, 2)]
    whole = {"panda": q[-model.nq :]}
    assert [q[k - model.nq - 1] for k in fingers] == [0.02, 0.02]
    assert [v[k - model.nv - 1] for k in fingers] == [0.3, 0.3]
    knee = problem.model("hopper").nq - 1
    assert (q[knee], v[knee - 1]) == ((0.46, -0.6) if several else (problem.q0[knee], 0.0))
    same, _ = problem.state({"panda": {"panda_finger_joint1": 0.02, "panda_finger_joint2": 0.02}})
    np.testing.assert_array_equal(same, q)
    np.testing.assert_array_equal(problem.state(whole)[0], q)
    elsewhere, _ = problem.state({"panda": {"panda_joint1": 0.3}})
    assert np.count_nonzero(elsewhere != problem.q0) == 1
    for given in ({"panda_finger_joint2": 0.02}, {"panda_finger_joint1": 0.01, "panda_finger_joint2": 0.02}):
        with pytest.raises(mbvi.InputError, match="'panda/panda_finger_joint2' follows 'panda/panda_finger_joint1'"):
            problem.state({"panda": given})
    with pytest.raises(mbvi.InputError, match="and is with the velocity 0, not 1"):
        problem.state(v={"panda": {"panda_finger_joint2": 1.0}})


def test_a_joint_that_follows_a_locked_one_is_held():
    scene = mbvi.Scene()
    scene.add_urdf(DATA / "fingers.urdf", joints={"lead": 0.3}, locked=["lead"], name="hand")
    problem = scene.build(reduce=[])
    with pytest.raises(mbvi.InputError, match=r"joint 'hand/follower' is held by hand_follower at 0\.6"):
        problem.state({"hand": {"follower": 0.1}})


def test_a_joint_without_limits_has_cosine_and_sine():
    scene = mbvi.Scene()
    name = scene.add_urdf(real_robot("ur_description/urdf/ur5_robot.urdf"), base="fixed")
    problem = scene.build(reduce=())
    model = problem.model()
    turning = [j for j in range(1, model.njoints) if model.nqs[j] == 2]
    for j in turning:
        q, _ = problem.state(q={name: {model.names[j]: 0.3}})
        np.testing.assert_allclose(q[model.idx_qs[j] :][:2], (np.cos(0.3), np.sin(0.3)))
    free, _ = problem.state(q={name: dict.fromkeys(list(model.names)[1:], 0.25)})
    assert problem.at(free, problem.v0).q0.shape == problem.q0.shape


@pytest.mark.parametrize("friction", [0.0, 0.5])
@pytest.mark.parametrize("plane", [None, "xz"])
def test_a_control_of_the_scene_sees_the_same_values(plane, friction):
    """What a state by name writes is what `State` reads, in space and in a plane, with spheres that turn or not."""
    seen = []
    scene = mbvi.Scene(friction=friction, plane=plane, gravity=(0, 0, 0))
    scene.add_box((0.1, 0.1, 0.1), mass=1.0, position=(1, 0, 1), name="box")
    scene.add_spheres([(2, 0, 1), (3, 0, 1)], radius=0.1, mass=1.0, name="balls")
    scene.add_control(lambda state: seen.append((dict(state.q), dict(state.v), state.q["balls[1]"])) or {})
    problem = scene.build(reduce=("plane",))
    width = 6 if friction else 3
    speeds = np.zeros((2, width))
    speeds[:, :3] = [(0.1, 0, 0.2), (0.3, 0, 0.4)]
    q, v = problem.state(q={"box": (5, 0, 6), "balls[1]": (7, 0, 8)}, v={"box": (1, 0, 2, 0, 3, 0), "balls": speeds})
    seen.clear()
    mbvi.simulate(problem.at(q, v), mbvi.Paoli(), step=1e-3, duration=1e-3)
    at, rates, ball = seen[0]
    np.testing.assert_allclose(at["box"][:3], (5, 0, 6), atol=5e-3)
    np.testing.assert_allclose(at["balls"][:, :3], [(2, 0, 1), (7, 0, 8)], atol=1e-3)
    np.testing.assert_allclose(ball[:3], (7, 0, 8), atol=1e-3)
    np.testing.assert_allclose(rates["box"], (1, 0, 2, 0, 3, 0), atol=1e-12)
    np.testing.assert_allclose(rates["balls"], speeds, atol=1e-12)


def test_forces_on_spheres_that_friction_turns():
    scene = mbvi.Scene(friction=0.5, gravity=(0, 0, 0))
    scene.add_spheres([(2, 0, 1), (3, 0, 1)], radius=0.1, mass=2.0, name="balls")
    scene.add_force("balls[1]", lambda t, q, v: np.array([0.0, 4.0, 0, 0, 0, 0.008]))
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=0.1)
    # m = 2, I = 0.4 m r^2 = 0.008
    np.testing.assert_allclose(run.v[-1], [*[0.0] * 6, 0, 0.2, 0, 0, 0, 0.1], atol=1e-12)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"q": {"nobody": {"knee": 1}}}, "no robot, body or sphere 'nobody'"),
        ({"q": {"hopper": {"elbow": 1}}}, "hopper has no joint 'elbow'; known are root_joint, hip, knee"),
        ({"q": {"hopper": {0: 1}}}, "hopper has no joint 0; known are root_joint, hip, knee"),
        ({"q": {"hopper": {"knee": [1, 2]}}}, "q of hopper/knee has 2 numbers; it must have 1"),
        ({"v": {"hopper": [1, 2]}}, r"v of hopper has shape \(2,\)"),
        ({"q": {"box": {"knee": 1}}}, "q of box must be numbers: it is no robot"),
        ({"q": {"box": [1, 2]}}, r"q of box has shape \(2,\); it must have \(7,\)"),
        ({"q": [1, 2]}, "q must be a mapping of names"),
        ({"q": {"hopper": {"knee": np.nan}}}, "q of hopper/knee"),
    ],
)
def test_wrong_names_and_shapes_are_refused(given, said):
    with pytest.raises(mbvi.InputError, match=said):
        everything().state(**given)


def test_a_velocity_out_of_the_plane_is_refused():
    with pytest.raises(mbvi.InputError, match="v of box leaves the plane"):
        everything("xz").state(v={"box": (0, 1, 0, 0, 0, 0)})


def test_a_problem_without_a_scene_has_no_names():
    system = mbvi.LagrangianSystem(lambda q: np.eye(1), lambda t, q, v: np.zeros(1), 1)
    with pytest.raises(mbvi.InputError, match="of no scene"):
        mbvi.Problem(system, [], [0.0], [0.0]).state()
