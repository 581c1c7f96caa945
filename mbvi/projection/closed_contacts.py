"""Kernels that tell which contacts are closed, which of these have sunk, and where a contact has moved to."""

from __future__ import annotations

import numpy as np

from ..compiled import kernel
from .metric import Array


@kernel("b1(f8, f8, f8)")
def is_closed(percussion: float, rise: float, tolerance: float) -> bool:
    """Return whether a contact is closed that rises so far within a step [m]: one that bears load and closes lands."""
    return abs(rise) <= tolerance or (percussion > 0.0 and rise < 0.0)


@kernel("b1(f8, f8, f8, f8, f8)")
def stays_sunk(depth: float, rise: float, fall: float, e: float, tolerance: float) -> bool:
    """Return whether a row in penetration is raised whatever it bears: nothing else would raise it within two steps.

    Without restitution this is every row. With restitution it is a row that hardly moves, unless it has sunk by an
    impact of this step: it leaves by its rebound.

    Parameters
    ----------
    depth, rise : float
        Penetration at the end of the step, and how far the row moves out in a step at the velocity after the law [m].
    fall : float
        How far it moves out in a step at the velocity before the law [m].
    e, tolerance : float
        Its restitution, and the activation tolerance [m].
    """
    if e >= 1.0 or not depth > tolerance:
        return False
    return e == 0.0 or (2.0 * abs(rise) < depth and depth > -fall)


@kernel("b1(f8[::1], f8[::1], f8[::1], f8[::1], b1[::1], f8[:,::1], f8, f8, f8, b1[::1])")
def find_closed(
    gap: Array, end: Array, lever: Array, e: Array, law: Array, rates: Array, h: float, drift: float, tolerance: float,
    closed: Array,
) -> bool:  # fmt: skip
    """Find the closed contacts among the rows of the law; see `project_positions`.

    Parameters
    ----------
    gap, lever, e, law, rates, h, drift, tolerance
        As of `settle_positions`.
    end : ndarray, shape (m,)
        Gaps at the end of the step.
    closed : ndarray of bool, shape (m,)
        Receives which rows are closed.

    Returns
    -------
    bool
        Whether a contact may bounce: rates alone do not tell then which rows are closed.
    """
    restitution = bounces = False
    for a in range(len(gap)):
        closed[a] = False
        if law[a]:
            rise, fall = h * lever[a] * rates[2, a], h * lever[a] * rates[3, a]
            closed[a] = is_closed(rates[0, a], rise, tolerance)
            closed[a] = closed[a] or stays_sunk(-lever[a] * end[a], rise, fall, e[a], tolerance)
            restitution = restitution or e[a] > 0.0
            # its gap where the law acts
            sunk = lever[a] * (gap[a] - drift * rates[3, a]) < -tolerance
            bounces = bounces or (not closed[a] and (rates[0, a] > 0.0 or sunk))
    return restitution and bounces


@kernel("i8(i8[::1], f8[:,::1], i8, b1[::1])")
def nearest_row(number: Array, point: Array, a: int, some: Array) -> int:
    """Return the row of the same constraint, of those in a mask, whose point is nearest to that of row a; -1 for none.

    Points have shape (m, 3); distances that are NaN, as of joint limits, count as zero.
    """
    nearest, least = -1, np.inf
    for b in range(len(number)):
        if some[b] and number[b] == number[a]:
            apart = 0.0
            for axis in range(3):
                apart += (point[a, axis] - point[b, axis]) ** 2
            if np.isnan(apart):
                apart = 0.0
            if apart < least:
                nearest, least = b, apart
    return nearest


@kernel("i8(i8[::1], f8[:,::1], i8, b1[::1], b1[::1])")
def moved_from(number: Array, point: Array, a: int, near: Array, law: Array) -> int:
    """Return the row of the law whose contact has moved to row a; -1 if there is none.

    It is of the same constraint, and each of the two is the nearest to the other: a among those of the law, which it
    does not belong to, the other among the rows of the mask `near`, which a belongs to.
    """
    b = nearest_row(number, point, a, law)
    return b if b >= 0 and nearest_row(number, point, b, near) == a else -1


@kernel("void(i8[::1], f8[:,::1], f8[:,::1], f8[::1], b1[::1], b1[::1], b1[::1], f8[:,::1])")
def follow_contacts(
    number: Array, point: Array, J: Array, v: Array, near: Array, law: Array, closed: Array, rates: Array
) -> None:
    """Put the rows to which contacts have moved in the place of the law's; see `moved_from` and `settle_positions`."""
    m, n = J.shape
    before = law.copy()
    for a in range(m):
        if near[a] and not before[a]:
            b = moved_from(number, point, a, near, before)
            if b >= 0:
                law[a], law[b], closed[a], rates[0, a] = True, False, closed[b], rates[0, b]
                rates[3, a] = 0.0
                for k in range(n):
                    rates[3, a] += J[a, k] * v[k]


@kernel(
    "f8(i8[::1], f8[:,::1], f8[:,::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], b1[::1], f8[:,::1], f8, "
    "f8, f8, b1[::1], f8[::1], f8[::1], b1[::1])"
)
def find_sunk(
    number: Array, point: Array, J: Array, gap: Array, lever: Array, e: Array, v: Array, w: Array, displacement: Array,
    law: Array, rates: Array, h: float, drift: float, tolerance: float, closed: Array, end: Array, bound: Array,
    near: Array,
) -> float:  # fmt: skip
    """Return the largest distance by which a closed contact must rise [m], 0 for none; -1 where a contact bounces.

    Parameters
    ----------
    number, point, J, gap, lever, e, v, w, displacement, law, rates, h, drift, tolerance
        As of `settle_positions`.
    closed : ndarray of bool, shape (m,)
        Receives which rows are closed, and the active ones that take the place of a closed row of their constraint or
        stay sunk.
    end, bound : ndarray, shape (m,)
        Receive the gaps at the end of the step, and the lower bounds that a position projection must keep.
    near : ndarray of bool, shape (m,)
        Receives which rows are active there.
    """
    m, n = J.shape
    depth = 0.0
    for a in range(m):
        end[a] = gap[a]
        for k in range(n):
            end[a] += J[a, k] * displacement[k]
        near[a] = lever[a] * end[a] <= tolerance
    bounces = find_closed(gap, end, lever, e, law, rates, h, drift, tolerance, closed)
    for a in range(m):
        length = lever[a] * end[a]
        if near[a] and not law[a]:
            b = moved_from(number, point, a, near, law)
            rise = fall = 0.0
            for k in range(n):
                rise += h * lever[a] * J[a, k] * w[k]
                fall += h * lever[a] * J[a, k] * v[k]
            closed[a] = (b >= 0 and closed[b]) or stays_sunk(-length, rise, fall, e[a], tolerance)
        if closed[a] and bounces:
            return -1.0
        # bounds below zero by no more than the tolerance stay: they would contradict each other by their rounding
        sunk = near[a] and closed[a] and length < -tolerance
        bound[a] = 0.0 if sunk or not near[a] else min(end[a], 0.0)
        if sunk:
            depth = max(depth, -length)
    return depth if depth > tolerance else 0.0
