"""Projections onto rows, with Coulomb's law where they have friction."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from ..constraints import Rows
from ..constraints.rows import concatenate
from ..constraints.tangents import Tangents
from ..projection import Metric, Projector, joint_rows
from ..system.free.sparse_rows import stack_rows, take_rows
from ..system.system import Array


class RowProjection(NamedTuple):
    """A velocity and the percussions that lead to it.

    Attributes
    ----------
    velocity : ndarray, shape (nv,)
        w with M (w - x) = J' p.
    percussion : ndarray, shape (k,)
        Normal percussions p >= 0 [N s, N m s].
    residual : float
        Relative KKT residual; with friction that of Coulomb's law.
    tangential : ndarray, shape (k, w), or None
        Percussions along the tangents, and about the axes of torsional and rolling friction [N s, N m s]; None without
        friction.
    """

    velocity: Array
    percussion: Array
    residual: float
    tangential: Array | None = None


def project_rows(
    projector: Projector, x: Array, metric: Metric, rows: Rows, lower: Array, h: float | None = None
) -> RowProjection:
    """Return the velocity nearest to x with J w >= lower, or where rows have friction that of Coulomb's law.

    Parameters
    ----------
    projector : Projector
        Solves the projection.
    x : ndarray, shape (nv,)
        Velocity under the forces alone.
    metric : Metric
        M.
    rows : Rows
        The rows.
    lower : ndarray, shape (k,)
        Least J w; df/dt is part of it [m/s, rad/s].
    h : float, optional
        See `Projector.project`.
    """
    friction, tangents, k = metric.friction, rows.tangents, len(lower)
    if friction is None and (tangents is None or not tangents.friction.any()):
        plain = projector.project(x, metric, rows.jacobian, lower, rows.constraint, h)
        return RowProjection(*plain, None if tangents is None else np.zeros((k, tangents.width)))
    resistance = None if tangents is None else tangents.resistance
    wide = rows if tangents is None else rows._replace(tangents=tangents.sliding())
    if friction is not None:
        wide = with_joints(wide, metric)
    others = len(wide.gap)
    if tangents is not None and resistance is not None:
        wide = with_resistance(wide, tangents, resistance)
    found = projector.frictional(x, metric, wide, np.concatenate([lower, np.zeros(len(wide.gap) - k)]), h)
    each = found.percussion.reshape(-1, 3)
    tangential = each[:k, 1:]
    if resistance is not None:
        tangential = np.column_stack([tangential, rotational(resistance, each[others:, 1:])])
    return RowProjection(found.velocity, each[:k, 0].copy(), found.residual, tangential)


def with_resistance(rows: Rows, tangents: Tangents, resistance: Array) -> Rows:
    """Return rows followed by those of torsional and rolling friction, which the first k of them bound.

    Parameters
    ----------
    rows : Rows
        k contacts with two tangents each, and perhaps others.
    tangents : Tangents
        The tangents and axes of rotation of the k contacts.
    resistance : ndarray, shape (k, 2)
        The lengths of torsional and of rolling friction [m].
    """
    torsional, rolling = (np.flatnonzero(resistance[:, column]) for column in range(2))
    bound, mu = np.concatenate([torsional, rolling]), np.concatenate([resistance[torsional, 0], resistance[rolling, 1]])
    d, nv = len(bound), rows.jacobian.shape[1]
    zeros = np.zeros if isinstance(tangents.jacobian, np.ndarray) else csr_array
    # the second tangent of torsional friction is a zero row, behind all others
    jacobian = stack_rows([tangents.jacobian, zeros((1, nv))])
    spin = np.stack([5 * torsional + 2, np.full(len(torsional), jacobian.shape[0] - 1)], axis=1)
    chosen = np.concatenate([spin.ravel(), np.stack([5 * rolling + 3, 5 * rolling + 4], axis=1).ravel()])
    rate = None if tangents.rate is None else np.append(tangents.rate, 0.0)[chosen]
    along = Tangents(mu, np.zeros((d, 2, 3)), take_rows(jacobian, chosen), rate)
    none, nowhere = np.zeros(d), np.full((d, 3), np.nan)
    extra = Rows(rows.constraint[bound], none, zeros((d, nv)), none, nowhere, nowhere, None, along)
    wide = concatenate([rows, extra])
    assert wide.tangents is not None
    bounds = np.concatenate([np.full(len(rows.gap), -1), bound])
    return wide._replace(tangents=wide.tangents._replace(bound=bounds))


def rotational(resistance: Array, turning: Array) -> Array:
    """Return the percussions about the three axes of each contact, shape (k, 3), given those of `with_resistance`."""
    about, torsional = np.zeros((len(resistance), 3)), np.flatnonzero(resistance[:, 0])
    about[torsional, 0] = turning[: len(torsional), 0]
    about[np.flatnonzero(resistance[:, 1]), 1:] = turning[len(torsional) :]
    return about


def with_joints(rows: Rows, metric: Metric) -> Rows:
    """Return rows with tangents, followed by those of joints and hinges with dry friction, which the metric has."""
    tangents, mu = joint_rows(metric)
    k, d, nv = len(rows.gap), len(mu), tangents.shape[1]
    if rows.tangents is None:
        rows = rows._replace(tangents=Tangents(np.zeros(k), np.zeros((k, 2, 3)), np.zeros((2 * k, nv)), None))
    none, nowhere = np.zeros(d), np.full((d, 3), np.nan)
    along = Tangents(mu, np.zeros((d, 2, 3)), tangents, None)
    joints = Rows(np.full(d, -1), none, np.zeros((d, nv)), none, nowhere, nowhere, None, along)
    return concatenate([rows, joints])


def slip_rates(rows: Rows, tangential: Array | None, free: Array, after: Array, before: Array) -> Array | None:
    """Return `Step.slip` of rows, shape (4, k, w), from the velocities; None without friction."""
    if rows.tangents is None or tangential is None:
        return None
    slip = np.empty((4, *tangential.shape))
    slip[0], slip[1], slip[2], slip[3] = tangential, *(rows.tangents.slip(v) for v in (free, after, before))
    return slip
