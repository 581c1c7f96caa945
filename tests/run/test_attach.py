"""Bodies that are attached and released while a simulator runs."""

import numpy as np
import pinocchio as pin
import pytest

import mbvi

STEP = 1e-3
GRAVITY = np.array([0, 0, -9.81])


def rotation(quaternion):
    return pin.Quaternion(quaternion).toRotationMatrix()


def two_boxes(gravity=(0, 0, 0)):
    """Two boxes that fly and spin, and their masses and inertias."""
    scene = mbvi.Scene(gravity=gravity)
    scene.add_box((0.2, 0.3, 0.4), 2.0, position=(0, 0, 0), name="a")
    scene.add_box((0.3, 0.1, 0.2), 1.0, position=(0.5, 0.2, 0.1), name="b")
    problem = scene.build()
    v = np.array([1.0, 0, 0.5, 0.3, -1.0, 2.0, -1.0, 0.2, 0, 3.0, 0.5, -0.7])
    return problem.at(problem.q0, v)


INERTIAS = [2.0 / 12 * np.diag([0.25, 0.2, 0.13]), 1.0 / 12 * np.diag([0.05, 0.13, 0.1])]


def momenta(q, v):
    """Momentum and angular momentum about the origin, from the state alone."""
    total = np.zeros(6)
    for mass, inertia, place, rate in zip((2.0, 1.0), INERTIAS, q.reshape(2, 7), v.reshape(2, 6), strict=True):
        turn = rotation(place[3:])
        total[:3] += mass * rate[:3]
        total[3:] += mass * np.cross(place[:3], rate[:3]) + turn @ inertia @ rate[3:]
    return total


def energy(v):
    return sum(
        0.5 * mass * rate[:3] @ rate[:3] + 0.5 * rate[3:] @ inertia @ rate[3:]
        for mass, inertia, rate in zip((2.0, 1.0), INERTIAS, v.reshape(2, 6), strict=True)
    )


def relative(q):
    """Where b is, as a sees it."""
    a, b = (pin.XYZQUATToSE3(place) for place in q.reshape(2, 7))
    return (a.inverse() * b).homogeneous


def test_a_weld_keeps_momentum_and_loses_the_energy_of_the_relative_motion():
    sim = mbvi.Simulator(two_boxes(), mbvi.Centered(), step=STEP)
    sim.step(10)
    q, v = sim.q.copy(), sim.v.copy()
    before = momenta(q, v)
    assert sim.attach("a", "b") == "weld"
    np.testing.assert_array_equal(sim.q, q)
    np.testing.assert_allclose(momenta(sim.q, sim.v), before, atol=1e-13)
    # the motion of one rigid body with both momenta, in plain numbers
    places = q.reshape(2, 7)
    centre = (2.0 * places[0, :3] + places[1, :3]) / 3.0
    whole = np.zeros((3, 3))
    for mass, inertia, place in zip((2.0, 1.0), INERTIAS, places, strict=True):
        turn, arm = rotation(place[3:]), place[:3] - centre
        whole += turn @ inertia @ turn.T + mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    spin = np.linalg.solve(whole, before[3:] - np.cross(centre, before[:3]))
    for place, rate in zip(places, sim.v.reshape(2, 6), strict=True):
        np.testing.assert_allclose(rate[:3], before[:3] / 3.0 + np.cross(spin, place[:3] - centre), atol=1e-12)
        np.testing.assert_allclose(rotation(place[3:]) @ rate[3:], spin, atol=1e-12)
    assert energy(sim.v) < energy(v)
    held = relative(sim.q)
    sim.step(500)
    np.testing.assert_allclose(relative(sim.q), held, atol=1e-12)
    np.testing.assert_allclose(momenta(sim.q, sim.v), before, atol=1e-5)


@pytest.mark.parametrize("axis", [None, (0, 1, 1)])
def test_a_point_and_a_hinge_leave_their_motions(axis):
    problem, at = two_boxes(), (0.25, 0.1, 0.05)
    sim = mbvi.Simulator(problem, mbvi.Centered(), step=STEP)
    before, v = momenta(sim.q, sim.v), sim.v.copy()
    name = sim.attach("a", "b", at=at, axis=axis)
    np.testing.assert_allclose(momenta(sim.q, sim.v), before, atol=1e-13)

    def apart(q):
        """Where both bodies have the point and the axis, in the world."""
        ends = []
        for place, start in zip(q.reshape(2, 7), problem.q0.reshape(2, 7), strict=True):
            now, then = pin.XYZQUATToSE3(place), pin.XYZQUATToSE3(start)
            moved = now * then.inverse()
            ends.append(np.concatenate([moved.act(np.array(at)), moved.rotation @ np.array(axis or (0, 0, 0))]))
        return ends[0] - ends[1]

    # what the connection leaves free keeps some of its motion
    turning = [rotation(p[3:]) @ r[3:] for p, r in zip(sim.q.reshape(2, 7), sim.v.reshape(2, 6), strict=True)]
    along = np.eye(3) if axis is None else np.array([axis]) / np.linalg.norm(axis)
    assert (np.abs(along @ (turning[0] - turning[1])) > 1e-2).all()
    assert not np.allclose(sim.v, v)
    sim.step(300)
    np.testing.assert_allclose(apart(sim.q), 0.0, atol=1e-12)
    sim.detach(name)
    sim.step(100)
    assert np.abs(apart(sim.q)).max() > 1e-3


def test_a_released_body_flies_on_and_collides_again():
    scene = mbvi.Scene(restitution=1.0)
    scene.add_box((0.2, 0.2, 0.2), position=(0, 0, 1.0), fixed=True, name="ceiling")
    scene.add_box((0.1, 0.1, 0.1), 1.0, position=(0, 0, 0.7), velocity=(0, 0, 0), name="load")
    scene.weld("world", "load", name="magnet")
    sim = mbvi.Simulator(scene.build(), mbvi.Centered(), step=STEP)
    start = sim.q.copy()
    sim.step(100)
    np.testing.assert_allclose(sim.q, start, atol=1e-14)
    sim.detach("magnet")
    sim.step(100)
    assert sim.q[2] == pytest.approx(0.7 - 0.5 * 9.81 * 0.1**2, abs=1e-12)
    assert sim.t == pytest.approx(0.2, abs=1e-12)
    sim.reset()
    sim.step(100)
    np.testing.assert_allclose(sim.q, start, atol=1e-14)


@pytest.mark.parametrize("link", ["wrist", "right_finger"])
def test_a_robot_grasps_a_box_as_the_equations_say(link):
    """M (v+ - v-) = J' lambda with J v+ = 0, J from Pinocchio's frames and the box's own velocity."""
    scene = mbvi.Scene()
    robot = scene.add_urdf("robot:arm", base="fixed", name="arm", joints=None)
    problem = scene.build()
    model = problem.model("arm")
    data = model.createData()
    q = problem.q0.copy()
    q[:], q[-2:] = 0.3, 0.02
    pin.framesForwardKinematics(model, data, q)
    pose = data.oMf[model.getFrameId(link)]
    scene.add_box((0.05, 0.05, 0.05), 0.4, position=pose.translation + np.array([0, 0, -2.0]), name="box")
    problem = scene.build()
    nq, nv = model.nq, model.nv
    start, v = problem.q0.copy(), np.linspace(-1.0, 1.0, problem.system.nv)
    start[:nq] = q
    sim = mbvi.Simulator(problem.at(start, v), mbvi.Centered(), step=STEP)
    sim.attach(f"{robot}/{link}", "box")
    after = sim.v.copy()
    arm = pin.computeFrameJacobian(model, data, q, model.getFrameId(link), pin.LOCAL_WORLD_ALIGNED)
    lever = start[nq : nq + 3] - pose.translation
    J = np.zeros((6, nv + 6))
    # velocity of the box less that of the link's point at the box
    J[:3, :nv] = -(arm[:3] - pin.skew(lever) @ arm[3:])
    J[3:, :nv] = -arm[3:]
    turn = rotation(start[nq + 3 : nq + 7])
    J[:3, nv : nv + 3], J[3:, nv + 3 :] = np.eye(3), turn
    M = np.zeros((nv + 6, nv + 6))
    upper = np.triu(pin.crba(model, data, q))
    M[:nv, :nv] = upper + np.triu(upper, 1).T
    M[nv : nv + 3, nv : nv + 3] = 0.4 * np.eye(3)
    M[nv + 3 :, nv + 3 :] = 0.4 / 6 * 0.05**2 * np.eye(3)
    kkt = np.block([[M, -J.T], [J, np.zeros((6, 6))]])
    expected = np.linalg.solve(kkt, np.concatenate([M @ v, np.zeros(6)]))[: nv + 6]
    np.testing.assert_allclose(after, expected, atol=1e-10)


def test_released_bodies_collide_also_where_the_problem_is_from_a_file(tmp_path):
    """A box that is held above another one falls onto it when it is released; pairs that a user excludes stay so."""
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_box((0.2, 0.2, 0.2), 1.0, position=(0, 0, 0.1), name="below")
    scene.add_box((0.2, 0.2, 0.2), 1.0, position=(0, 0, 0.35), name="above")
    scene.weld("below", "above", name="glue")
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=STEP, duration=0.01, progress=False)
    run.save(tmp_path / "run.h5")
    sim = mbvi.Simulator(mbvi.load(tmp_path / "run.h5").problem, mbvi.Paoli(), step=STEP)
    sim.step(10)
    sim.detach("glue")
    sim.step(400)
    assert 0.299 < sim.q[9] < 0.301
    again = mbvi.Scene()
    again.add_box((0.2, 0.2, 0.2), 1.0, position=(0, 0, 0.1), fixed=True, name="below")
    again.add_box((0.2, 0.2, 0.2), 1.0, position=(0, 0, 0.35), name="above")
    again.exclude("below", "above")
    again.weld("below", "above", name="glue")
    free = mbvi.Simulator(again.build(), mbvi.Paoli(), step=STEP)
    free.detach("glue")
    free.step(400)
    assert free.q[2] < 0.0


def test_actuators_go_on_and_are_set_as_before(tmp_path):
    """A slide of 1 kg under a motor takes a box of 1 kg along, and loses it again; the problem sets the input."""
    file = tmp_path / "slide.xml"
    file.write_text("""<mujoco><option gravity="0 0 0"/><worldbody><body name="slide">
      <joint name="z" type="slide" axis="0 0 1"/><geom size=".1" mass="1"/></body></worldbody>
      <actuator><motor name="motor" joint="z"/></actuator></mujoco>""")
    scene = mbvi.Scene(gravity=(0, 0, 0))
    scene.add_mjcf(file, name="robot")
    scene.add_box((0.1, 0.1, 0.1), 1.0, position=(1, 0, 0), name="box")
    problem = scene.build()
    sim = mbvi.Simulator(problem, mbvi.Paoli(), step=STEP)
    speed = 0.0
    problem.ctrl["motor"] = 2.0
    sim.step(100)
    assert sim.v[0] == pytest.approx(speed := speed + 0.2, abs=1e-12)
    name = sim.attach("robot/slide", "box", at=(1, 0, 0))
    # the point is the centre of the box
    assert sim.v[0] == pytest.approx(speed := 0.5 * speed, abs=1e-12)
    sim.step(100)
    assert sim.v[0] == pytest.approx(speed := speed + 0.1, abs=1e-12)
    problem.ctrl["motor"] = -2.0
    sim.step(100)
    assert sim.v[0] == pytest.approx(speed := speed - 0.1, abs=1e-12)
    sim.detach(name)
    sim.step(100)
    assert sim.v[0] == pytest.approx(speed - 0.2, abs=1e-12)


def test_what_cannot_be_switched_is_refused():
    sim = mbvi.Simulator(two_boxes(), mbvi.Centered(), step=STEP)
    with pytest.raises(mbvi.InputError, match="is no connection; known are none"):
        sim.detach("glue")
    with pytest.raises(mbvi.InputError, match="needs a point of it too"):
        sim.attach("a", "b", axis=(0, 0, 1))
    with pytest.raises(mbvi.InputError, match="is no body of this scene"):
        sim.attach("a", "nobody")
    given = mbvi.Simulator(mbvi.reference.bouncing_ball(0.5).problem, mbvi.Paoli(), step=STEP)
    with pytest.raises(mbvi.InputError, match="build the problem from a Scene"):
        given.attach("a", "b")
