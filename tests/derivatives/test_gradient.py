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


def at_times(problem, scheme, duration, wrt, count, between, **given):
    """The gradient of a number at several times, and what it must be, from matrices at these.

    `between` are times between recorded states, at each of which a run of its own ends.
    """
    whole = mbvi.sensitivity(problem, scheme, duration=duration, wrt=wrt, **given)
    struck = np.array([one.time for one in whole.run.impacts])
    apart = np.abs(whole.run.t[:, None] - struck).min(axis=1) > 2 * given.get("step", 0.0) + 1e-6
    chosen = np.flatnonzero(apart)[:: max(1, apart.sum() // count)]
    matrices = {float(whole.run.t[k]): whole.matrices[k] for k in chosen}
    for t in between:
        matrices[t] = mbvi.sensitivity(problem, scheme, duration=t - problem.t0, wrt=wrt, **given).matrix
    times = np.array(sorted(matrices))
    rows = np.random.default_rng(1).normal(size=(len(times), 2 * problem.system.nv))
    seen = []

    def of(q, v):
        seen.append((q, v))
        return float((rows * np.hstack([v, v])).sum()), rows

    found = mbvi.gradient(problem, of, scheme, duration=duration, wrt=wrt, times=times, **given)
    assert all((one == other).all() for one, other in zip(seen[0], found.run.at(times), strict=True))
    assert len(struck) > 0 and times[0] < struck[-1] < times[-1]
    return found, sum(row @ matrices[t] for t, row in zip(times.tolist(), rows, strict=True))


def test_a_sum_over_times():
    """Through impacts, at recorded states, at the start, the end and in between."""
    names = ["state", "restitution of box | floor", "mass of box", "inertia of box", "offset of floor"]
    found, exact = at_times(bodies(), SCHEME, 0.3, names, 8, [0.05, 0.17])
    for columns in found.columns.values():
        assert np.abs((found.gradient - exact)[columns]).max() <= 1e-8 * max(np.abs(exact[columns]).max(), 1e-3)


def test_a_sum_over_times_of_fixed_steps():
    found, exact = at_times(bodies(), mbvi.Centered(), 0.3, ["state", "mass of box", "gravity"], 8, [], step=1e-3)
    assert np.abs(found.gradient - exact).max() < 1e-10 * np.abs(exact).max()


def test_a_sum_over_times_with_a_limited_control():
    """Times and kinks of the torque lie between each other within steps."""
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((-1, 0, 0), offset=-0.3, name="wall")
    drive = mbvi.PDControl({"shoulder": -0.25}, 60.0, 4.0, limit=20.0)
    robot, start = mbvi.robot("double_pendulum"), {"shoulder": 0.9}
    scene.add_urdf(robot, base="fixed", name="arm", joints=start, control=drive, locked=["elbow"])
    names = ["state", "control stiffness of arm/shoulder", "control damping of arm/shoulder"]
    found, exact = at_times(scene.build(), SCHEME, 1.2, names, 30, [0.11, 0.23, 0.31, 0.55, 0.8])
    assert np.abs(found.gradient - exact).max() < 1e-8 * np.abs(exact).max()


def test_one_time_is_the_end():
    """To the byte: of fixed steps also where the end of the run is rounded."""
    for scheme, given in ((SCHEME, {}), (mbvi.Paoli(), {"step": 1e-3})):
        row = np.arange(24.0)
        ends = {"duration": 0.3, "wrt": ["state", "mass of box"]} | given
        whole = mbvi.gradient(bodies(), lambda q, v, row=row: (q[0], row), scheme, **ends)
        last = mbvi.gradient(bodies(), lambda q, v, row=row: (q[0, 0], row[None]), scheme, times=[0.3], **ends)
        assert last.gradient.tobytes() == whole.gradient.tobytes() and last.value == whole.value


def test_times_that_are_none():
    def of(q, v):
        return q[0, 0], np.zeros((len(q), 24))

    for times in ([0.2, 0.1], [0.1, 0.1], [-0.1], [0.4], [], 0.1, "end", [np.nan]):
        with pytest.raises(mbvi.InputError, match="times"):
            mbvi.gradient(bodies(), of, SCHEME, duration=0.3, times=times)
    with pytest.raises(mbvi.InputError, match="row"):
        mbvi.gradient(bodies(), lambda q, v: (0.0, np.zeros(24)), SCHEME, duration=0.3, times=[0.1, 0.2])
    for scheme, given, off in ((mbvi.Centered(), {"step": 1e-3}, 5e-4), (SCHEME, {}, 1e-13)):
        struck = mbvi.simulate(bodies(), scheme, duration=0.3, **given).impacts[0]
        with pytest.raises(mbvi.SensitivityError, match="velocity jumps") as caught:
            mbvi.gradient(bodies(), of, scheme, duration=0.3, times=[struck.time - off], **given)
        assert caught.value.bodies == struck.constraints and caught.value.run.complete
    mbvi.gradient(bodies(), of, SCHEME, duration=0.3, times=[struck.time - 1e-6, struck.time + 1e-6])


def test_what_the_function_returns():
    for of in (lambda q, v: q[0], lambda q, v: (q[0], v), lambda q, v: (np.nan, np.zeros(24)), 3.0):
        with pytest.raises(mbvi.InputError, match=r"\bof\b"):
            mbvi.gradient(bodies(), of, duration=0.1)
