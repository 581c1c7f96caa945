"""A start that overlaps is moved out of penetration by the least displacement in the kinetic metric."""

from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import nnls
from scipy.spatial.transform import Rotation

import mbvi
from support.paths import ROBOTS, real_robot

MJCF = """<mujoco><option timestep="0.001"/><worldbody><geom name="ground" type="plane" size="5 5 .1"/>
<body name="ball" pos="0 0 0.08"><freejoint/><geom type="sphere" size="0.1" density="1000"/>
</body></worldbody></mujoco>"""

# the trunk is three times its size deep
LEG = """<mujoco><option timestep="0.001"/><worldbody><geom name="ground" type="plane" size="5 5 .1"/>
<body name="trunk" pos="0 0 -0.3"><freejoint/><geom type="box" size="0.1 0.1 0.05" density="1000"/>
<body name="leg" pos="0.15 0 0"><joint name="knee" type="hinge" axis="0 1 0" limited="true" range="-0.5 0.5"/>
<geom type="capsule" fromto="0.02 0 0 0.02 0 -0.3" size="0.02" density="1000"/></body></body></worldbody></mujoco>"""


def moved(problem):
    return [line.strip() for line in problem.report().splitlines() if "moved out of penetration" in line]


@given(
    masses=st.tuples(st.floats(0.1, 10.0), st.floats(0.1, 10.0)),
    depth=st.floats(1e-6, 0.1),
    direction=st.tuples(*3 * [st.floats(-1.0, 1.0)]).filter(lambda n: np.linalg.norm(n) > 0.1),
)
@settings(max_examples=30, deadline=None)
def test_two_spheres_move_apart_as_their_masses_say(masses, depth, direction):
    """The lighter one moves more along the line of centres, and the centre of mass stays."""
    normal = np.array(direction) / np.linalg.norm(direction)
    places = np.array([(0.0, 0.0, 0.0), (0.2 - depth) * normal])
    scene = mbvi.Scene()
    for place, mass in zip(places, masses, strict=True):
        scene.add_sphere(0.1, position=place, mass=mass)
    with pytest.raises(mbvi.InadmissibleStartError, match=r"build\(resolve=True\), which moves it out"):
        scene.build()
    got = scene.build(resolve=True).q0.reshape(2, -1)[:, :3] - places
    share = np.array(masses)[::-1] / sum(masses)
    np.testing.assert_allclose(got, np.outer(share * (-1, 1), depth * normal), rtol=0, atol=2e-8)


@pytest.mark.parametrize("tilt", [0.0, 0.3, 1.0])
def test_a_box_rises_from_a_floor_as_little_as_it_can(tilt):
    """The gradients of its contacts span the displacement, in the kinetic metric, as those of a nearest point do."""
    turn = np.array([np.sin(0.5 * tilt), 0.0, 0.0, np.cos(0.5 * tilt)])
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_box((0.2, 0.3, 0.4), position=(0, 0, 0.15), rotation=turn, mass=2.0, name="box")
    start = scene.build(reduce=(), resolve=True)
    rows = start.constraints.active(0.0, start.q0, start.tolerance)
    assert rows.gap.min() >= -start.tolerance
    before = np.concatenate([[0, 0, 0.15], turn])
    z = start.system.difference(before, start.q0)
    metric = start.system.metric(before)
    # KKT: M z = J' p with p >= 0, of the contacts that are reached
    p, rest = nnls(rows.jacobian.T, metric.apply(z))
    assert rest < 1e-3 * np.linalg.norm(metric.apply(z)) and p.min() >= 0.0


def test_a_start_that_overlaps_nothing_stays_byte_for_byte():
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1))
    scene.add_urdf(ROBOTS / "quadruped/quadruped.urdf", position=(0, 0, 1))
    plain, resolved = scene.build(), scene.build(resolve=True)
    assert plain.q0.tobytes() == resolved.q0.tobytes()
    assert not moved(resolved)


@pytest.mark.parametrize(
    ("robot", "height"),
    [
        ("anymal_b_simple_description/robots/anymal.urdf", 0.54),
        ("solo_description/robots/solo12.urdf", 0.3),
        ("talos_data/robots/talos_full_v2.urdf", 1.0),
        # two links turn about one axis: the gradient of their pair is rounding
        ("hyq_description/robots/hyq_no_sensors.urdf", 0.5),
        ("hyq_description/robots/hyq_no_sensors.urdf", 0.27),
        # deeper than a scene's length
        ("tiago_description/robots/tiago.urdf", -0.9),
        ("talos_data/robots/talos_full_v2.urdf", 0.1),
    ],
    ids=["anymal", "solo12", "talos", "hyq", "hyq, deep", "tiago, deep", "talos, deep"],
)
def test_a_robot_that_stands_in_the_floor_is_moved_by_its_joints(robot, height):
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1))
    scene.add_urdf(real_robot(robot), position=(0, 0, height))
    with pytest.raises(mbvi.InadmissibleStartError, match="resolve=True"):
        scene.build()
    problem = scene.build(resolve=True)
    assert problem.constraints.active(0.0, problem.q0, problem.tolerance).gap.min(initial=0.0) >= -problem.tolerance
    [line] = moved(problem)
    assert " rad" in line
    run = mbvi.simulate(problem, mbvi.Paoli(), step=1e-3, duration=5e-3)
    assert any("the start was moved out of penetration" in note for note in run.notes)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("robot", ["hyq_description/robots/hyq_no_sensors.urdf", "go2_description/urdf/go2.urdf"])
def test_a_robot_in_the_floor_with_joints_beyond_their_limits(robot, seed):
    rng, file = np.random.default_rng(seed), real_robot(robot)
    joints = {}
    for joint in ElementTree.parse(file).iterfind("joint[@type='revolute']"):
        bounds = joint.find("limit").attrib
        lower, upper = float(bounds["lower"]), float(bounds["upper"])
        joints[joint.get("name")] = 0.5 * (lower + upper) + 0.5 * (upper - lower) * rng.uniform(-1.15, 1.15)
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1), name="floor")
    tilt = Rotation.from_rotvec(0.5 * rng.normal(size=3)).as_matrix()
    scene.add_urdf(file, position=(0, 0, rng.uniform(-0.3, 0.6)), rotation=tilt, joints=joints)
    problem = scene.build(resolve=True)
    assert problem.constraints.active(0.0, problem.q0, problem.tolerance).gap.min(initial=0.0) >= -problem.tolerance
    model = problem.model()
    assert (problem.q0[7:] >= model.lowerPositionLimit[7:] - 1e-6).all()
    assert (problem.q0[7:] <= model.upperPositionLimit[7:] + 1e-6).all()


def test_a_mjcf_deep_in_its_floor_with_a_joint_beyond_its_range(tmp_path):
    path = tmp_path / "leg.xml"
    path.write_text(LEG)
    scene = mbvi.Scene()
    scene.add_mjcf(path, joints={"knee": 1.0})
    problem = scene.build(resolve=True)
    assert problem.constraints.active(0.0, problem.q0, problem.tolerance).gap.min(initial=0.0) >= -problem.tolerance
    assert problem.q0[-1] <= 0.5 + 1e-6
    assert moved(problem)


def test_joints_beyond_their_limits_are_moved_to_them():
    scene = mbvi.Scene()
    scene.add_urdf(ROBOTS / "double_pendulum/double_pendulum.urdf", base="fixed", joints={"shoulder": 20.0})
    problem = scene.build(resolve=True)
    model = problem.model()
    assert problem.q0[0] == pytest.approx(model.upperPositionLimit[0], abs=1e-6)


def test_a_mjcf_whose_reference_overlaps_its_floor(tmp_path):
    path = tmp_path / "ball.xml"
    path.write_text(MJCF)
    scene = mbvi.Scene()
    scene.add_mjcf(path)
    problem = scene.build(resolve=True)
    assert problem.q0[2] == pytest.approx(0.1, abs=2e-8)


def test_a_moved_start_is_kept_in_files(tmp_path):
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1))
    scene.add_box((0.2, 0.3, 0.4), position=(0, 0, 0.15), mass=2.0)
    problem = scene.build(resolve=True)
    run = mbvi.simulate(problem, mbvi.Paoli(), step=1e-3, duration=0.02)
    run.save(tmp_path / "run.npz")
    again = mbvi.load(tmp_path / "run.npz")
    assert again.problem.q0.tobytes() == problem.q0.tobytes()
    assert moved(again.problem) == moved(problem) != []


def test_no_way_out_is_an_error_that_names_what_is_too_deep():
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_halfspace((0, 0, -1), offset=-0.1, name="ceiling")
    scene.add_sphere(0.1, position=(0, 0, 0.05), name="ball")
    with pytest.raises(mbvi.InadmissibleStartError, match=r"finds no way out: .*ball.* deep; .*Scene\.exclude"):
        scene.build(resolve=True)


def test_what_no_motion_raises_is_named(tmp_path):
    """A ball on the axis of its joint: its gap has no gradient."""
    (tmp_path / "arm.urdf").write_text("""<robot name="arm"><link name="base"/><link name="rod"><inertial>
      <mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>
      <collision><geometry><sphere radius="0.2"/></geometry></collision></link>
      <joint name="axle" type="revolute"><parent link="base"/><child link="rod"/><axis xyz="0 1 0"/>
      <limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>""")
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(tmp_path / "arm.urdf", "fixed", position=(0, 0, 0.1), name="arm")
    with pytest.raises(mbvi.InadmissibleStartError, match=r"finds no way out: arm/rod \| floor is still 0\.1 m deep"):
        scene.build(resolve=True)
