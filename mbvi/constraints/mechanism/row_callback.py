"""Rows of constraints that are functions of the user: a kernel calls Python by an address."""

from __future__ import annotations

from typing import NamedTuple

from ...compiled import call_address, kernel, record
from ..rows import Array, Rows
from .tables import FOUND, MOST_ROWS, TOO_MANY, UNRESOLVED, RowBuffer, copy_row


@record("i8[::1], f8[::1], RowBuffer")
class RowCallback(NamedTuple):
    """A function of Python that finds rows, and where it writes them.

    Attributes
    ----------
    address : ndarray of int, shape (1,)
        Of a function that writes the rows of a family to `rows`, -1 as their number if it fails. It takes the family,
        the time, the address of q, and the tolerance.
    time : ndarray, shape (1,)
        Time of the queries [s].
    rows : RowBuffer
        Receives the rows.
    """

    address: Array
    time: Array
    rows: RowBuffer


@kernel("i8(RowCallback, i8, Array(f8, 1, 'C', True), f8, RowBuffer)")
def rows_by_callback(given: RowCallback, k: int, q: Array, tolerance: float, rows: RowBuffer) -> int:
    """Append the rows of family k at q within a tolerance [m]; return a code."""
    call_address(given.address[0], k, given.time[0], q.ctypes.data, tolerance)
    found = given.rows.size[0]
    if found < 0:
        return UNRESOLVED
    if rows.size[0] + found > MOST_ROWS:
        return TOO_MANY
    for a in range(found):
        copy_row(given.rows, a, rows)
    return FOUND


def write_rows(rows: Rows, lever: Array | float, buffer: RowBuffer) -> None:
    """Write rows that Python has found to a buffer; of more than `MOST_ROWS` only their number."""
    count = len(rows.gap)
    buffer.size[0] = count
    if count > MOST_ROWS:
        return
    buffer.number[:count], buffer.gap[:count], buffer.e[:count] = rows.constraint, rows.gap, rows.restitution
    buffer.lever[:count], buffer.J[:count], buffer.mu[:count] = lever, rows.jacobian, 0.0
    buffer.point[:count], buffer.normal[:count] = rows.point, rows.normal
    if rows.tangents is not None:
        buffer.mu[:count], buffer.axes[:count] = rows.tangents.friction, rows.tangents.axes
        buffer.T[: 2 * count] = rows.tangents.jacobian
