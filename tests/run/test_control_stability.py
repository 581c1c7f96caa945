"""A PD control that is unstable at a step is named, with gains that are stable; the bound is where runs diverge."""

import re

import numpy as np
import pytest

import mbvi
from support.paths import ROBOTS

STEP = 1e-3
# a hinge of known inertia that falls freely about nothing: h d / I + h^2 k / (2 I) decides alone
INERTIA = 0.02
HINGE = f"""<robot name="hinge"><link name="base"/><link name="rod"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="{INERTIA}" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="axle" type="continuous"><parent link="base"/><child link="rod"/><axis xyz="0 0 1"/></joint></robot>"""
SCHEMES = [mbvi.Paoli(), mbvi.MoreauJean(0.5), mbvi.Centered(), mbvi.Centered(project_positions=True)]


@pytest.fixture
def hinge(tmp_path):
    path = tmp_path / "hinge.urdf"
    path.write_text(HINGE.replace('type="continuous"', 'type="revolute"').replace(
        '<axis xyz="0 0 1"/>', '<axis xyz="0 0 1"/><limit lower="-1e6" upper="1e6" effort="0" velocity="0"/>'
    ))  # fmt: skip

    def problem(control):
        scene = mbvi.Scene(gravity=(0, 0, 0))
        scene.add_urdf(
            path, base="fixed", joints={"axle": 1e-3}, velocity={"axle": 1e-3}, control=control, name="hinge"
        )
        return scene.build()

    return problem


@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
@pytest.mark.parametrize("damping_share", [0.0, 0.5, 1.0])
@pytest.mark.parametrize(("value", "stable"), [(1.9, True), (2.1, False)])
def test_the_bound_is_where_runs_diverge(hinge, scheme, damping_share, value, stable):
    damping = damping_share * value * INERTIA / STEP
    stiffness = (1.0 - damping_share) * value * 2.0 * INERTIA / STEP**2
    problem = hinge(mbvi.PDControl([0.0], stiffness, damping))
    if stable:
        run = mbvi.simulate(problem, scheme, step=STEP, duration=0.4)
        assert np.abs(run.v).max() < 20.0
        return
    with pytest.raises(mbvi.DivergedError, match=r"of hinge is unstable at h = 0\.001 s: joint axle") as caught:
        mbvi.simulate(problem, scheme, step=STEP, duration=0.4)
    assert any("h d + (h w)^2 / 2 = 2.1 must be below 2" in note for note in caught.value.run.notes)


def pendulum(control):
    scene = mbvi.Scene()
    scene.add_urdf(ROBOTS / "double_pendulum/double_pendulum.urdf", base="fixed", control=control, name="pendulum")
    return scene.build()


def in_python(stiffness, damping):
    return lambda t, q, v: -stiffness * (q - 0.3) - damping * v


@pytest.mark.parametrize("scheme", SCHEMES[:1] + SCHEMES[3:], ids=repr)
def test_a_run_that_diverges_names_time_robot_joint_and_stable_gains(scheme):
    stiffness, damping = 3e5, 5e3
    with pytest.raises(
        mbvi.DivergedError, match=r"the run diverges at t = .* s: the control of pendulum is unstable"
    ) as caught:
        mbvi.simulate(pendulum(in_python(stiffness, damping)), scheme, step=STEP, duration=1.0)
    message = str(caught.value)
    found = re.search(
        r"joint (\w+) has .* it is stable with a stiffness of (\S+) and a damping of (\S+) \(all", message
    )
    assert found is not None, message
    joint, stiff, damp = found[1], float(found[2]), float(found[3])
    assert joint in list(caught.value.run.problem.model("pendulum").names)
    share = float(re.search(r"times (\S+)\)", message)[1])
    assert (stiff, damp) == pytest.approx((share * stiffness, share * damping), rel=0.1)
    run = mbvi.simulate(pendulum(in_python(stiff, damp)), scheme, step=STEP, duration=1.0)
    assert np.abs(run.v[-1]).max() < 0.5
    assert np.abs(run.q[-1] - 0.3).max() < 0.05
    h = float(re.search(r"or at h = (\S+) s", message)[1])
    run = mbvi.simulate(pendulum(in_python(stiffness, damping)), scheme, step=h, duration=500 * h)
    assert np.abs(run.v).max() < 100.0


def test_gains_of_a_pd_control_are_checked_before_the_first_step():
    """A note says so, where limits of the torques hide it from the motion."""
    run = mbvi.simulate(
        pendulum(mbvi.PDControl(np.zeros(2), 3e4, 500.0, limit=1.0)), mbvi.Paoli(), step=STEP, duration=0.01
    )
    assert any("the control of pendulum is unstable at h = 0.001 s: joint" in note for note in run.notes)


@pytest.mark.parametrize("step", [1e-2, 1.03e-2, 2e-2])
def test_a_robot_that_runs_away_ends_before_its_steps_become_endless(step):
    """Each step has more contacts than the one before; at the end one of them took minutes."""
    scene = mbvi.Scene(friction=0.7)
    scene.add_halfspace((0.3, 0, 1), name="slope")
    hold = lambda t, q, v: np.concatenate([np.zeros(6), 200.0 * (0.5 - q[7:]) - 1.5 * v[6:]])  # noqa: E731
    scene.add_urdf(ROBOTS / "quadruped/quadruped.urdf", position=(0, 0, 0.5), control=hold, name="quadruped")
    with pytest.raises(mbvi.DivergedError, match=r"of quadruped is unstable at h = .* it is stable with") as caught:
        mbvi.simulate(scene.build(), step=step, duration=1.0)
    run = caught.value.run
    assert step * np.abs(run.v).max() < 2.0 * np.pi


@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
@pytest.mark.parametrize("value", [0.0, 1.9])
def test_a_joint_with_stable_gains_may_turn_more_than_once_a_step(hinge, scheme, value):
    control = None if value == 0.0 else mbvi.PDControl([0.0], 0.0, value * INERTIA / STEP)
    problem = hinge(control).at([0.0], [1e4])
    run = mbvi.simulate(problem, scheme, step=STEP, duration=20 * STEP)
    # h d / I is the share of its velocity that it loses a step
    np.testing.assert_allclose(run.v[:, 0], 1e4 * (1.0 - value) ** np.arange(21), rtol=1e-9)
