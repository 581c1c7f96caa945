"""Arguments of the kernels of controls."""

import numpy as np

from mbvi.system.control_table import FUNCTION, no_control
from mbvi.system.controls import HeldTorque, PDControl


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
    assert table.kind != FUNCTION
    return table, t, q, v, np.full(len(v), np.nan)


CONTROL_ARGUMENTS = {"bracket": bracket, "between": between, "write_torque": write_torque}
