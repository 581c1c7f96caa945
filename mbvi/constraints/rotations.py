"""Relative angular velocities of contacts, for torsional and rolling friction."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from ..system.free.sparse_rows import stack_rows, take_rows
from .rows import Array, Rows, take
from .tangents import Tangents


class Resistances:
    """The lengths of torsional and rolling friction of constraints.

    `of_name`(name) -> (torsion, rolling) returns those of a constraint with friction [m]; each is asked for once.
    """

    def __init__(self, of_name: Callable[[str], tuple[float, float]]) -> None:
        self._of_name, self._known = of_name, dict[int, tuple[float, float]]()

    def of(self, numbers: Array, name: Callable[[int], str]) -> Array:
        """Return those of constraints by their numbers, shape (k, 2), whose names `name` returns."""
        listed = numbers.tolist()
        for number in set(listed) - self._known.keys():
            self._known[number] = self._of_name(name(number))
        return np.array([self._known[number] for number in listed]).reshape(-1, 2)


def rotation_rows(
    separation_rows: Callable[..., Any], bodies: tuple[Array, Array], rows: Rows, axes: Array
) -> Array | csr_array:
    """Return the gradients of relative angular velocities about normals and tangents, shape (3 k, nv).

    Parameters
    ----------
    separation_rows : callable
        separation_rows(first, second, point, normal), that of a system at a configuration.
    bodies : tuple of ndarray
        The first and the second body of each row.
    rows : Rows
        Contact points and normals.
    axes : ndarray, shape (k, 2, 3)
        Their tangents.

    Notes
    -----
    With unit vectors a x b = n the angular velocity about n is the difference of the velocities along b at the points
    x + a and x.
    """
    n, t, s = rows.normal, axes[:, 0], axes[:, 1]
    aside, along = np.stack([t, s, n], axis=1).reshape(-1, 3), np.stack([s, n, t], axis=1).reshape(-1, 3)
    (first, second), point = (side.repeat(3) for side in bodies), rows.point.repeat(3, 0)
    difference = separation_rows(first, second, point + aside, along) - separation_rows(first, second, point, along)
    return difference if isinstance(difference, np.ndarray) else csr_array(difference)


def with_rotations(
    families: Sequence[Any],
    starts: Sequence[int],
    t: float,
    q: Array,
    rows: Rows,
    tangents: Tangents,
    resistance: Array,
) -> Tangents:
    """Return tangents of k rows followed by axes of rotation, whose rows are zero where there is no resistance.

    Parameters
    ----------
    families, starts : sequence of ConstraintFamily, sequence of int
        All families, and the number of the first constraint of each.
    t, q
        Time and configuration.
    rows : Rows
        The rows.
    tangents : Tangents
        Their tangents, two each.
    resistance : ndarray, shape (k, 2)
        See `Tangents`; it counts where mu is not zero.
    """
    k, nv = len(resistance), rows.jacobian.shape[1]
    resistance = np.where(tangents.friction[:, None] > 0.0, resistance, 0.0)
    which = np.searchsorted(starts, rows.constraint, side="right") - 1
    nothing = csr_array((3 * k, nv)) if not isinstance(tangents.jacobian, np.ndarray) else np.zeros((3 * k, nv))
    parts, end = [tangents.jacobian, nothing], 5 * k
    # of each row its tangents, and where its axes of rotation are among all parts
    order = np.concatenate([np.arange(2 * k).reshape(k, 2), 2 * k + np.arange(3 * k).reshape(k, 3)], axis=1)
    rates, moving = np.zeros((k, 5)), tangents.rate is not None
    if tangents.rate is not None:
        rates[:, :2] = tangents.rate.reshape(k, 2)
    here = np.flatnonzero(resistance.any(axis=1))
    for f in np.unique(which[here]).tolist():
        some = here[which[here] == f]
        part = take(rows, some)
        part = part._replace(constraint=part.constraint - starts[f])
        own, rate = families[f].rotations(t, q, part, tangents.axes[some])
        if rate is not None:
            rates[some, 2:], moving = rate.reshape(-1, 3), True
        order[some, 2:] = end + np.arange(3 * len(some)).reshape(-1, 3)
        end += 3 * len(some)
        parts.append(own)
    jacobian = take_rows(stack_rows(parts), order.ravel())
    return Tangents(tangents.friction, tangents.axes, jacobian, rates.ravel() if moving else None, resistance)
