"""Bodies that a position projection does not move keep the velocity of the law, and the percussions of their contacts.

The law acts again where contacts were raised, with the gradients there. Bodies that no contact connects with those
moved, by its normal, its tangents or its rotations, would otherwise bounce by other gradients than those of the law,
because of what happens elsewhere.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.sparse import csr_array

from ...compiled import kernel
from ...constraints import Rows
from ...constraints.mechanism.tables import RowBuffer
from ...constraints.tangents import along_axes
from ...problem import Problem
from ...system.system import Array
from ..kernels.records import MechanismStep
from ..step import Step
from .displacement_kernel import independent_groups as independent_groups_of
from .least_displacement import independent_groups

# displacement below which nothing was raised, in activation tolerances: projections leave rounding
_MOVED = 1e-3


def acting(rows: Rows) -> Any:
    """Return a matrix that is not zero where a contact acts on a velocity, also by its friction, shape (k, nv)."""
    J, tangents = abs(rows.jacobian), rows.tangents
    if tangents is None:
        return J
    number = np.arange(tangents.jacobian.shape[0])
    sums = csr_array((np.ones(len(number)), (number // tangents.width, number)), shape=(J.shape[0], len(number)))
    return J + sums @ abs(tangents.jacobian)


def moved_groups(reach: Any, moved: Array, part: Array) -> tuple[Array, Array]:
    """Return which velocities and rows belong to parts that a displacement moves, or that rows connect with these.

    Parameters
    ----------
    reach : ndarray or sparse array, shape (k, nv)
        See `acting`.
    moved : ndarray of bool, shape (nv,)
        Which coordinates it moves.
    part : ndarray of int, shape (nv,)
        See `independent_parts`.

    Returns
    -------
    velocities, rows : ndarray of bool, shapes (nv,) and (k,)
    """
    label, touched = independent_groups(reach, part), np.zeros(part[-1] + 1, bool)
    touched[part[moved]] = True
    rows = np.isin(label, label[abs(reach) @ touched[part] > 0.0])
    touched[part[abs(reach).T @ rows > 0.0]] = True
    return touched[part], rows


def with_the_rest_of_law(problem: Problem, law: Step, v: Array, step: Step, order: Array, displacement: Array) -> Step:
    """Return a step in which the bodies that a displacement, shape (nv,), does not move have the velocity of the law.

    Parameters
    ----------
    law : Step
        The step before the projection.
    v : ndarray, shape (nv,)
        The velocity at its end.
    step : Step
        The step after the projection.
    order : ndarray of int, shape (k,)
        Of each of its rows that of the law.
    """
    part = problem.constraints.part
    if not part.any():
        return step
    moved = np.abs(displacement) > _MOVED * problem.tolerance
    velocities, rows = moved_groups(acting(step.active), moved, part)
    if velocities.all():
        return step
    slip = step.slip
    if slip is not None and law.slip is not None:
        assert law.active.tangents is not None and step.active.tangents is not None
        own, axes = law.active.tangents.axes[order], step.active.tangents.axes
        slip = np.where(rows[:, None], slip, along_axes(law.slip[:, order], own, axes))
    rates = np.where(rows, step.rates, law.rates[:, order])
    return step._replace(v=np.where(velocities, step.v, v), rates=rates, slip=slip)


@kernel("b1(f8[:,::1], f8[::1], f8, i8[::1], b1[::1], b1[::1])")
def find_moved_groups(reach: Array, moved: Array, least: float, part: Array, velocities: Array, rows: Array) -> bool:
    """Write what `moved_groups` returns, for displacements above `least`; return whether that is all."""
    m, n = len(reach), len(part)
    group, hit, touched = np.empty(m, np.int64), np.zeros(m, np.bool_), np.zeros(n, np.bool_)
    independent_groups_of(reach, part, group)
    for k in range(n):
        if abs(moved[k]) > least:
            touched[part[k]] = True
    for i in range(m):
        for k in range(n):
            hit[group[i]] = hit[group[i]] or (reach[i, k] != 0.0 and touched[part[k]])
    for i in range(m):
        rows[i] = hit[group[i]]
        for k in range(n if rows[i] else 0):
            if reach[i, k] != 0.0:
                touched[part[k]] = True
    every = True
    for k in range(n):
        velocities[k] = touched[part[k]]
        every = every and velocities[k]
    return every


@kernel("void(f8[::1], f8[::1], i8[::1], b1[::1])")
def restore_columns(before: Array, values: Array, order: Array, rows: Array) -> None:
    """Write what some rows had before, four times as many numbers of each: those of rows that are not in `rows`.

    Row i was row `order[i]`. Arrays may have no size.
    """
    k = len(order)
    width = len(before) // (4 * k) if k > 0 else 0
    for i in range(k):
        for c in range(4 if not rows[i] else 0):
            for j in range(width):
                values[width * (c * k + i) + j] = before[width * (c * k + order[i]) + j]


@kernel("void(RowBuffer, f8[:,::1])")
def write_acting(rows: RowBuffer, reach: Array) -> None:
    """Write what `acting` returns."""
    for i in range(len(reach)):
        for k in range(reach.shape[1]):
            reach[i, k] = abs(rows.J[i, k])
            for c in range(2 if len(rows.T) > 0 else 0):
                reach[i, k] += abs(rows.T[2 * i + c, k])
            for c in range(3 if len(rows.R) > 0 else 0):
                reach[i, k] += abs(rows.R[3 * i + c, k])


@kernel("void(MechanismStep, f8[::1], f8[::1], f8[::1], f8[::1], i8[::1])")
def keep_the_rest_of_law(s: MechanismStep, moved: Array, rates: Array, slip: Array, turn: Array, order: Array) -> None:
    """Give the bodies that a displacement does not move the velocity and the percussions of the law.

    Parameters
    ----------
    s : MechanismStep
        After the projection; `room.after` has the velocity of the law at the end of the step.
    moved : ndarray, shape (nv,)
        The displacement.
    rates : ndarray
        Those of the law, of its k rows.
    slip, turn : ndarray
        Those of the law, in the order and along the axes of the rows after the projection.
    order : ndarray of int, shape (k,)
        Of each row after the projection that of the law.
    """
    velocities, rows = np.empty(len(moved), np.bool_), np.empty(len(order), np.bool_)
    reach = np.empty((len(order), len(moved)))
    write_acting(s.rows, reach)
    if find_moved_groups(reach, moved, _MOVED * s.scales.tolerance, s.scales.part, velocities, rows):
        return
    for k in range(len(s.scales.part)):
        if not velocities[k]:
            s.v[k] = s.room.after[k]
    restore_columns(rates, s.rates, order, rows)
    same = np.arange(len(order))
    restore_columns(slip, s.slip, same, rows)
    restore_columns(turn, s.turn, same, rows)
