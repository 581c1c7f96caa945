"""Of the many points of one shape that touch one half-space those few that become rows, and those that they hold."""

from __future__ import annotations

import numpy as np
from scipy.optimize import nnls

from ...constraints.rows import Array
from ...geometry.spread import FEW_POINTS, spread_out
from ...geometry.vectors import within_plane
from .contact_rows import SmoothRows

# a point is in the hull of others if it lies no farther outside than this part of their extent
_BESIDE = 1e-9
# by how much the row that closes is put below the others, so that it is chosen, relative to their extent
_BELOW = 1e-9


def few_rows(rows: SmoothRows, t: float, q: Array, index: Array, closed: Array, closing: Array) -> Array:
    """Return of some rows, shape (k,), at most `FEW_POINTS` of each constraint; those of others do not bear load then.

    Parameters
    ----------
    rows : SmoothRows
        All rows.
    t, q
        Time [s] and configuration.
    index : ndarray of int, shape (k,)
        Rows that touch, ascending.
    closed, closing : ndarray of int
        Those that were chosen before, and those that close now: both are chosen again, if they are few.
    """
    number = rows.number[index]
    many, count = np.unique(number, return_counts=True)
    wanted = ~np.isin(number, many[count > FEW_POINTS])
    for one in many[count > FEW_POINTS].tolist():
        own = np.flatnonzero(number == one)
        gap, place = _seen_from_above(rows, t, q, index[own])
        new, old = np.isin(index[own], closing), np.isin(index[own], closed)
        kept = np.flatnonzero(new | old)
        if len(kept) <= FEW_POINTS:
            added = np.setdiff1d(_spread(gap, place), kept)
            kept = np.concatenate([kept, added[: FEW_POINTS - len(kept)]])
        else:
            lower = np.where(new & ~old, gap - _BELOW * np.ptp(place, axis=0).max(), gap)
            kept = kept[_spread(lower[kept], place[kept])]
        wanted[own[kept]] = True
    return index[wanted]


def held_rows(rows: SmoothRows, t: float, q: Array, touching: Array, closed: Array) -> Array:
    """Return the rows that touch and cannot close as long as the closed ones do not open.

    They are the points of a shape that lie in the convex hull of its closed ones.

    Parameters
    ----------
    rows, t, q
        As of `few_rows`.
    touching, closed : ndarray of int
        Rows that touch, all of them, and those of them that are closed.
    """
    number, held = rows.number[touching], [touching[:0]]
    bears = np.isin(touching, closed)
    for one in np.unique(number[bears]).tolist():
        own = number == one
        if own.sum() <= FEW_POINTS:
            # all of them were asked
            continue
        _, place = _seen_from_above(rows, t, q, touching[own])
        corners, others = place[bears[own]], place[~bears[own]]
        extent = float(np.ptp(place, axis=0).max())
        A = np.vstack([corners.T / extent, np.ones(len(corners))])
        beside = [nnls(A, np.append(x / extent, 1.0))[1] for x in others]
        held.append(touching[own & ~bears][np.array(beside) <= _BESIDE])
    return np.sort(np.concatenate(held))


def _seen_from_above(rows: SmoothRows, t: float, q: Array, index: Array) -> tuple[Array, Array]:
    """Return gaps and places within the plane of points of one shape above one half-space, shapes (k,) and (k, 2)."""
    (points, normals), along, across = rows.points(t, q, index), np.empty(3), np.empty(3)
    within_plane(normals[0].copy(), along, across)
    place = points @ np.stack([along, across], axis=1)
    return rows.gaps(t, q, index), place - place[0]


def _spread(gap: Array, place: Array) -> Array:
    """Return the indices of the points that `spread_out` chooses."""
    chosen, extent = np.empty(FEW_POINTS, np.int64), float(np.ptp(place, axis=0).max())
    return chosen[: spread_out(place, gap, extent, float(gap.max()), chosen)]
