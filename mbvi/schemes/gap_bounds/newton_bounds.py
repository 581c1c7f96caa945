"""Bounds of the velocity after a step where contacts bounce: Newton's law on those that close within the step."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...constraints import Rows
from ...problem import Problem
from ...projection import FreeMotion, TreeFreeMotion
from ...system.system import Array
from ..step import still_rates
from .reach import largest_of_groups


class NewtonBounds(NamedTuple):
    """Least rates of the gaps after a step.

    Attributes
    ----------
    lower : ndarray, shape (k,)
        Least J w + df/dt of each row [m/s, rad/s].
    impact : ndarray of bool, shape (k,)
        Which rows have an impact.
    open : ndarray of bool, shape (k,)
        Which rows are left out, because their impact, if there is one, belongs to a later step.
    """

    lower: Array
    impact: Array
    open: Array


def newton_bounds(
    problem: Problem, rows: Rows, v: Array, h: float, motion: FreeMotion | TreeFreeMotion, group: Array
) -> NewtonBounds:
    """Return the bounds of the velocity after a step of length h from the velocity v.

    A row with e > 0 that v closes within the step has an impact if its approach is faster than what twice the forces of
    the step explain where they act on one of its bodies only: J w >= -e J v. Slower contacts rest. A row that rests and
    one with e = 0 have J w >= min(-max(f, 0) / h, -s J v), where s is the largest e of the impacts in its group. An
    open row with e > 0 has no bound: the impact that ends its approach must find the whole speed.

    Parameters
    ----------
    problem : Problem
        Tolerance and levers.
    rows : Rows
        The rows at the beginning of the step.
    v : ndarray, shape (nv,)
        Velocity before.
    h : float
        Time step [s].
    motion : FreeMotion or TreeFreeMotion
        Free motion of v.
    group : ndarray of int, shape (k,)
        See `groups`.

    Notes
    -----
    Without forces -s v meets all bounds of a group. The projection w of v onto a convex set with -s v has
    (w - v)' M (w + s v) <= 0, hence (|w| - |v|) (|w| + s |v|) <= 0: the kinetic energy never rises, also where contacts
    have different e.
    """
    e, before = rows.restitution, rows.speeds(v)
    slow = still_rates(problem, rows.constraint) + 2.0 * (abs(rows.jacobian) @ np.abs(motion.free - v))
    touching = problem.tolerance / problem.constraints.levers(rows.constraint)
    impact = (e > 0.0) & (rows.gap + h * before <= touching) & (before < -slow)
    gap = np.maximum(rows.gap, 0.0)
    lower = -gap / h
    if impact.any():
        largest = largest_of_groups(np.where(impact, e, 0.0), group)
        # bodies that touch to within the tolerance pass impacts on without loss
        passing = np.minimum(-np.where(gap > touching, gap, 0.0) / h, -largest * before)
        lower = np.where(impact, -e * before, np.where(largest > 0.0, passing, lower))
    return NewtonBounds(lower, impact, (e > 0.0) & ~impact & (gap > h * slow))
