"""The project's own robots and real ones: dropped for a second, they end without error and obey the laws."""

import numpy as np
import pytest

import mbvi
from support.paths import ROBOTS, real_robot

REAL = {
    "UR5": ("ur_description/urdf/ur5_robot.urdf", "fixed", 0.0),
    "Panda": ("panda_description/urdf/panda.urdf", "fixed", 0.0),
    "Solo12": ("solo_description/robots/solo12.urdf", "free", 0.6),
    "ANYmal B": ("anymal_b_simple_description/robots/anymal.urdf", "free", 1.0),
    "Talos": ("talos_data/robots/talos_reduced.urdf", "free", 1.3),
}
OWN = {"double_pendulum": ("fixed", 0.0), "hopper": ("free", 0.8), "quadruped": ("free", 0.8), "arm": ("fixed", 0.0)}
OWN["biped"] = ("free", 1.2)


def drop(path, base, height, **joints):
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(path, base=base, position=(0, 0, height), joints=joints)
    problem = scene.build()
    return mbvi.simulate(problem, mbvi.Paoli(), step=1e-3, duration=1.0)


def check(run, h=1e-3):
    assert run.t[-1] == 1.0
    assert np.isfinite(run.q).all()
    assert run.impacts
    assert max(i.energy_change for i in run.impacts) <= 0.0
    speed = max(-i.before.min() for i in run.impacts)
    assert run.penetration().max() < h * speed
    energy = run.energy()
    assert energy.max() <= energy[0] + 1e-3 * abs(energy[0])
    assert run.residual.max() < 1e-9


@pytest.mark.parametrize(("path", "base", "height"), REAL.values(), ids=REAL)
def test_real_robots_drop(path, base, height):
    joints = {"shoulder_lift_joint": -1.0} if "ur5" in path else {}
    check(drop(real_robot(path), base, height, **joints))


@pytest.mark.parametrize(("name", "base", "height"), [(n, *where) for n, where in OWN.items()], ids=OWN)
def test_own_robots_drop(name, base, height):
    joints = {"double_pendulum": {"shoulder": -0.4, "elbow": 13.0 - 0.5}, "arm": {"joint2": 0.8}}.get(name, {})
    run = drop(ROBOTS / name / f"{name}.urdf", base, height, **joints)
    check(run)


def test_a_problem_run_again_gives_the_same_bytes():
    """What is remembered of the first run decides which pairs the second asks, and may not decide a single bit."""
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1))
    swing = {f"{leg}_{j}_joint": r for leg in ("FL", "FR", "RL", "RR") for j, r in (("hip", 0.3), ("thigh", 1.0))}
    scene.add_urdf(ROBOTS / "quadruped/quadruped.urdf", position=(0, 0, 1.5), velocity=swing)
    problem = scene.build()
    first, *others = (mbvi.simulate(problem, mbvi.Paoli(), step=1e-3, duration=0.3) for _ in range(3))
    for other in others:
        np.testing.assert_array_equal(other.q, first.q)
        np.testing.assert_array_equal(other.v, first.v)


def test_every_robot_is_dropped():
    assert {folder.name for folder in ROBOTS.iterdir()} == set(OWN)


@pytest.mark.parametrize("name", OWN)
def test_every_robot_has_its_readme(name):
    text = (ROBOTS / name / "README.md").read_text()
    assert "Licence" in text
    assert "Source" in text
