"""Relative angular velocities of contacts, for torsional and rolling friction."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy.sparse import csr_array

from ..system.free.sparse_rows import stack_rows, take_rows
from .rows import Array, Rows, take
from .tangents import Tangents


def with_rotations(tangents: Tangents, resistance: Array, rotations: Array | csr_array, rate: Array | None) -> Tangents:
    """Return tangents followed by axes of rotation, for torsional and rolling friction.

    Parameters
    ----------
    tangents : Tangents
        Two of each of k rows.
    resistance : ndarray, shape (k, 2)
        See `Tangents`.
    rotations, rate : ndarray or csr_array, shape (3 k, nv), and ndarray, shape (3 k,), or None
        Rows of the angular velocities about the normal and both tangents, and their rates at v = 0.
    """
    k = len(tangents.friction)
    order = np.concatenate([np.arange(2 * k).reshape(k, 2), 2 * k + np.arange(3 * k).reshape(k, 3)], axis=1).ravel()
    jacobian, rates = take_rows(stack_rows([tangents.jacobian, rotations]), order), None
    if tangents.rate is not None or rate is not None:
        both = np.zeros(2 * k) if tangents.rate is None else tangents.rate, np.zeros(3 * k) if rate is None else rate
        rates = np.concatenate(both)[order]
    return Tangents(tangents.friction, tangents.axes, jacobian, rates, resistance)


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


def rotations_of(
    families: Sequence[Any], which: Array, t: float, q: Array, rows: Rows, tangents: Tangents, resistance: Array
) -> tuple[Array | csr_array, Array | None]:
    """Return the rows and the rates at v = 0 of the angular velocities of contacts; zero where they have no resistance.

    Parameters
    ----------
    families : sequence of ConstraintFamily
        All families.
    which : ndarray of int, shape (k,)
        The family of each row.
    t, q
        Time and configuration.
    rows : Rows
        The rows, with the constraints' numbers in their families.
    tangents : Tangents
        Their tangents.
    resistance : ndarray, shape (k, 2)
        See `Tangents`.
    """
    k, nv = len(which), rows.jacobian.shape[1]
    sparse = not isinstance(tangents.jacobian, np.ndarray)
    parts: list[Array | csr_array] = [csr_array((3 * k, nv)) if sparse else np.zeros((3 * k, nv))]
    here, order, rates, end = np.flatnonzero(resistance.any(axis=1)), np.arange(3 * k).reshape(k, 3), None, 3 * k
    for f in np.unique(which[here]).tolist():
        some = here[which[here] == f]
        own, rate = families[f].rotations(t, q, take(rows, some), tangents.axes[some])
        if rate is not None:
            rates = np.zeros((k, 3)) if rates is None else rates
            rates[some] = rate.reshape(-1, 3)
        order[some] = end + np.arange(3 * len(some)).reshape(-1, 3)
        end += 3 * len(some)
        parts.append(own)
    return take_rows(stack_rows(parts), order.ravel()), None if rates is None else rates.ravel()
