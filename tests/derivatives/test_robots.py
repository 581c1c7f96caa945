"""`mbvi.sensitivity` on robots and free bodies, against differences of runs at tolerance 1e-12."""

import numpy as np
import pytest

import mbvi
from support.paths import ROBOTS, real_robot
from support.robot_problems import problem_of, tilted_quadruped


def hopper(e):
    scene = mbvi.Scene(restitution=e, plane="xz")
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf("robot:hopper", position=(0, 0, 1), joints={"knee": 0.4})
    return scene.build()


def ur5():
    """A UR5 that swings into limits of its joints; its hulls do not touch each other here."""
    scene = mbvi.Scene(restitution=0.5)
    scene.add_urdf(real_robot("ur_description/urdf/ur5_robot.urdf"), base="fixed", joints={"shoulder_lift_joint": -1.0})
    problem = scene.build()
    limits = [c for c in problem.constraints.constraints if "Limit" in type(c).__name__]
    return mbvi.Problem(problem.system, limits, problem.q0, [3.0, -2.0, 4.0, 5.0, -6.0, 8.0], restitution=0.5)


def compared(problem, duration, tolerance=1e-6, scheme=1e-10, **given):
    """The derivative, after a comparison along one direction and with the run of `simulate`."""
    found = mbvi.sensitivity(problem, mbvi.EventDriven(scheme), duration=duration, **given)
    check = found.check(1)
    assert check.error.max() < tolerance, check
    run = mbvi.simulate(problem, mbvi.EventDriven(scheme), duration=duration)
    assert [run.t.tobytes(), run.q.tobytes(), run.v.tobytes()] == [
        found.run.t.tobytes(), found.run.q.tobytes(), found.run.v.tobytes(),
    ]  # fmt: skip
    assert len(found.matrices) == len(run.t)
    return found


def test_a_tilted_quadruped_lands_on_three_feet():
    base, calf = "quadruped/root_joint", "quadruped/FL_calf_joint"
    names = ["mass of " + base, "centre of mass of " + base, "inertia of " + calf, "torque of " + calf]
    names += ["offset of floor", "gravity"]
    found = compared(tilted_quadruped(), 0.12, wrt=["state", *names])
    assert found.matrix.shape == (36, 36 + 15) and len(found.run.impacts) == 4


def test_a_hopper_in_a_plane_bounces_on_rows_that_act_as_one():
    found = compared(hopper(0.5), 0.42, wrt=("restitution", "state"))
    assert len(found.run.impacts) > 5
    assert found.columns == {"restitution": slice(0, 1), "state": slice(1, 11)}


def test_the_columns_of_named_joints_are_those_of_all():
    problem = hopper(0.5)
    every, some = (mbvi.sensitivity(problem, duration=0.39, bodies=bodies).matrix for bodies in (None, ["hopper/knee"]))
    assert np.abs(some - every[:, [4, 9]]).max() < 1e-8 * np.abs(some).max()


def test_restitution_of_one_pair():
    """That of all pairs is the sum of those of each, and that of a pair that does not touch is zero."""
    scene = mbvi.Scene(restitution=0.6)
    scene.add_halfspace((0, 0, 1), name="floor")
    for name, x, z in (("a", 0.0, 0.4), ("b", 0.05, 1.0)):
        scene.add_sphere(radius=0.2, mass=1.0, position=(x, 0, z), name=name)
    scene.set_restitution("a", "b", 0.3)
    pairs = [f"restitution of {pair}" for pair in ("a | floor", "a | b", "b | floor")]
    found = compared(scene.build(), 0.4, tolerance=1e-7, wrt=["restitution", *pairs])
    assert {name for impact in found.run.impacts for name in impact.constraints} == {"a | floor", "a | b"}
    assert np.abs(found.matrix @ [1, -1, -1, -1]).max() < 1e-12
    assert found.matrix[:, 1:3].any(axis=0).all() and not found.matrix[:, 3].any()


@pytest.mark.slow(seconds=5)
def test_solo_at_its_limits_and_on_the_floor():
    assert len(compared(problem_of("solo12", "limits", 0.5), 0.06).run.impacts) == 4


@pytest.mark.slow(seconds=5)
def test_a_ur5_at_its_limits():
    kinds = "mass", "centre of mass", "inertia", "torque"
    assert len(compared(ur5(), 1.5, wrt=["state", *(f"{kind} of ur5/elbow_joint" for kind in kinds)]).run.impacts) >= 2


def test_free_bodies_spheres_and_a_force_from_outside():
    """A turning box that strikes a floor, and two balls that strike each other."""
    scene = mbvi.Scene(restitution=0.6)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_box((0.3, 0.5, 0.7), mass=2.0, position=(0, 0, 0.6), angular_velocity=(1.2, 3.0, 2.4), name="box")
    scene.add_sphere(radius=0.2, mass=1.0, position=(2, 0, 0.6), name="lower")
    scene.add_sphere(radius=0.1, mass=0.5, position=(2.1, 0.02, 1.2), velocity=(0, 0, -4), name="upper")
    scene.add_force("box", lambda t, q, v: np.array([np.sin(3 * q[0]), -0.3 * v[1], 0.0, 0.0, 0.1 * v[3], 0.0]))
    found = compared(scene.build(), 0.3, tolerance=1e-7)
    assert {name for impact in found.run.impacts for name in impact.constraints} >= {"box | floor", "lower | upper"}


def test_a_control_of_a_robot_and_damped_joints(tmp_path):
    scene = mbvi.Scene(restitution=0.4)
    scene.add_halfspace((-1, 0, 0), offset=-0.2, name="wall")
    control = mbvi.PDControl({"shoulder": 1.0}, stiffness=3.0, damping=0.2)
    start = {"joints": {"shoulder": 0.3}, "velocity": {"shoulder": 2.0, "elbow": 1.0}}
    urdf = (ROBOTS / "double_pendulum" / "double_pendulum.urdf").read_text()
    damped = tmp_path / "damped.urdf"
    damped.write_text(urdf.replace("</joint>", '<dynamics damping="0.3"/></joint>'))
    scene.add_urdf(damped, base="fixed", control=control, **start)
    assert len(compared(scene.build(), 1.5, tolerance=1e-7).run.impacts) > 0


def test_lengths_may_have_any_unit():
    """Millimetres instead of metres, exactly: powers of two leave no rounding."""
    ends = []
    for length in (1.0, 2.0**10):
        scene = mbvi.Scene(gravity=(0, 0, -9.81 * length), restitution=0.5)
        scene.add_halfspace((0, 0, 1), name="floor")
        scene.add_box(
            (0.25 * length, 0.5 * length, 0.75 * length), mass=1.0, position=(0, 0, 0.75 * length),
            angular_velocity=(0.5, 1.0, 0.25),
        )  # fmt: skip
        units = np.tile([length] * 3 + [1.0] * 3, 2)
        found = mbvi.sensitivity(scene.build(), duration=0.375)
        assert found.run.impacts
        ends.append(found.matrix / units[:, None] * units)
    assert np.abs(ends[0] - ends[1]).max() < 1e-9 * np.abs(ends[0]).max()
