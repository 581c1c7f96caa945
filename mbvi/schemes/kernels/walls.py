"""Walls that move as joints of a mechanism: their coordinates are known functions of time."""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ...constraints.carried import carry_points
from ...constraints.mechanism.tables import RowBuffer
from ...geometry.vectors import dot
from ...system.mechanisms.frames import cross_product
from ...system.mechanisms.mechanism import place
from ...system.system import Array
from ..positions.carried_kernel import body_of
from ..step import BENDS, FARTHEST
from .records import MechanismStep

# part of the terms of a rate below which it is what rounding leaves of them
_ROUNDING = 1e-12


@kernel("void(MechanismStep, f8, f8[::1], f8[::1])")
def set_prescribed_joints(s: MechanismStep, t: float, q: Array, v: Array) -> None:
    """Write the coordinates and speeds of the joints of walls at a time; these are the last ones."""
    motion = s.prescribed.motion
    n = len(motion)
    for k in range(n):
        q[len(q) - n + k], v[len(v) - n + k] = motion[k, 0] * t + motion[k, 1], motion[k, 0]


@kernel("b1(MechanismStep, RowBuffer, i8)")
def is_moved_by_walls(s: MechanismStep, rows: RowBuffer, a: int) -> bool:
    """Return whether a wall that moves changes the gap of row a, now or at another time of its oscillation."""
    row, motion, walls, rate, terms = rows.J[a], s.prescribed.motion, s.prescribed.changes, 0.0, 0.0
    first = len(row) - len(motion)
    for k in range(len(motion)):
        rate += row[first + k] * motion[k, 0]
        terms += abs(row[first + k] * motion[k, 0])
    if abs(rate) > _ROUNDING * terms:
        return True
    for w in range(len(walls)):
        k = first + int(walls[w, 0])
        if not np.isnan(walls[w, 2]) and (row[k] != 0.0 or row[k + 1] != 0.0 or row[k + 2] != 0.0):
            along = 0.0
            for c in range(3):
                along += walls[w, 3 + c] * rows.normal[a, c]
            return abs(along) > _ROUNDING
    return False


@kernel("void(f8[::1], f8[::1], i8, i8, f8)")
def write_rate(row: Array, support: Array, joints: int, last: int, rate: float) -> None:
    """Let a row have a rate from the joint `last` of a wall alone; `support` and `row` have shape (nv,)."""
    for k in range(len(row) - joints, len(row)):
        if support[k] != 0.0:
            row[k] = rate if k == last else 0.0


@kernel("void(MechanismStep, f8[::1], f8)")
def take_mean_rates(s: MechanismStep, q: Array, time: float) -> None:
    """Give rows of walls that move the rates that their points have a time later; see `with_mean_rates`.

    The rows are those at q, shape (nq,), where the mechanism is placed. It is placed elsewhere then.
    """
    rows, poses, columns, motion = s.rows, s.mechanism.poses, s.mechanism.columns, s.prescribed.motion
    m, nv, n, walls = rows.size[0], len(s.v), len(motion), len(s.scales.part_of_body)
    if n == 0:
        return
    point, body, there = rows.point[:m].copy(), np.empty(m, np.int64), q.copy()
    old = np.empty((m, 4, 3))
    for a in range(m):
        body[a] = body_of(s.constraints, rows.number[a], 0)
        for r in range(4):
            for c in range(3):
                old[a, r, c] = poses[body[a], r, c]
    for k in range(n):
        there[len(q) - n + k] += time * motion[k, 0]
    place(s.mechanism, there)
    twist, velocity = np.empty(6), np.empty(3)
    for a in range(m):
        if body[a] <= walls:
            continue
        support, p, last, speed = s.mechanism.support[body[a]], point[a], -1, 0.0
        carry_points(point[a : a + 1], old[a : a + 1], poses[body[a] : body[a] + 1], point[a : a + 1])
        twist[:] = 0.0
        for k in range(n):
            if support[nv - n + k] != 0.0:
                last, speed = nv - n + k, motion[k, 0]
                for c in range(6):
                    twist[c] += speed * columns[last, c]
        if speed == 0.0:
            continue
        x, y, z = cross_product(twist[3], twist[4], twist[5], rows.point[a, 0], rows.point[a, 1], rows.point[a, 2])
        velocity[0], velocity[1], velocity[2] = twist[0] + x, twist[1] + y, twist[2] + z
        fixed = -dot(rows.normal[a], velocity)
        x, y, z = cross_product(twist[3], twist[4], twist[5], p[0], p[1], p[2])
        velocity[0], velocity[1], velocity[2] = twist[0] + x, twist[1] + y, twist[2] + z
        write_rate(rows.J[a], support, n, last, min(-dot(rows.normal[a], velocity), fixed) / speed)
        for c in range(2 if len(rows.T) > 0 and rows.mu[a] > 0.0 else 0):
            write_rate(rows.T[2 * a + c], support, n, last, -dot(rows.axes[a, c], velocity) / speed)
        if len(rows.R) > 0 and (rows.resistance[a, 0] > 0.0 or rows.resistance[a, 1] > 0.0):
            for c in range(3):
                axis = rows.normal[a] if c == 0 else rows.axes[a, c - 1]
                write_rate(rows.R[3 * a + c], support, n, last, -dot(axis, twist[3:]) / speed)


@kernel("void(MechanismStep, f8[::1], f8, f8[::1])")
def widen_margins(s: MechanismStep, q: Array, h: float, margins: Array) -> None:
    """Write the margins `largest` of `near_margins` in the place of those of rows at walls that do not move.

    Parameters
    ----------
    s : MechanismStep
        What steps. It is placed at q then.
    q : ndarray, shape (nq,)
        The configuration at the begin of the step.
    h : float
        Length of the step, in which walls change their speed [s].
    margins : ndarray, shape (parts,)
        The margins [m].
    """
    place(s.mechanism, q)
    poses, columns, walls = s.mechanism.poses, s.mechanism.columns, s.prescribed.changes
    bends, n = np.zeros(len(margins)), len(s.prescribed.motion)
    for body in range(1, len(s.scales.part_of_body) + 1):
        p, x, y, z = s.scales.part_of_body[body - 1], poses[body, 3, 0], poses[body, 3, 1], poses[body, 3, 2]
        for w in range(len(walls)):
            joint, speed, amplitude = int(walls[w, 0]), walls[w, 1], walls[w, 2]
            if np.isnan(amplitude):
                c = columns[len(columns) - n + joint]
                # points on a circle
                a, b, d = c[0] + c[4] * z - c[5] * y, c[1] + c[5] * x - c[3] * z, c[2] + c[3] * y - c[4] * x
                change = 2.0 * np.sqrt(a * a + b * b + d * d) * abs(speed * np.sin(0.5 * speed * h))
            else:
                angle = q[len(q) - n + joint]
                here, before, after = np.sin(angle), np.sin(angle - speed * h), np.sin(angle + speed * h)
                change = abs(amplitude * speed) * max(abs(here - before), abs(after - here))
            bends[p] = max(bends[p], 0.5 * h * change)
    for p in range(len(margins)):
        margins[p] = max(margins[p], min(margins[p] + BENDS * bends[p], FARTHEST * s.scales.length))
