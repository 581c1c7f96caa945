"""Closed loops and coupled joints in motion: against minimal coordinates and single bodies."""

import numpy as np
import pinocchio as pin
import pytest

import mbvi
from mbvi_studies.chart.errors import fitted_order
from support.four_bar import CENTRES, LENGTHS, START, WIDTH, four_bar, inertia, motion, places
from support.loop_arguments import tied

SCHEMES = [
    mbvi.Paoli(), mbvi.MoreauJean(), mbvi.Centered(), mbvi.Centered(project_positions=True), mbvi.StewartTrinkle(),
]  # fmt: skip
each_scheme = pytest.mark.parametrize("scheme", SCHEMES, ids=repr)


@pytest.mark.parametrize(("scheme", "order"), [(mbvi.Paoli(), 1), (mbvi.MoreauJean(), 1), (mbvi.Centered(), 2)])
def test_a_four_bar_moves_as_in_its_crank_angle(scheme, order):
    problem, end = four_bar().build(), places(motion(0.8).y[0, -1])[0]
    steps = [4e-3, 2e-3, 1e-3]
    runs = [mbvi.simulate(problem, scheme, step=h, duration=0.8) for h in steps]
    errors = [np.abs(run.q[-1][CENTRES] - end).max() for run in runs]
    assert abs(fitted_order(steps, errors) - order) < 0.2, errors
    assert max(run.loop_gap().max() for run in runs) <= 1e-12


@pytest.mark.parametrize("tolerance", [1e-5, 1e-8])
def test_event_driven_meets_its_tolerance_with_loops(tolerance):
    run = mbvi.simulate(four_bar().build(), mbvi.EventDriven(tolerance), duration=0.8)
    end = places(motion(0.8).y[0, -1])[0]
    assert np.abs(run.q[-1][CENTRES] - end).max() <= 10.0 * tolerance
    assert run.loop_gap().max() <= 1e-12


def lowest(t, state):
    """Height above a floor at -0.3 m of the lowest corner of the three boxes."""
    centres, turns = places(state[0])
    heights = [
        centre - 0.5 * (length * abs(np.sin(turn)) + WIDTH * abs(np.cos(turn)))
        for centre, turn, length in zip(centres[1::2], turns, LENGTHS, strict=False)
    ]
    return min(heights) + 0.3


lowest.terminal = True


@pytest.mark.parametrize("e", [0.5, 1.0])
def test_impacts_of_a_four_bar_are_those_of_its_crank(e):
    """Of one degree of freedom: the crank meets the floor, and its speed is reversed and multiplied by e."""
    times, state, now = [], (START, 0.0), 0.0
    for _ in range(2):
        found = motion(2.0, state, lowest)
        now += found.t[-1]
        times.append(now)
        crank, speed = found.y[:, -1]
        # off the floor, where the next flight begins
        state = crank, -e * speed
        lowest.direction = -1
    problem = four_bar(e, floor=-0.3).build()
    run = mbvi.simulate(problem, mbvi.EventDriven(1e-9), duration=times[-1] + 1e-3)
    np.testing.assert_allclose([impact.time for impact in run.impacts], times, rtol=0.0, atol=1e-8)
    if e == 1.0:
        assert np.ptp(run.energy()) <= 1e-7


# with friction and restitution Newton's law may raise the energy
@pytest.mark.filterwarnings("ignore:at t = .* raised the energy:mbvi.MbviWarning")
@each_scheme
@pytest.mark.parametrize(("e", "mu"), [(0.0, 0.0), (0.5, 0.0), (1.0, 0.0), (0.0, 0.6), (0.5, 0.6)])
def test_loops_stay_closed_through_impacts(scheme, e, mu):
    """Of a quadruped that falls on its feet, two of whose legs share a point while two thighs are coupled."""
    run = mbvi.simulate(tied(e, mu), scheme, step=2e-3, duration=0.6)
    assert len(run.impacts) > 2
    assert run.loop_gap().max() <= 1e-12


def test_energy_is_kept_through_impacts_of_welded_bodies():
    scene = mbvi.Scene(restitution=1.0)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_box((0.2, 0.2, 0.2), 1.0, position=(0, 0, 0.5), rotation=(0.3, 0.2, 0.1), name="one")
    scene.add_box((0.2, 0.2, 0.2), 2.0, position=(0.25, 0, 0.5), name="other")
    scene.weld("one", "other")
    run = mbvi.simulate(scene.build(), mbvi.Centered(), step=1e-3, duration=1.0)
    assert len(run.impacts) > 2
    assert np.ptp(run.energy()) <= 1e-11 * run.energy()[0]
    # without gravity's torque the pair turns as one body: its parts keep their distance
    apart = np.linalg.norm(run.q[:, :3] - run.q[:, 7:10], axis=1)
    np.testing.assert_allclose(apart, apart[0], rtol=0.0, atol=1e-12)


WELDED = """<robot name="trio"><link name="one"><inertial><mass value="1"/>
  <inertia ixx="0.01" iyy="0.02" izz="0.03" ixy="0" ixz="0" iyz="0"/></inertial>
  <collision><geometry><box size="0.2 0.2 0.2"/></geometry></collision></link>
  <link name="two"><inertial><mass value="2"/><inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/>
  </inertial><collision><geometry><sphere radius="0.1"/></geometry></collision></link>
  <link name="three"><inertial><mass value="1"/><inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/>
  </inertial><collision><geometry><box size="0.1 0.2 0.1"/></geometry></collision></link>
  <joint name="first" type="revolute"><parent link="one"/><child link="three"/><origin xyz="-0.2 0 0"/>
  <axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
  <joint name="second" type="{kind}"><parent link="one"/><child link="two"/><origin xyz="0.3 0 0.1"/>{more}</joint>
</robot>"""
LIMITED = '<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/>'


@each_scheme
@pytest.mark.parametrize(("e", "mu"), [(0.0, 0.0), (0.5, 0.0), (0.0, 0.5)])
def test_a_welded_joint_moves_as_a_fixed_one(tmp_path, scheme, e, mu):
    """Of three links that land: the same steps, because both have the same free motion and the same law."""
    runs = []
    for kind, more in (("fixed", ""), ("revolute", LIMITED)):
        (tmp_path / "trio.urdf").write_text(WELDED.format(kind=kind, more=more))
        scene = mbvi.Scene(restitution=e, friction=mu)
        scene.add_halfspace((0, 0, 1), name="floor")
        base = {"position": (0, 0, 0.3), "rotation": (0.2, 0.2, 0.0), "base_velocity": (1, 0, 0, 0, 2, 1)}
        scene.add_urdf(tmp_path / "trio.urdf", **base)
        if more:
            scene.weld("trio/one", "trio/two")
        runs.append(mbvi.simulate(scene.build(), scheme, step=1e-3, duration=0.3))
    fixed, welded = runs
    assert len(fixed.impacts) > 1
    np.testing.assert_allclose(welded.q[:, :8], fixed.q, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(welded.v[:, :7], fixed.v, rtol=0.0, atol=1e-7)


def test_connections_that_are_said_twice_change_no_motion():
    runs = []
    for times in (1, 2):
        scene = four_bar()
        for _ in range(times - 1):
            scene.hinge("world", "rocker", at=(1.0, 0.0, 0.0), axis=(0, 1, 0))
        runs.append(mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=0.2))
    np.testing.assert_allclose(runs[1].v, runs[0].v, rtol=0.0, atol=1e-10)


@each_scheme
def test_a_coupling_between_robots_passes_momentum_on(scheme):
    """Two hoppers whose hips turn against each other: one is pushed, and both turn; the gap stays closed."""
    scene = mbvi.Scene(gravity=(0, 0, 0))
    for x, name in ((0.0, "one"), (2.0, "other")):
        scene.add_urdf("robot:hopper", position=(x, 0, 1), joints={"knee": 0.4}, name=name)
    scene.couple("one/hip", "other/hip", ratio=-1.0)
    problem = scene.build()
    q, v = problem.state(v={"one": {"hip": 1.0}, "other": {"hip": -1.0}})
    run = mbvi.simulate(problem.at(q, v), scheme, step=1e-3, duration=0.1)
    assert run.loop_gap().max() <= 1e-13
    kinetic = run.energies()[0]
    assert np.ptp(kinetic) <= 2e-2 * kinetic[0]
    # both halves are the same mechanism in a mirror of time
    hips = [
        problem.model("one").idx_qs[problem.model("one").getJointId("hip")] + k for k in (0, problem.system.nq // 2)
    ]
    np.testing.assert_allclose(run.q[:, hips[0]], -run.q[:, hips[1]], rtol=0.0, atol=1e-12)


def test_what_the_crank_weighs_is_what_its_equation_has():
    """The oracle itself: its inertia is that of the kinetic energy of the boxes."""
    problem = four_bar().build()
    v = problem.system.tangent(problem.q0, np.random.default_rng(0).normal(size=problem.system.nv))
    # the boxes turn about -y as the angle grows
    speed = -v[4]
    np.testing.assert_allclose(problem.system.kinetic_energy(problem.q0, v), 0.5 * inertia(START) * speed**2, rtol=1e-9)


def hinge_speeds(run):
    """How fast both sides of each hinge of a four-bar part, from positions and velocities of its boxes, shape (n,)."""
    ends = [np.array([[-0.5, 0, 0], [0.5, 0, 0]]) * length for length in LENGTHS[:3]]
    worst = []
    for q, v in zip(run.q.reshape(-1, 3, 7), run.v.reshape(-1, 3, 6), strict=True):
        speeds = []
        for place, rate, arms in zip(q, v, ends, strict=True):
            turn = pin.Quaternion(place[3:]).toRotationMatrix()
            speeds.append(rate[:3] + np.cross(rate[3:], arms) @ turn.T)
        crank, coupler, rocker = speeds
        worst.append(max(np.abs(crank[1] - coupler[0]).max(), np.abs(coupler[1] - rocker[1]).max()))
    return np.array(worst)


@pytest.mark.parametrize("scheme", [mbvi.Centered(), mbvi.Centered(project_positions=True)], ids=repr)
def test_velocities_keep_the_loops_after_impacts_and_vanish_at_rest(scheme):
    """The mean velocity of a step keeps the loops; a jump must not leave a part that changes its sign for ever."""
    problem = four_bar(0.5, floor=-0.3).build()
    errors = []
    for step in (2e-3, 1e-3):
        run = mbvi.simulate(problem, scheme, step=step, duration=1.5)
        errors.append(hinge_speeds(run).max())
        assert run.impacts[0].time < 1.0
    assert np.abs(run.v[-1]).max() < 1e-12
    assert errors[1] < 1e-3 and errors[1] < 0.3 * errors[0]


def test_a_damped_loop_comes_to_rest(tmp_path):
    """A crank and a rod on a slide, with springs and much damping, without gravity: in compiled code."""
    file = tmp_path / "crank.xml"
    file.write_text("""<mujoco><option gravity="0 0 0"/><worldbody>
      <body name="crank"><joint name="a" axis="0 1 0" damping="0.3" stiffness="40" springref="60"/>
        <geom type="capsule" fromto="0 0 0 0.2 0 0" size=".01" mass="0.1" contype="0" conaffinity="0"/>
        <body name="rod" pos="0.2 0 0"><joint name="b" axis="0 1 0" damping="0.05"/>
        <geom type="capsule" fromto="0 0 0 0.4 0 0" size=".01" mass="0.1" contype="0" conaffinity="0"/></body></body>
      <body name="slide" pos="0.6 0 0"><joint name="c" type="slide" axis="1 0 0" damping="1"/>
        <geom type="box" size=".02 .02 .02" mass="0.2" contype="0" conaffinity="0"/></body></worldbody>
      <equality><connect body1="rod" body2="slide" anchor="0.4 0 0"/></equality></mujoco>""")
    scene = mbvi.Scene(gravity=(0, 0, 0))
    scene.add_mjcf(file)
    run = mbvi.simulate(scene.build(), mbvi.Centered(), step=2e-3, duration=2.0)
    assert np.abs(run.v).max() > 1.0
    assert np.abs(run.v[-1]).max() < 1e-6
    # the end of the rod is as fast as the slide, also while the spring turns them fast
    crank, rod = run.q[:, 0], run.q[:, 0] + run.q[:, 1]
    end = -0.2 * np.sin(crank) * run.v[:, 0] - 0.4 * np.sin(rod) * (run.v[:, 0] + run.v[:, 1])
    assert np.abs(end - run.v[:, 2]).max() < 1e-9


ARM = """<robot name="arm"><link name="base"/><link name="rod"><inertial><origin xyz="0.4 0 0"/><mass value="3"/>
  <inertia ixx="0.02" iyy="0.2" izz="0.2" ixy="0" ixz="0" iyz="0"/></inertial>
  <collision><geometry><sphere radius="0.05"/></geometry></collision></link>
  <joint name="axle" type="revolute"><parent link="base"/><child link="rod"/><axis xyz="0 0 1"/>
  <limit lower="-1" upper="1" effort="1" velocity="1"/><dynamics damping="{}"/></joint></robot>"""


@pytest.mark.parametrize("z", [0.1, 10.0, 1e4])
def test_damping_of_a_joint_acts_on_what_is_welded_to_its_link(tmp_path, z):
    """A rod and a ball have one moment of inertia; the same decay."""
    projecting = mbvi.Centered(project_positions=True)
    h, speed, inertia = 1e-3, 1e-7, 0.2 + 3.0 * 0.4**2 + 0.4 * 2.0 * 0.1**2 + 2.0 * 0.8**2
    (tmp_path / "arm.urdf").write_text(ARM.format(z * inertia / h))
    scene = mbvi.Scene(gravity=(0, 0, 0), friction=0.1)
    scene.add_urdf(tmp_path / "arm.urdf", "fixed", velocity={"axle": speed}, name="arm")
    scene.add_sphere(0.1, 2.0, position=(0.8, 0, 0), velocity=(0, 0.8 * speed, 0), name="ball")
    scene.weld("arm/rod", "ball")
    for scheme, decay in ((mbvi.Paoli(), 1.0 / (1.0 + z)), (projecting, (1.0 + z) / (1.0 + 0.5 * z) ** 4)):
        problem = scene.build()
        v = problem.system.tangent(problem.q0, np.array([speed, 0, 0.8 * speed, 0, 0, 0, speed]))
        run = mbvi.simulate(problem.at(problem.q0, v), scheme, step=h, duration=h)
        assert run.v[-1, 0] == pytest.approx(decay * speed, abs=1e-9 * speed)
        # the weld changes the momentum of the ball
        _, pull, *_ = run.loop_forces("weld")[-1]
        expected = 2.0 * (run.v[-1, 2] - v[2]) / h
        assert pull == pytest.approx(expected, rel=z * z if scheme is projecting else 1e-9)


GEARED = """<mujoco><option gravity="0 0 0"/><worldbody>
<body><joint name="one" axis="0 1 0"/><inertial pos=".1 0 0" mass="2" diaginertia=".02 .02 .02"/></body>
<body pos="1 0 0"><joint name="two" axis="0 1 0"/><inertial pos=".1 0 0" mass="1" diaginertia=".01 .01 .01"/></body>
</worldbody><equality><joint joint1="one" joint2="two" polycoef="0 .5 0 0 0"/></equality></mujoco>"""


@pytest.mark.parametrize("scheme", [*SCHEMES, mbvi.Adaptive(1e-4)], ids=repr)
def test_a_start_velocity_that_opens_a_loop_becomes_the_nearest_that_does_not(scheme, tmp_path):
    """A bar on a pin keeps its angular momentum about it, geared joints the share of each; both turn on steadily."""
    scene = mbvi.Scene(gravity=(0, 0, 0))
    scene.add_box((0.4, 0.04, 0.04), 1.0, position=(0.2, 0, 0), name="bar")
    scene.hinge("world", "bar", at=(0, 0, 0), axis=(0, 1, 0))
    bar = scene.build()
    spin = -0.2 / ((0.4**2 + 0.04**2) / 12 + 0.2**2)
    (tmp_path / "geared.xml").write_text(GEARED)
    scene = mbvi.Scene(gravity=(0, 0, 0))
    scene.add_mjcf(tmp_path / "geared.xml")
    geared = scene.build()
    # inertias 0.04 and 0.02; the second turns twice as fast, in proportion to what both have together
    two = (0.5 * 0.04 * 1.0 + 0.02 * 0.5) / (0.25 * 0.04 + 0.02)
    given = {} if isinstance(scheme, mbvi.Adaptive) else {"step": 1e-3}
    for problem, v, turning, speeds in (
        (bar, [0, 0, 1.0, 0, 0, 0], [4], [spin]),
        (geared, [1.0, 0.5], [0, 1], [0.5 * two, two]),
    ):
        run = mbvi.simulate(problem.at(problem.q0, v), scheme, duration=0.05, **given)
        # schemes of order 1 lose a share of the order of a step
        np.testing.assert_allclose(run.v[:, turning], np.tile(speeds, (len(run.t), 1)), rtol=1e-3)
        np.testing.assert_allclose(run.energy(), run.energy()[0], rtol=2e-3)
        run.save(tmp_path / "run.h5")
        np.testing.assert_array_equal(mbvi.load(tmp_path / "run.h5").v, run.v)


def test_rollouts_start_with_velocities_that_keep_loops(tmp_path):
    (tmp_path / "geared.xml").write_text(GEARED)
    scene = mbvi.Scene(gravity=(0, 0, 0))
    scene.add_mjcf(tmp_path / "geared.xml")
    problem = scene.build()
    starts = np.array([[1.0, 0.5], [0.3, 0.6], [-1.0, 0.5]])
    found = mbvi.rollout(problem, np.tile(problem.q0, (3, 1)), starts, steps=3, step=1e-3, scheme=mbvi.Centered())
    two = (0.5 * 0.04 * starts[:, :1] + 0.02 * starts[:, 1:]) / (0.25 * 0.04 + 0.02)
    np.testing.assert_allclose(found.v, np.repeat((two * [0.5, 1.0])[:, None], 4, axis=1), rtol=1e-9, atol=1e-12)
