"""Contacts of spheres, capsules, boxes and cylinders in closed form, for many pairs in one call.

A pair has a closed form if both shapes are spheres, capsules or boxes, or one is a sphere and the other a cylinder.
The other pairs with a cylinder have none: their signed distance is a root of a polynomial of high degree.
"""

from __future__ import annotations

import numpy as np

from ...arguments import Array
from ...compiled import kernel
from ..shapes.shape_cores import place_cores
from ..shapes.shape_table import BALL, CAPSULE, CYLINDER, ShapeTable
from .ball_contact import ball_contact
from .box_box import box_contacts

# closed forms: none; the first shape is a sphere; the second is; both are boxes or capsules
NONE, FIRST_BALL, SECOND_BALL, BOXES = 0, 1, 2, 3
# the closed form of a pair of kinds
_FORM = np.full((5, 5), BOXES)
_FORM[CYLINDER:], _FORM[:, CYLINDER:] = NONE, NONE
_FORM[: CYLINDER + 1, BALL], _FORM[BALL, : CYLINDER + 1] = SECOND_BALL, FIRST_BALL
# most contacts of a pair: eight corners of a patch, and the deepest point
_MOST = 9


@kernel(
    "i8(f8[:,:,::1], i8[::1], f8[:,:,::1], f8[:,::1], i8[:,::1], i8[::1], i8[::1], f8, i8[::1], f8[::1],"
    " f8[:,::1], f8[:,::1])",
    apart=True,
)
def primitive_contacts(
    places: Array, frame: Array, fixed: Array, sizes: Array, sides: Array, form: Array, measured: Array,
    tolerance: float, pair: Array, gap: Array, point: Array, normal: Array,
) -> int:  # fmt: skip
    """Write the contacts of pairs that have a closed form, pair after pair; return how many there are.

    If they are more than the arrays have room for, only the first are written.

    Parameters
    ----------
    places : ndarray, shape (b, 4, 3)
        Placements of the bodies: columns of the rotation, then the origin.
    frame : ndarray of int, shape (s,)
        The place of each shape's body in `places`; -1 for the world.
    fixed, sizes : ndarray, shapes (s, 4, 3), (s, 8)
        Placements of the shapes in their bodies; half edges of a box, radii of a ball and of a disk [m].
    sides, form : ndarray of int, shapes (n, 2), (n,)
        The shapes of each pair, and its closed form.
    measured : ndarray of int, shape (k,)
        The pairs to measure.
    tolerance : float
        Gap at and below which a pair gets its patch; others get their nearest point only [m].
    pair, gap, point, normal : ndarray, shapes (m,), (m,), (m, 3), (m, 3)
        Receive the contacts: the pair, the gap [m], the point midway between the surfaces, the unit normal from the
        first shape to the second.
    """
    cores, polygon, found, count = np.empty((2, 12, 3)), np.empty((2, 32, 3)), np.empty((33, 7)), 0
    for index in range(len(measured)):
        number = measured[index]
        place_cores(places, frame, fixed, sizes, sides, number, cores)
        contacts = 1
        if form[number] == BOXES:
            contacts = box_contacts(cores, tolerance, polygon, found)
        else:
            ball_contact(cores, 0 if form[number] == FIRST_BALL else 1, found)
        for row in range(contacts):
            if count < len(gap):
                pair[count], gap[count] = number, found[row, 0]
                for c in range(3):
                    point[count, c], normal[count, c] = found[row, 1 + c], found[row, 4 + c]
            count += 1
    return count


@kernel(
    "i8(f8[:,:,::1], i8[::1], f8[:,:,::1], f8[:,::1], i8[:,::1], i8[::1], i8[::1], i8[::1], f8[::1], f8[:,::1],"
    " f8[:,::1])"
)
def ball_contacts(
    places: Array, frame: Array, fixed: Array, sizes: Array, sides: Array, form: Array, measured: Array,
    pair: Array, gap: Array, point: Array, normal: Array,
) -> int:  # fmt: skip
    """Write the contacts of pairs of which one shape is a sphere; as `primitive_contacts`, which takes long to compile.

    Each pair has one contact, for which there must be room.
    """
    cores, found = np.empty((2, 12, 3)), np.empty((1, 7))
    for row in range(len(measured)):
        number = measured[row]
        place_cores(places, frame, fixed, sizes, sides, number, cores)
        ball_contact(cores, 0 if form[number] == FIRST_BALL else 1, found)
        pair[row], gap[row] = number, found[0, 0]
        for c in range(3):
            point[row, c], normal[row, c] = found[0, 1 + c], found[0, 4 + c]
    return len(measured)


class PrimitivePairs:
    """Contacts of those pairs of a list that have a closed form.

    Parameters
    ----------
    table : ShapeTable
        The shapes.
    sides : ndarray of int, shape (n, 2)
        The two shapes of each pair.

    Attributes
    ----------
    form : ndarray of int, shape (n,)
        The closed form of each pair, `NONE` if it has none.
    smooth : ndarray of bool, shape (n,)
        Which pairs have a continuous gradient: sphere and sphere, sphere and capsule.
    """

    def __init__(self, table: ShapeTable, sides: Array) -> None:
        self._frame, self._fixed, self._sizes = table.arrays[:3]
        self._sides, (first, second) = sides, table.kind[sides.T]
        self.form = _FORM[first, second]
        balls = (self.form == FIRST_BALL) | (self.form == SECOND_BALL)
        self.smooth = balls & (first <= CAPSULE) & (second <= CAPSULE)
        self._boxes = self.form == BOXES
        self._only_balls = not self._boxes.any()
        self._room = _MOST

    def contacts(self, places: Array, pairs: Array, tolerance: float) -> tuple[Array, Array, Array, Array]:
        """Return the contacts of pairs that have a closed form.

        Parameters
        ----------
        places : ndarray, shape (b, 4, 3)
            Placements of the bodies.
        pairs : ndarray of int, shape (k,)
            The pairs.
        tolerance : float
            Gap at and below which parallel faces give every corner that they share; others one contact a pair [m].

        Returns
        -------
        pair : ndarray of int, shape (c,)
            The pair of each contact, in the order given.
        gap, point, normal : ndarray, shapes (c,), (c, 3), (c, 3)
            Gap [m], point midway between the surfaces, unit normal from first to second; the least gap of a pair is
            its signed distance.
        """
        shared = places, self._frame, self._fixed, self._sizes, self._sides, self.form, pairs
        self._room = max(self._room, 4 * len(pairs))
        found = self._rows(self._room)
        if self._only_balls or not self._boxes[pairs].any():
            count = ball_contacts(*shared, *found)
        else:
            count = primitive_contacts(*shared, tolerance, *found)
            if count > self._room:
                self._room = 2 * count
                found = self._rows(self._room)
                primitive_contacts(*shared, tolerance, *found)
        pair, gap, point, normal = found
        return pair[:count], gap[:count], point[:count], normal[:count]

    @staticmethod
    def _rows(count: int) -> tuple[Array, Array, Array, Array]:
        return np.empty(count, np.int64), np.empty(count), np.empty((count, 3)), np.empty((count, 3))
