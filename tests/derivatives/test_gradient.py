"""`mbvi.gradient`: the row times the matrix of `sensitivity`, by one pass back."""

import numpy as np
import pytest

import mbvi
from support.robot_problems import tilted_quadruped

SCHEME = mbvi.EventDriven(1e-10)


def both(problem, duration, wrt, scheme=SCHEME, **given):
    """The gradient of a number and what it must be, from the matrix."""
    row = np.random.default_rng(0).normal(size=2 * problem.system.nv)
    found = mbvi.gradient(problem, lambda q, v: (q[0] * v[0], row), scheme, duration=duration, wrt=wrt, **given)
    matrix = mbvi.sensitivity(problem, scheme, duration=duration, wrt=wrt, **given)
    assert found.run.q.tobytes() == matrix.run.q.tobytes() and found.columns == matrix.columns
    assert found.value == found.run.q[-1, 0] * found.run.v[-1, 0]
    exact = row @ matrix.matrix
    assert found.gradient.shape == exact.shape and len(found.run.impacts) > 0
    for columns in found.columns.values():
        # of each name in its own unit
        assert np.abs((found.gradient - exact)[columns]).max() <= 1e-8 * max(np.abs(exact[columns]).max(), 1e-3), wrt
    return found


def bodies():
    scene = mbvi.Scene(restitution=0.6)
    scene.add_halfspace((0, 0.1, 1), name="floor")
    scene.add_box((0.3, 0.5, 0.7), mass=2.0, position=(0, 0, 0.6), angular_velocity=(1.2, 3.0, 2.4), name="box")
    scene.add_sphere(radius=0.2, mass=1.0, position=(2, 0, 0.6), name="lower")
    scene.add_sphere(radius=0.1, mass=0.5, position=(2.1, 0.02, 1.2), velocity=(0, 0, -4), name="upper")
    return scene.build()


def test_free_bodies():
    names = ["state", "restitution of box | floor", "mass of box", "inertia of box", "mass of lower", "offset of floor"]
    both(bodies(), 0.3, names)


def test_a_robot_whose_contacts_close():
    base, calf = "quadruped/root_joint", "quadruped/FL_calf_joint"
    names = ["mass of " + base, "centre of mass of " + base, "inertia of " + calf, "torque of " + calf]
    both(tilted_quadruped(), 0.12, ["state", *names, "gravity", "offset of floor"], mbvi.EventDriven(1e-9))


def test_contacts_that_are_closed_at_the_start():
    """Variations that would open them change nothing, forward and back."""
    scene = mbvi.Scene(gravity=(1.0, 0, -9.81), restitution=0.0)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_halfspace((-1, 0, 0), offset=-0.3, name="wall")
    scene.add_sphere(radius=0.1, mass=1.0, position=(0, 0, 0.1), velocity=(0.5, 0.2, 0), name="ball")
    scene.set_restitution("ball", "wall", 0.5)
    found = both(scene.build(), 0.5, ["offset of floor", "offset of wall", "state"])
    assert np.abs(found.gradient[2 + np.array([2, 5])]).max() < 1e-12


def test_some_joints_only_and_restitution_at_the_start():
    both(bodies(), 0.3, ["state"], bodies=["upper", "lower"])
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_sphere(radius=0.1, mass=1.0, position=(0, 0, 0.1), velocity=(0, 0, -1), name="ball")
    both(scene.build(), 0.05, ["restitution"])
    for wrt in (["state"], ["offset of floor"]):
        with pytest.raises(mbvi.SensitivityError, match="starts with an impact"):
            both(scene.build(), 0.05, wrt)


def test_what_the_function_returns():
    for of in (lambda q, v: q[0], lambda q, v: (q[0], v), lambda q, v: (np.nan, np.zeros(24)), 3.0):
        with pytest.raises(mbvi.InputError, match=r"\bof\b"):
            mbvi.gradient(bodies(), of, duration=0.1)
