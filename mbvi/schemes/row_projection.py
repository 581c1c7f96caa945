"""Projections onto rows, with Coulomb's law where they have friction."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..constraints import Rows
from ..constraints.rows import concatenate
from ..constraints.tangents import Tangents
from ..projection import Metric, Projector, joint_rows
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
    tangential : ndarray, shape (k, 2), or None
        Percussions along the tangents [N s]; None without friction.
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
    friction = metric.friction
    if friction is not None:
        wide = with_joints(rows, friction)
        padded = np.concatenate([lower, np.zeros(len(wide.gap) - len(lower))])
        found = projector.frictional(x, metric, wide, padded, h)
        each = found.percussion.reshape(-1, 3)[: len(lower)]
        return RowProjection(found.velocity, each[:, 0].copy(), found.residual, each[:, 1:])
    if rows.tangents is None or not rows.tangents.friction.any():
        plain = projector.project(x, metric, rows.jacobian, lower, rows.constraint, h)
        return RowProjection(*plain, None if rows.tangents is None else np.zeros((len(lower), 2)))
    found = projector.frictional(x, metric, rows, lower, h)
    each = found.percussion.reshape(-1, 3)
    return RowProjection(found.velocity, each[:, 0].copy(), found.residual, each[:, 1:])


def with_joints(rows: Rows, friction: Array) -> Rows:
    """Return rows with tangents, followed by those of joints with dry friction.

    `friction`, shape (nv,), are the largest percussions of joints.
    """
    tangents, mu = joint_rows(friction)
    k, d, nv = len(rows.gap), len(mu), len(friction)
    if rows.tangents is None:
        rows = rows._replace(tangents=Tangents(np.zeros(k), np.zeros((k, 2, 3)), np.zeros((2 * k, nv)), None))
    none, nowhere = np.zeros(d), np.full((d, 3), np.nan)
    along = Tangents(mu, np.zeros((d, 2, 3)), tangents, None)
    joints = Rows(np.full(d, -1), none, np.zeros((d, nv)), none, nowhere, nowhere, None, along)
    return concatenate([rows, joints])


def slip_rates(rows: Rows, tangential: Array | None, free: Array, after: Array, before: Array) -> Array | None:
    """Return `Step.slip` of rows, shape (4, k, 2), from the velocities; None without friction."""
    if rows.tangents is None or tangential is None:
        return None
    slip = np.empty((4, *tangential.shape))
    slip[0], slip[1], slip[2], slip[3] = tangential, *(rows.tangents.slip(v) for v in (free, after, before))
    return slip
