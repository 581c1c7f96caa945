"""How far a displacement moves bodies, and with that how far gaps are linear in it."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...compiled import kernel
from ..metric import Array

# most linearisations of the constraints within a step
MOST_LINEARISATIONS = 20
# rows whose gap is below this part of the penetration take part in the projection
NEARBY = 0.1


@kernel("void(f8[:,::1], f8[::1], i8[::1], f8[::1])")
def write_travels_of_parts(squares: Array, displacement: Array, part: Array, travels: Array) -> None:
    """Write how far a displacement moves the bodies of each part [m]; see `ClearanceCache.travel`.

    Parameters
    ----------
    squares : ndarray, shape (families, nv)
        Squares of the envelopes of families.
    displacement : ndarray, shape (nv,)
        The displacement.
    part : ndarray of int, shape (nv,)
        Which mechanism or free body each velocity belongs to; see `independent_parts`.
    travels : ndarray, shape (parts,)
        Receives the lengths.
    """
    families, n = squares.shape
    total = np.empty(len(travels))
    for p in range(len(travels)):
        travels[p] = 0.0
    for i in range(families):
        total[:] = 0.0
        for k in range(n):
            total[part[k]] += squares[i, k] * displacement[k] * displacement[k]
        for p in range(len(travels)):
            travels[p] = max(travels[p], np.sqrt(total[p]))


@kernel("void(f8[:,::1], f8[::1], i8[::1], f8[::1])")
def write_bends(squares: Array, displacement: Array, part: Array, bends: Array) -> None:
    """Write of each part about the second-order part of a gap: the turning part of a displacement times its angle [m].

    Only turning bends gaps to flat shapes, so that the result is the same for each observer in uniform motion.
    `squares` are those of the envelopes for velocities that turn, 0 of others; the rest is as of
    `write_travels_of_parts`.
    """
    families, n = squares.shape
    travel, angle = np.empty(len(bends)), np.empty(len(bends))
    for p in range(len(bends)):
        bends[p] = 0.0
    for i in range(families):
        travel[:] = 0.0
        angle[:] = 0.0
        for k in range(n):
            if squares[i, k] > 0.0:
                travel[part[k]] += squares[i, k] * displacement[k] * displacement[k]
                angle[part[k]] += displacement[k] * displacement[k]
        for p in range(len(bends)):
            bends[p] = max(bends[p], np.sqrt(travel[p] * angle[p]))


@kernel("void(f8[:,::1], i8[::1], f8[::1], f8[::1])")
def write_largest_of_parts(J: Array, part: Array, values: Array, largest: Array) -> None:
    """Write of each row the largest value, at least 0, of the parts that it acts on.

    Parameters
    ----------
    J : ndarray, shape (k, nv)
        The rows.
    part : ndarray of int, shape (nv,)
        See `write_travels_of_parts`.
    values : ndarray, shape (parts,)
        The values.
    largest : ndarray, shape (k,)
        Receives one for each row.
    """
    for a in range(len(largest)):
        largest[a] = 0.0
        for k in range(len(part)):
            if J[a, k] != 0.0:
                largest[a] = max(largest[a], values[part[k]])


@kernel("void(f8[:,::1], i8[::1], f8[::1], f8[::1])")
def write_largest_of_rows(J: Array, part: Array, values: Array, largest: Array) -> None:
    """Write of each part the largest value, at least 0, of the rows that act on it, shapes (k,) and (parts,)."""
    largest[:] = 0.0
    for a in range(len(values)):
        for k in range(len(part)):
            if J[a, k] != 0.0:
                largest[part[k]] = max(largest[part[k]], values[a])


def largest_of_parts(J: Any, part: Array, values: Array) -> Array:
    """Return what `write_largest_of_parts` writes, for rows that may be sparse."""
    largest = np.zeros(J.shape[0])
    if values.any():
        row, column = _entries(J)
        np.maximum.at(largest, row, values[part[column]])
    return largest


def largest_of_rows(J: Any, part: Array, values: Array) -> Array:
    """Return what `write_largest_of_rows` writes, for rows that may be sparse."""
    largest, (row, column) = np.zeros(part[-1] + 1), _entries(J)
    np.maximum.at(largest, part[column], values[row])
    return largest


def _entries(J: Any) -> tuple[Array, Array]:
    """Return the rows and the columns of entries, faster than `nonzero` of sparse arrays does."""
    if isinstance(J, np.ndarray):
        row, column = J.nonzero()
        return row, column
    return np.repeat(np.arange(J.shape[0]), np.diff(J.indptr)), J.indices
