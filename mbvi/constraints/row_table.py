"""The table of all rows of a family of constraints."""

from __future__ import annotations

from typing import NamedTuple

from .rows import Array


class RowTable(NamedTuple):
    """All rows of a family, near or far, as `EventDriven` needs them to find the times at which gaps close.

    Attributes
    ----------
    number : ndarray of int, shape (k,)
        The constraint that each row belongs to, counted within the family.
    restitution : ndarray, shape (k,)
        e of each row; NaN where the problem's own applies.
    smooth : ndarray of bool, shape (k,)
        Whether the gradient of each row is continuous.
    reach : ndarray, shape (k, nv), or None
        Bounds of the entries of each gradient; None where they are not known.
    thickness : ndarray, shape (k,), or None
        The least travel within which bodies can pass through each other [m]; None where they never can.
    featured : ndarray of bool, shape (k,), or None
        Whether `ConstraintFamily.feature_rows` knows the features of a row that is not smooth; None where of no row.
    """

    number: Array
    restitution: Array
    smooth: Array
    reach: Array | None = None
    thickness: Array | None = None
    featured: Array | None = None
