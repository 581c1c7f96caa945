"""PD controls by the names of joints, and effort limits of the robot's file."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mbvi
from support.paths import ROBOTS, real_robot

HOPPER, UR5 = ROBOTS / "hopper/hopper.urdf", real_robot("ur_description/urdf/ur5_robot.urdf")


def falling(control, robot=HOPPER, **placed):
    scene = mbvi.Scene()
    scene.add_urdf(robot, control=control, name="robot", **(placed or {"position": (0, 0, 2)}))
    return scene.build()


@given(
    order=st.permutations(["hip", "knee"]),
    targets=st.tuples(st.floats(-1, 1), st.floats(0, 2)),
    gains=st.tuples(*4 * [st.floats(0, 30)]),
    most=st.floats(0.5, 40),
)
@settings(max_examples=25, deadline=None)
def test_names_are_the_arrays_in_the_models_order(order, targets, gains, most):
    """Byte for byte, in any order of the names."""
    names = ("hip", "knee")
    target, stiffness, damping = (dict(zip(names, values, strict=True)) for values in (targets, gains[:2], gains[2:]))
    named = mbvi.PDControl(
        {joint: target[joint] for joint in order}, stiffness, damping, limit=dict.fromkeys(names, most)
    )
    arrays = mbvi.PDControl(list(targets), list(gains[:2]), list(gains[2:]), limit=most)
    q, v = np.r_[np.zeros(6), 1.0, 0.3, -0.2], np.linspace(-1, 1, 8)
    first, second = (falling(control).system.control(0.0, q, v) for control in (named, arrays))
    assert first.tobytes() == second.tobytes()


def test_other_joints_are_left_alone_and_trajectories_are_followed():
    control = mbvi.PDControl({"knee": [0.0, 1.0]}, 5.0, {"knee": 2.0}, times=[0.0, 2.0], torque={"knee": 0.5})
    system = falling(control).system
    q, v = np.r_[np.zeros(6), 1.0, 0.3, -0.2], np.r_[np.zeros(7), 0.1]
    expected = np.zeros(8)
    expected[7] = 0.5 + 5.0 * (0.25 + 0.2) - 2.0 * 0.1
    np.testing.assert_allclose(system.control(0.5, q, v), expected, rtol=1e-15)


def test_some_joints_of_an_arm_by_name():
    """Two joints, with others before and after them, under every scheme of fixed steps that checks gains."""
    scene = mbvi.Scene(gravity=(0, 0, 0))
    hold = mbvi.PDControl({"joint2": 0.3, "joint4": -0.2}, 50.0, 5.0)
    scene.add_urdf("robot:arm", base="fixed", control=hold, joints={"joint2": 0.3, "joint4": -0.2})
    problem = scene.build()
    run = mbvi.simulate(problem, step=1e-3, duration=0.05)
    np.testing.assert_allclose(run.q[-1], problem.q0, rtol=0, atol=1e-12)
    system = problem.system.mechanisms[0] if hasattr(problem.system, "mechanisms") else problem.system
    torque, expected = system.control(0.0, problem.q0 - 0.1, np.ones(system.nv)), np.zeros(system.nv)
    expected[[1, 3]] = 50.0 * 0.1 - 5.0
    np.testing.assert_allclose(torque, expected, rtol=0, atol=1e-12)


def test_effort_limits_are_those_of_the_file():
    system = falling(mbvi.PDControl({"knee": 2.0}, 1e6, 0.0, limit="effort")).system
    assert system.control(0.0, np.zeros(9), np.zeros(8)).tolist() == [0.0] * 7 + [30.0]
    model, control = falling(None, UR5, base="fixed").model(), mbvi.PDControl(np.ones(6), 0.0, 1e9, limit="effort")
    system = falling(control, UR5, base="fixed").system
    torque = system.control(0.0, np.zeros(system.nq), -np.ones(6))
    np.testing.assert_array_equal(torque, model.effortLimit)


def test_a_run_does_not_depend_on_how_joints_are_named():
    runs = [
        mbvi.simulate(falling(control), mbvi.Paoli(), step=1e-3, duration=0.2)
        for control in (mbvi.PDControl({"knee": 0.4, "hip": -0.2}, 30.0, 1.0), mbvi.PDControl([-0.2, 0.4], 30.0, 1.0))
    ]
    assert runs[0].q.tobytes() == runs[1].q.tobytes()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (({"knee": 1.0}, {"hip": 1.0}, 1.0), "stiffness names hip; q names knee"),
        (({"knee": 1.0, "hip": 1.0}, {"hip": 1.0}, 1.0), "stiffness lacks knee"),
        (([1.0], {"hip": 1.0}, 1.0), "stiffness gives values by joint, and q does not"),
        (({"knee": "x"}, 1.0, 1.0), "q must give numbers"),
        (({"knee": np.nan}, 1.0, 1.0), "q"),
        (({"knee": 1.0}, {"knee": -1.0}, 1.0), "stiffness must be at least 0"),
    ],
)
def test_wrong_values_are_refused(arguments, said):
    with pytest.raises(mbvi.InputError, match=said):
        mbvi.PDControl(*arguments)


@pytest.mark.parametrize(
    ("control", "said"),
    [
        (mbvi.PDControl({"elbow": 1.0}, 1.0, 1.0), "the control of robot names 'elbow'; .* are hip, knee"),
        (mbvi.PDControl({"root_joint": 1.0}, 1.0, 1.0), "names 'root_joint'; its joints with one degree"),
        (mbvi.PDControl(np.zeros(8), 0.0, 1.0, limit="effort"), "no effort limit of root_joint above 0"),
    ],
)
def test_controls_that_do_not_fit_are_refused(control, said):
    with pytest.raises(mbvi.InputError, match=said):
        falling(control)


def test_a_control_by_name_acts_on_a_robot_only():
    with pytest.raises(mbvi.InputError, match="give it to one"):
        mbvi.PDControl({"knee": 1.0}, 1.0, 1.0)(0.0, np.zeros(9), np.zeros(8))
    with pytest.raises(mbvi.InputError, match="or 'effort'"):
        mbvi.PDControl([1.0], 1.0, 1.0, limit="file")
