"""`mbvi.sensitivity` of systems with loops and couplings, against plain equations and differences of runs."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import mbvi
from support.derivatives import agrees

G = 9.81


def pendulum(start, mass, inertia, arm, duration):
    """Angle and speed of a compound pendulum, and their derivatives by both at the start and by the mass."""
    fall, total = mass * G * arm, inertia + mass * arm**2
    by_mass = G * arm / total - fall * arm**2 / total**2

    def rates(t, y):
        angle, speed, X = y[0], y[1], y[2:].reshape(2, 3)
        A = np.array([[0, 1], [-fall / total * np.cos(angle), 0]])
        dX = A @ X
        dX[1, 2] -= by_mass * np.sin(angle)
        return np.concatenate([[speed, -fall / total * np.sin(angle)], dX.ravel()])

    begin = np.concatenate([start, np.eye(2, 3).ravel()])
    end = solve_ivp(rates, (0, duration), begin, method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
    return end[:2], end[2:].reshape(2, 3)


@pytest.mark.parametrize("seed", range(2))
def test_a_box_that_swings_about_a_closed_hinge(seed):
    rng = np.random.default_rng(seed)
    angle, speed, arm, mass = rng.uniform(0.3, 1.2), rng.normal(), rng.uniform(0.3, 0.6), rng.uniform(0.5, 2)
    out, scene = np.array([np.sin(angle), 0, -np.cos(angle)]), mbvi.Scene()
    scene.add_box((0.2, 0.3, 0.1), mass=mass, position=arm * out, name="load")
    scene.hinge("world", "load", at=(0, 0, 0), axis=(0, 1, 0))
    problem = scene.build()
    # a positive turn about y takes x down
    turn = np.array([0, -1.0, 0])
    moves = np.concatenate([np.cross(turn, arm * out), turn])
    given = problem.at(problem.q0, speed * moves)
    found = mbvi.sensitivity(given, mbvi.EventDriven(1e-11), duration=0.8, wrt=["state", "mass of load"])
    # turned by an angle, the velocity turns too
    turned = np.concatenate([np.cross(turn, np.cross(turn, arm * out)) * speed, np.zeros(3)])
    columns = np.column_stack([np.concatenate([moves, turned]), np.concatenate([0 * moves, moves])])
    by_start, by_mass = found.matrix[:, :12] @ columns, found.matrix[:, 12:]
    end, exact = pendulum((angle, speed), mass, mass * (0.2**2 + 0.1**2) / 12, arm, 0.8)
    assert found.run.v[-1] @ np.concatenate([np.zeros(3), turn]) == pytest.approx(end[1], abs=1e-9)
    # of the angle and the spin about y
    rows = np.hstack([by_start, by_mass])[[4, 10]] * -1.0
    np.testing.assert_allclose(rows, exact, rtol=0, atol=1e-7 * np.abs(exact).max())
    # what would open the hinge is left out
    assert np.linalg.matrix_rank(found.matrices[0][:, :12], tol=1e-9) == 2


@pytest.mark.slow(seconds=25)
def test_connected_boxes_that_bounce():
    scene = mbvi.Scene(restitution=0.6)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_box((0.2, 0.1, 0.1), mass=1.0, position=(0, 0, 0.7), angular_velocity=(0, 1.5, 0.3), name="a")
    scene.add_box((0.2, 0.1, 0.1), mass=1.3, position=(0.3, 0, 0.7), name="b")
    scene.connect("a", "b", at=(0.15, 0, 0.7))
    found = mbvi.sensitivity(scene.build(), duration=0.5, wrt=["state", "restitution", "mass of a", "offset of floor"])
    assert len(found.run.impacts) > 5
    assert found.check(2).error.max() < 1e-6


@pytest.mark.slow(seconds=15)
def test_coupled_joints_that_strike_a_wall():
    scene = mbvi.Scene(restitution=0.7)
    scene.add_halfspace((-1, 0, 0), offset=-0.3, name="wall")
    scene.add_urdf(mbvi.robot("double_pendulum"), base="fixed", name="arm", joints={"shoulder": 0.8, "elbow": 0.4})
    scene.couple("arm/elbow", "arm/shoulder", ratio=0.5)
    found = mbvi.sensitivity(scene.build(), duration=1.5, wrt=["state", "restitution", "gravity"])
    assert found.run.impacts
    assert found.check(2).error.max() < 1e-6


def test_a_contact_that_stays_closed_beside_a_loop():
    """A ball slides on the floor and carries a box, which swings about its centre."""
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_sphere(radius=0.1, position=(0, 0, 0.1), velocity=(0.4, 0, 0), name="ball")
    scene.add_box((0.1, 0.1, 0.1), mass=0.5, position=(0.1, 0, 0.5), velocity=(0.4, 0, 0), name="bob")
    scene.connect("ball", "bob", at=(0, 0, 0.1))
    scene.exclude("ball", "bob")
    found = mbvi.sensitivity(scene.build(), duration=0.2, wrt=["state", "mass of bob"])
    assert found.check(2).error.max() < 1e-6


MIMIC = """<robot name="mimic"><link name="base"/>
  <link name="upper"><inertial><mass value="1"/><origin xyz="0 0 -.2"/>
    <inertia ixx=".02" iyy=".02" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="lower"><inertial><mass value=".7"/><origin xyz="0 0 -.2"/>
    <inertia ixx=".02" iyy=".02" izz=".01" ixy="0" ixz="0" iyz="0"/></inertial>
    <collision><origin xyz="0 0 -.4"/><geometry><sphere radius=".05"/></geometry></collision></link>
  <joint name="one" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
    <limit lower="-1.2" upper="1.2" effort="9" velocity="9"/></joint>
  <joint name="two" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0 0 -.4"/>
    <axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="9" velocity="9"/>
    <mimic joint="one" multiplier="1.5" offset=".1"/></joint></robot>"""


def test_a_mimic_joint_that_strikes_a_wall(tmp_path):
    (tmp_path / "mimic.urdf").write_text(MIMIC)
    scene = mbvi.Scene(restitution=0.6)
    scene.add_halfspace((1, 0, 0), offset=-0.1, name="wall")
    scene.add_urdf(tmp_path / "mimic.urdf", base="fixed", name="arm", joints={"one": -0.5})
    found = mbvi.sensitivity(scene.build(), duration=1.0, wrt=["state", "restitution", "mass of arm/two"])
    assert found.run.impacts
    assert found.check(2).error.max() < 1e-7


@pytest.mark.slow(seconds=10)
def test_connected_boxes_that_land_at_once_have_a_derivative_on_each_side():
    """Each lands on a corner: either may strike first, and the connection makes the order matter."""
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0, 0, 1), name="floor")
    down = Rotation.align_vectors([[0, 0, -1]], [[1, 1.2, 0.9]])[0].as_quat()
    for name, x in (("a", -0.2), ("b", 0.2)):
        scene.add_box((0.1, 0.12, 0.09), mass=1 + x, position=(x, 0, 0.4), rotation=down, name=name)
    scene.connect("a", "b", at=(0, 0, 0.4))
    problem, n = scene.build(), 12
    found = mbvi.sensitivity(problem, duration=0.3, one_sided=True)
    assert sorted(branch.order[0] for branch in found.branches) == [("a | floor",), ("b | floor",)]
    onto = mbvi.sensitivity(problem, duration=0.05).matrices[0]
    lowers = onto @ np.concatenate([[0, 0, 0, 0, 0.3, 0], np.random.default_rng(0).normal(size=18)])
    for x in (lowers, -lowers):
        branch, ends = found.branch(x), []
        for h in (1e-5, 2e-5):
            q = problem.system.integrate(problem.q0, h * x[:n])
            varied = problem.at(q, problem.system.tangent(q, problem.v0 + h * x[n:]))
            run = mbvi.simulate(varied, mbvi.EventDriven(1e-12), duration=0.3)
            moved = problem.system.difference(branch.run.q[-1], run.q[-1]), run.v[-1] - branch.run.v[-1]
            ends.append(np.concatenate(moved) / h)
        agrees(2 * ends[0] - ends[1], branch.matrix @ x, 1e-6)


def test_what_is_refused():
    scene = mbvi.Scene(friction=0.3)
    scene.add_halfspace((0, 0, 1), name="floor")
    for name, x in (("a", 0.0), ("b", 1.0)):
        scene.add_box((0.1, 0.1, 0.1), mass=1.0, position=(x, 0, 1), name=name)
    scene.connect("a", "b", at=(0.5, 0, 1))
    with pytest.raises(mbvi.SensitivityError, match="loops or coupled joints and friction"):
        mbvi.sensitivity(scene.build(), duration=0.1)
