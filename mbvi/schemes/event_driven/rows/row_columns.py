"""Columns of the rows of `SmoothRows`, their gaps by the families, and the points of bodies that they are."""

from __future__ import annotations

from typing import Any

import numpy as np

from ....constraints import ConstraintFamily, RowTable
from ....constraints.features.feature_kernels import FACE_VERTEX
from ....constraints.features.pair_features import FeatureRows
from ....constraints.mechanism.held_rows import LIMIT, RowParts
from ....constraints.rows import Array

# that of distances that are searched, from placements that are rounded, over that of others
SEARCHED = 100.0


def measured_by(family: ConstraintFamily | FeatureRows, t: float, q: Array, rows: Array, near: float) -> Array:
    """Return what `SmoothRows.measured` does of the rows of one family."""
    return family.row_gap(t, q, rows) if near == np.inf else family.row_lower_bound(t, q, rows)


def extent(system: Any, q: Array) -> float:
    """Return the largest distance of a body from the origin [m]."""
    bodies = np.arange(1, len(system.bodies))
    return float(np.linalg.norm(system.placements(q, bodies)[:, 3], axis=1).max()) if bodies.size else 0.0


def completed(table: RowTable, e: float, nv: int) -> tuple[Array, ...]:
    """Return the columns of a table, with the problem's e and infinite numbers in place of unknown ones."""
    number, own, smooth, reach, thickness, featured = table
    return (
        number,
        np.where(np.isnan(own), e, own),
        smooth,
        np.full((len(number), nv), np.inf) if reach is None else reach,
        np.full(len(number), np.inf) if thickness is None else thickness,
        np.zeros(len(number), bool) if featured is None else featured,
    )


def body_points(rows: RowParts) -> Array:
    """Return of rows that are heights of points of bodies above fixed planes, shape (k, 7): body, point, normal.

    Points are in frames of bodies, NaN for other rows; a limit of a joint has the body 0.
    """
    kind, sides, parts, *_ = rows
    table = np.column_stack([sides[:, 1], parts[:, 1, 0], parts[:, 0, 1]])
    table[(kind != FACE_VERTEX) | (sides[:, 0] != 0)] = np.nan
    table[kind == LIMIT] = 0.0
    return table
