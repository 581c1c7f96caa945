"""Torsional and rolling friction in the compiled loop: exact motions, what contacts record, and what it refuses."""

import pickle

import numpy as np
import pytest

import mbvi
from mbvi.run.fixed_steps import taking
from mbvi.run.loop.step_loop import FULL
from mbvi.schemes.kernels.records import DONE
from support.loop_arguments import swaying

G, R, M = 9.81, 0.1, 2.0
INERTIA = 0.4 * M * R**2
SCHEMES = [mbvi.Paoli(), mbvi.MoreauJean(), mbvi.Centered(), mbvi.Centered(project_positions=True)]
TOP = """<robot name="r"><link name="base"/><link name="slide"><inertial><mass value="0.5"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="top"><inertial><mass value="1.5"/><inertia ixx=".1" iyy=".1" izz=".1" ixy="0" ixz="0" iyz="0"/>
  </inertial><collision><geometry><sphere radius="0.1"/></geometry></collision></link>
  <joint name="z" type="prismatic"><parent link="base"/><child link="slide"/><axis xyz="0 0 1"/>
  <limit lower="-9" upper="9" effort="1" velocity="1"/></joint>
  <joint name="turn" type="continuous"><parent link="slide"/><child link="top"/><axis xyz="0 0 1"/></joint>
  </robot>"""


def run_of(problem, scheme, duration, **options):
    return mbvi.simulate(problem, scheme, step=1e-3, duration=duration, progress=False, **options)


def took_every_step(loop):
    return loop is not None and loop.codes[DONE] > 0 and loop.codes[DONE] + loop.codes[FULL] == loop.codes.sum()


@pytest.mark.parametrize("scheme", SCHEMES, ids=str)
def test_a_ball_rolls_to_rest_as_the_torque_says(scheme, loops):
    length, speed, spin, torsion = 0.004, 0.2, 2.0, 0.01
    scene = mbvi.Scene(friction=(0.5, torsion, length))
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_sphere(R, M, position=(0, 0, R), name="ball")
    problem = scene.build()
    run = run_of(problem.at(problem.q0, [speed, 0, 0, 0, speed / R, spin]), scheme, 0.8)
    assert took_every_step(loops[0])
    rolls, turns = length * G * M / R / (M + INERTIA / R**2), torsion * M * G / INERTIA
    np.testing.assert_allclose(run.v[:, 0], np.maximum(speed - rolls * run.t, 0.0), atol=rolls * 1e-3)
    moving = run.t < speed / rolls - 2e-3
    np.testing.assert_allclose(run.v[moving, 0], speed - rolls * run.t[moving], atol=1e-11)
    spinning = run.t < spin / turns - 2e-3
    omega = np.linalg.norm(run.v[:, 3:], axis=1) ** 2 - (run.v[:, 0] / R) ** 2
    np.testing.assert_allclose(omega[spinning], (spin - turns * run.t[spinning]) ** 2, atol=1e-10)
    assert 10 < spinning.sum() < moving.sum()
    assert np.abs(run.v[run.t > speed / rolls + 2e-3]).max() < 1e-14
    assert np.ptp(run.q[run.t > speed / rolls + 2e-3], axis=0).max() < 1e-15


@pytest.mark.parametrize("scheme", [*SCHEMES, mbvi.StewartTrinkle()], ids=str)
@pytest.mark.parametrize("dry", [0.0, 0.3])
def test_a_top_stops_when_the_torque_says(scheme, dry, tmp_path, loops):
    """One mechanism, also with dry friction in the joint: the torques add."""
    file = tmp_path / "robot.urdf"
    file.write_text(TOP)
    scene = mbvi.Scene(friction=(0.5, 0.01, 0.002))
    scene.add_halfspace((0, 0, 1), name="floor")
    joints = {"turn": dry} if dry else False
    scene.add_urdf(file, base="fixed", position=(0, 0, 0.1), velocity={"turn": 1.0}, joint_friction=joints)
    run = run_of(scene.build(), scheme, 0.6, record="contacts")
    assert took_every_step(loops[0])
    slows = (dry + 0.01 * 2.0 * G) / 0.1
    np.testing.assert_allclose(run.v[:, 1], np.maximum(1.0 - slows * run.t, 0.0), atol=slows * 1e-3)
    turning = run.t < 1.0 / slows - 2e-3
    np.testing.assert_allclose(run.v[turning, 1], 1.0 - slows * run.t[turning], atol=1e-12)
    assert np.abs(run.v[run.t > 1.0 / slows + 2e-3]).max() < 1e-14
    np.testing.assert_allclose(run.contacts(0.05)[0].torque, [0, 0, -0.01 * 2.0 * G], rtol=1e-9, atol=1e-12)


def test_contacts_and_impacts_are_those_of_the_python_step(loops, monkeypatch):
    problem, scheme = swaying(0.0, (0.6, 0.02, 0.005)), mbvi.Centered(project_positions=True)
    run = run_of(problem, scheme, 0.15, record="contacts")
    assert loops[0].codes[DONE] > 0
    monkeypatch.setattr(taking, "compiled_loop", lambda *_: None)
    other = run_of(pickle.loads(pickle.dumps(problem)), scheme, 0.15, record="contacts")
    scale = np.abs(other.contact_forces("quadruped")).max()
    np.testing.assert_allclose(
        run.contact_forces("quadruped"), other.contact_forces("quadruped"), rtol=0, atol=1e-8 * scale
    )
    assert run.record.contacts.angular.shape == other.record.contacts.angular.shape
    assert np.abs(run.record.contacts.angular).max() > 0.0
    assert len(run.impacts) == len(other.impacts) > 0
    for one, two in zip(run.impacts, other.impacts, strict=True):
        assert one.constraints == two.constraints and one.regime == two.regime
        assert one.energy_change == pytest.approx(two.energy_change, rel=1e-8, abs=1e-10)


def test_constraints_that_a_user_gives_are_left_to_python(loops):
    """Functions have no rotations that kernels know."""
    scene = mbvi.Scene(friction=(0.6, 0.02, 0.005))
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf("robot:hopper", position=(0, 0, 0.5))
    built = scene.build()
    wall = mbvi.GapFunction(lambda q: 2.0 - q[0], lambda q: -np.eye(built.system.nv)[0], name="wall")
    for given, loop in (((), True), ((wall,), False)):
        constraints = [*built.constraints.constraints, *given]
        problem = mbvi.Problem(built.system, constraints, built.q0, built.v0, length=built.length)
        problem.constraints.resistance = built.constraints.resistance
        run_of(problem, mbvi.Paoli(), 0.02)
        assert (loops[-1] is not None) == loop
