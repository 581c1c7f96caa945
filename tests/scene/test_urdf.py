"""What a URDF holds and mbvi does not model is said when the robot is added."""

import warnings
import xml.etree.ElementTree as ElementTree

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

import mbvi
from support.paths import DATA, REAL_ROBOTS, real_robot

FINGERS = DATA / "fingers.urdf"


def said_of(path, **arguments):
    """Return a scene with a robot, and what was said when it was added."""
    scene = mbvi.Scene()
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        scene.add_urdf(path, **arguments)
    assert all(one.category is mbvi.MbviWarning for one in said)
    return scene, " ".join(str(one.message) for one in said)


def test_joints_that_are_freed_and_fixed_ones_are_in_the_report():
    scene, said = said_of(FINGERS, mimic=False)
    problem = scene.build()
    assert not said and not problem.system.equalities
    assert "mimic of joint follower: the joint moves on its own, and does not follow lead" in problem.report()
    assert "mimic of joint stiff: the joint is fixed" in problem.report()


def test_a_joint_that_mimics_another_follows_it():
    scene, said = said_of(FINGERS, joints={"lead": 0.3}, velocity={"lead": -1.0})
    assert not said
    problem = scene.build()
    assert "fingers_follower: fingers/follower = 2 fingers/lead + 0" in problem.report()
    assert "mimic of joint stiff: the joint is fixed" in problem.report()
    # the model has its joints in the order of their names
    assert problem.q0[-2:].tolist() == [0.6, 0.3]
    np.testing.assert_allclose(problem.v0[-2:], [-2.0, -1.0], rtol=1e-15)
    run = mbvi.simulate(problem, mbvi.Paoli(), step=1e-3, duration=0.1)
    assert run.loop_gap().max() <= 1e-13 and not run.notes
    np.testing.assert_allclose(run.q[:, -2], 2.0 * run.q[:, -1], rtol=0.0, atol=1e-13)


def test_a_locked_joint_mimics_none_and_leads_those_that_mimic_it():
    problem = said_of(FINGERS, joints={"lead": 0.3}, locked=["follower"])[0].build()
    assert problem.system.nv == 7 and not problem.system.equalities and "fingers_follower" not in problem.report()
    problem = said_of(FINGERS, joints={"lead": 0.3}, locked=["lead"])[0].build()
    run = mbvi.simulate(problem, mbvi.Centered(), step=1e-3, duration=0.05)
    np.testing.assert_allclose(run.q[:, -1], 0.6, rtol=0.0, atol=1e-13)


@pytest.mark.parametrize("e", [0.0, 0.5])
@pytest.mark.parametrize("scheme", [mbvi.Paoli(), mbvi.StewartTrinkle(), mbvi.EventDriven(1e-6)], ids=repr)
def test_limits_that_contradict_a_ratio_hold_joints_still(tmp_path, scheme, e):
    """The joint is at least 0, and so is its follower, at minus the joint: no force acts on either in free fall."""
    text = FINGERS.read_text().replace('multiplier="2"', 'multiplier="-1"').replace('lower="-1"', 'lower="0"')
    (tmp_path / "held.urdf").write_text(text)
    scene = mbvi.Scene(restitution=e, gravity=(3.0, 1.0, -9.8))
    scene.add_urdf(tmp_path / "held.urdf", base_velocity=(0.0, 0.0, 0.0, 0.3, 0.2, 0.4))
    step = None if scheme.timing.own_steps else 1e-3
    run = mbvi.simulate(scene.build(), scheme, step=step, duration=0.1)
    assert np.abs(run.q[:, -2:]).max() <= 1e-15 and run.loop_gap().max() <= 1e-15 and not run.notes


@pytest.mark.parametrize("given", [{"joints": {"lead": 0.3, "follower": 0.5}}, {"velocity": {"follower": 1.0}}])
def test_a_mimic_joint_cannot_start_elsewhere(given):
    with pytest.raises(mbvi.InputError, match="joint 'follower' follows 'lead' and starts"):
        mbvi.Scene().add_urdf(FINGERS, **given)


@pytest.mark.parametrize(
    ("mimic", "why"),
    [('joint="nobody"', "the file has no other joint 'nobody'"), ('joint="wheel" multiplier="0.5"', "is not unique")],
)
def test_a_joint_that_cannot_mimic_is_named(tmp_path, mimic, why):
    link = FINGERS.read_text().split("</link>")[0].split("<link")[1].replace('"palm"', '"rim"')
    wheel = (
        f"""<link{link}</link><joint name="wheel" type="continuous"><parent link="palm"/><child link="rim"/></joint>"""
    )
    text = FINGERS.read_text().replace('joint="lead" multiplier="2"', mimic).replace("</robot>", f"{wheel}</robot>")
    (tmp_path / "wheel.urdf").write_text(text)
    assert why in said_of(tmp_path / "wheel.urdf")[1]


@pytest.mark.parametrize(
    ("path", "followed"),
    [
        ("panda_description/urdf/panda.urdf", 1), ("talos_data/robots/talos_left_arm.urdf", 0),
        ("talos_data/robots/talos_full_v2.urdf", 12),
    ],
)  # fmt: skip
def test_mimic_joints_of_published_robots_are_modelled(path, followed):
    assert check_followed(real_robot(path)) == followed


def check_followed(file):
    """Each mimic joint that moves is at its ratio of the other one, which stands anywhere; those that cannot are named.

    Return how many follow.
    """
    root = ElementTree.parse(file).getroot()
    mimics = {joint.get("name"): joint.find("mimic") for joint in root.findall("joint")}
    mimics = {name: mimic for name, mimic in mimics.items() if mimic is not None}
    scene, said = said_of(file, base="free")
    problem = scene.build(reduce=[], resolve=True) if mimics else None
    model, followed = problem.model() if mimics else None, 0
    kinds = {joint.get("name"): joint.get("type") for joint in root.findall("joint")}
    for name, mimic in mimics.items():
        assert (name in said) == (kinds[name] != "fixed" and mimic.get("joint") not in kinds)
        if not model.existJointName(name) or name in said:
            continue
        followed += 1
        at = [problem.q0[model.idx_qs[model.getJointId(joint)]] for joint in (name, mimic.get("joint"))]
        ratio, offset = (float(mimic.get(key, default)) for key, default in (("multiplier", 1), ("offset", 0)))
        assert abs(at[0] - ratio * at[1] - offset) <= 1e-12
    assert followed == len(problem.system.equalities if mimics else ())
    return followed


@pytest.mark.slow(seconds=90)
@pytest.mark.filterwarnings("ignore:alex_psyonic_hands.urdf. joints do not mimic others")
def test_mimic_joints_of_all_published_robots_are_modelled():
    found = []
    for file in sorted(REAL_ROBOTS.rglob("*.urdf")):
        try:
            mbvi.Scene().add_urdf(file)
        except mbvi.MbviError:
            continue
        found.append(check_followed(file))
    assert len(found) > 60 and sum(n > 0 for n in found) >= 7


PLANAR = """<robot name="table"><link name="ground"/>
  <link name="slider"><inertial><origin xyz=".1 .2 .3"/><mass value="2"/>
    <inertia ixx=".02" iyy=".03" izz=".025" ixy=".001" ixz="-.002" iyz=".003"/></inertial>
    <collision><origin xyz=".3 .1 -.2"/><geometry><sphere radius=".05"/></geometry></collision></link>
  <joint name="plane" type="planar"><parent link="ground"/><child link="slider"/>{axis}
    <origin xyz=".4 -.2 .1" rpy=".3 -.5 .8"/></joint>
  <link name="arm"><inertial><mass value="1"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><origin xyz="0 .2 0"/><geometry><sphere radius=".05"/></geometry></collision></link>
  <joint name="elbow" type="revolute"><parent link="slider"/><child link="arm"/><axis xyz="0 1 0"/>
    <origin xyz=".2 0 .5" rpy="0 .7 .2"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""


@pytest.mark.parametrize("axis", ["1 0 0", "0 0 1", "0 0 -1", "1 -2 2", None])
def test_a_planar_joint_moves_across_its_axis(tmp_path, axis):
    """By the specification of URDF: in the plane perpendicular to the axis, which is x where the file names none."""
    file = tmp_path / "table.urdf"
    file.write_text(PLANAR.format(axis="" if axis is None else f"<axis xyz='{axis}'/>"))
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1), -9.0, name="floor")
    scene.add_urdf(file, base="fixed", position=(0, 0, 1), rotation=(0.2, 0, 0), name="table")
    problem = scene.build()

    def pose(place, turn):
        found = np.eye(4)
        found[:3, 3], found[:3, :3] = place, Rotation.from_euler("xyz", turn).as_matrix()
        return found

    base = pose((0, 0, 1), (0.2, 0, 0)) @ pose((0.4, -0.2, 0.1), (0.3, -0.5, 0.8))
    slider = base @ [0.3, 0.1, -0.2, 1]
    arm = base @ pose((0.2, 0, 0.5), (0, 0.7, 0.2)) @ [0, 0.2, 0, 1]
    heights = dict(zip(("table/slider | floor", "table/arm | floor"), (slider[2], arm[2]), strict=True))
    gaps = problem.constraints.gap(0.0, problem.q0)
    found = {problem.constraints.name(k): gap for k, gap in enumerate(gaps)}
    for name, height in heights.items():
        assert found[name] == pytest.approx(height + 9.0 - 0.05, abs=1e-12)
    normal = base[:3, :3] @ (np.array([1.0, 0, 0]) if axis is None else np.array(axis.split(), dtype=float))
    normal /= np.linalg.norm(normal)
    model, centre = problem.model("table"), base @ [0.1, 0.2, 0.3, 1]
    data = model.createData()

    def of_slider(q):
        pin.forwardKinematics(model, data, q)
        return data.oMi[1].act(model.inertias[1].lever)

    np.testing.assert_allclose(of_slider(problem.q0), centre[:3], atol=1e-12)
    for v in np.eye(4)[:3]:
        moved = of_slider(pin.integrate(model, problem.q0, v)) - centre[:3]
        assert np.linalg.norm(moved) > 0.01 and abs(normal @ moved) < 1e-12
    run = mbvi.simulate(problem, step=1e-3, duration=0.1)
    run.save(tmp_path / "run.h5")
    again = mbvi.simulate(mbvi.load(tmp_path / "run.h5").problem, step=1e-3, duration=0.1)
    assert (again.q == run.q).all() and np.array_equal(again.problem.constraints.gap(0.0, problem.q0), gaps)


def test_safety_controllers_are_in_the_report(tmp_path):
    file = tmp_path / "table.urdf"
    guard = "<safety_controller soft_lower_limit='-.5' soft_upper_limit='.5' k_velocity='1'/></joint></robot>"
    file.write_text(PLANAR.format(axis="").replace("</joint></robot>", guard))
    scene = mbvi.Scene()
    scene.add_urdf(file, base="fixed")
    assert "safety controllers of elbow: the limits of joints alone hold" in scene.build().report()
