"""Sets of a few rows, as arrays of their numbers: NumPy's functions for sets take longer than the comparisons."""

from __future__ import annotations

import numpy as np

from ....compiled import kernel
from ....system.system import Array


@kernel("void(i8[::1], i8[::1], b1[::1])")
def write_members(rows: Array, of: Array, found: Array) -> None:
    """Write of each row whether it is among others; neither need be in order."""
    for i in range(len(rows)):
        found[i] = False
        for k in range(len(of)):
            if of[k] == rows[i]:
                found[i] = True
                break


def members(rows: Array, of: Array) -> Array:
    """Return of each row whether it is among others, shape (k,) of bool; neither need be in order."""
    found = np.zeros(len(rows), bool)
    if len(of):
        write_members(rows, of, found)
    return found


def without(rows: Array, others: Array) -> Array:
    """Return the rows that are not among others."""
    return rows[~members(rows, others)] if len(others) else rows


def union(first: Array, second: Array) -> Array:
    """Return the rows of either of two ascending arrays, ascending."""
    new = without(second, first)
    if not len(new):
        return first
    return np.sort(np.concatenate([first, new])) if len(first) else new
