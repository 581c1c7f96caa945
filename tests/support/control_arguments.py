"""Arguments of the kernels of controls."""

import numpy as np
import pinocchio as pin

from mbvi.system.control_table import FUNCTION, no_control
from mbvi.system.controls import HeldTorque, PDControl
from mbvi.system.joint_forces import JointForce, force_rows


def ascending(rng, k):
    return np.cumsum(0.1 + rng.random(k))


def bracket(rng):
    times = ascending(rng, int(rng.integers(1, 6)))
    # now and then one of the times, or outside of them
    t = rng.choice([float(rng.choice(times)), float(times[0] - 0.2), float(times[-1] + 0.2), times.mean()])
    return times, float(t)


def between(rng):
    values = rng.normal(size=(4, 3))
    return values, int(rng.integers(3)), int(rng.integers(3)), float(rng.choice([0.0, rng.random()]))


def write_torque(rng):
    n, extra, k = (int(i) for i in rng.integers(1, 5, size=3))
    q, v, t = rng.normal(size=n + extra + 1), rng.normal(size=n + extra), float(2.0 * rng.random())
    rows = rng.normal(size=(3, k, n))
    tracking = PDControl(
        rows[0], rng.random(n) * rng.integers(2), rng.random(n), v=rows[1], torque=rows[2], times=ascending(rng, k),
        limit=rng.random(n),
    )  # fmt: skip
    held = HeldTorque(rng.normal(size=(6, n)), 3)
    held.begin(int(rng.integers(2)), 0.0, 0.4, bool(rng.integers(2)))
    table = [no_control(n), tracking.table, held.table][rng.integers(3)]
    if rng.integers(2):
        # inputs in as many rows as a control that is held has
        model, actuators, springs = *drawn_rows(rng, 6), drawn_rows(rng, 1)[1]
        q, v = pin.integrate(model, pin.neutral(model), rng.normal(size=model.nv)), rng.normal(size=model.nv)
        table = table._replace(actuators=actuators, springs=springs)
    assert table.kind != FUNCTION
    return table, t, q, v, np.full(len(v), np.nan)


def drawn_rows(rng, inputs):
    """Return a chain of a hinge, a ball and two slides, and forces along its joints."""
    model, forces = pin.Model(), []
    for kind in (pin.JointModelRX(), pin.JointModelSpherical(), pin.JointModelPY(), pin.JointModelPZ()):
        model.addJoint(model.njoints - 1, kind, pin.SE3.Identity(), str(model.njoints))
    for _ in range(int(rng.integers(1, 5))):
        names = rng.choice(["1", "2", "3", "4"], 2, replace=False)
        joints = {str(name): tuple(rng.normal(size=3 if name == "2" else 1)) for name in names}
        limits = [tuple(np.sort(rng.normal(size=2))) if rng.integers(2) else (-np.inf, np.inf) for _ in range(2)]
        forces.append(JointForce("f", joints, tuple(rng.normal(size=3)), rng.normal(), *limits))
    return model, force_rows(forces, model, rng.normal(size=(inputs, len(forces))))


def write_row_forces(rng):
    model, rows = drawn_rows(rng, 3)
    q, v = pin.integrate(model, pin.neutral(model), 3.0 * rng.normal(size=model.nv)), rng.normal(size=model.nv)
    return rows, int(rng.integers(3)), q, v, np.full(len(rows.law), np.nan)


def add_row_forces(rng):
    *given, _ = write_row_forces(rng)
    return *given, rng.normal(size=len(given[3]))


CONTROL_ARGUMENTS = {
    "bracket": bracket, "between": between, "write_torque": write_torque, "write_row_forces": write_row_forces,
    "add_row_forces": add_row_forces,
}  # fmt: skip
