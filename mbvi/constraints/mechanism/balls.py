"""Contacts of free spheres with each other in the compiled loop, as `SphereContacts` finds them, without a list."""

from __future__ import annotations

from typing import NamedTuple

from ...compiled import kernel, record
from ...system.mechanisms.mechanism import Mechanism, place
from ..families.spheres import pairs_within
from ..rows import Array
from .pairs import append_contact
from .tables import FOUND, MOST_ROWS, TOO_MANY, PairFamily, RowBuffer


@record("i8[::1], f8[::1], i8[::1], f8[:,::1], i8[::1], f8[::1], f8[:,::1], f8[:,::1]")
class Balls(NamedTuple):
    """Free spheres, and room for their contacts.

    Attributes
    ----------
    position : ndarray of int, shape (n,)
        Where in q the centre of each begins.
    radius : ndarray, shape (n,)
        Radii [m].
    pairs : ndarray of int, shape (k,)
        All pairs i n + j, i < j.
    centre : ndarray, shape (n, 3)
        Room for the centres.
    pair, gap, point, normal : ndarray, shapes (k,), (k,), (k, 3) and (k, 3)
        Room for contacts.
    """

    position: Array
    radius: Array
    pairs: Array
    centre: Array
    pair: Array
    gap: Array
    point: Array
    normal: Array


@kernel("i8(Mechanism, Balls, PairFamily, f8[::1], f8, RowBuffer)")
def touching_balls(
    mechanism: Mechanism, balls: Balls, family: PairFamily, q: Array, tolerance: float, rows: RowBuffer
) -> int:
    """Append the contacts of spheres at q within a tolerance [m]; return a code.

    `family` has an entry for each i n + j.
    """
    for i in range(len(balls.radius)):
        for c in range(3):
            balls.centre[i, c] = q[balls.position[i] + c]
    count = pairs_within(
        balls.centre, balls.radius, balls.pairs, tolerance, balls.pair, balls.gap, balls.point, balls.normal
    )
    if rows.size[0] + count > MOST_ROWS:
        return TOO_MANY
    if count > 0:
        place(mechanism, q)
    for a in range(count):
        append_contact(mechanism, family, balls.pair[a], balls.gap[a], balls.point[a], balls.normal[a], rows)
    return FOUND
