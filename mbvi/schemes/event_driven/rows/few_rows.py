"""Of the many points of one shape that touch a half-space those few that become rows, and those that they hold."""

from __future__ import annotations

import numpy as np

from ....constraints.rows import Array
from ....geometry.narrow.spread import FEW_POINTS
from ....geometry.vectors import within_plane
from .contact_rows import SmoothRows
from .row_sets import members

# points span a line or a plane if they lie beside others by more than this part of their extent
_BESIDE = 1e-9


def few_rows(rows: SmoothRows, t: float, q: Array, index: Array, closing: Array) -> Array:
    """Return of some rows that touch, shape (k,), those that bear the load of all; see `ConstraintFamily.bearing`.

    Parameters
    ----------
    rows : SmoothRows
        All rows.
    t, q
        Time [s] and configuration.
    index : ndarray of int, shape (k,)
        Rows that touch, ascending.
    closing : ndarray of int
        Those that close now: they are always returned, each in place of the nearest one of its shape.
    """
    if len(index) <= FEW_POINTS:
        # no shape has more
        return index
    wanted = rows.bearing(t, q, index)
    new = np.flatnonzero(members(index, closing) & ~wanted)
    if not new.size:
        return index[wanted]
    points, _ = rows.points(t, q, index)
    for k in new.tolist():
        others = np.flatnonzero(wanted & (rows.number[index] == rows.number[index[k]]))
        wanted[others[np.linalg.norm(points[others] - points[k], axis=1).argmin()]] = False
    wanted[new] = True
    return index[wanted]


def held_rows(rows: SmoothRows, t: float, q: Array, touching: Array, closed: Array) -> Array:
    """Return the rows that touch and cannot close as long as the closed ones do not open.

    Three points of a shape that stay on a half-space, on no line, keep the place of all its points above it. Points on
    one line keep the points of that line.

    Parameters
    ----------
    rows, t, q
        See `few_rows`.
    touching, closed : ndarray of int
        Rows that touch, all of them, and those of them that are closed.
    """
    if len(touching) <= FEW_POINTS:
        # all of them were asked, as no shape has more
        return touching[:0]
    number, held, bears = rows.number[touching], [touching[:0]], members(touching, closed)
    for one in np.unique(number[bears]).tolist():
        own = number == one
        if own.sum() <= FEW_POINTS:
            # all of them were asked
            continue
        (points, normals), along, across = rows.points(t, q, touching[own]), np.empty(3), np.empty(3)
        within_plane(normals[0].copy(), along, across)
        place = points @ np.stack([along, across], axis=1)
        place -= place[bears[own]][0]
        _, size, axes = np.linalg.svd(place[bears[own]])
        spanned = axes[: np.count_nonzero(size > _BESIDE * np.abs(place).max())]
        beside = np.linalg.norm(place - place @ spanned.T @ spanned, axis=1)
        held.append(touching[own][~bears[own] & (beside <= _BESIDE * np.abs(place).max())])
    return np.sort(np.concatenate(held))
