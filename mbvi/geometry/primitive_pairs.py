"""Contacts of spheres, capsules, boxes and cylinders in closed form, for many pairs in one call.

A pair has a closed form if both shapes are spheres, capsules or boxes, or one is a sphere and the other a cylinder.
The other pairs with a cylinder have none: their signed distance is a root of a polynomial of high degree.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..arguments import Array
from ..compiled import kernel
from .ball_contact import ball_contact
from .box_box import box_contacts
from .separating_axis import Shapes
from .shape_cores import place_cores
from .shapes import Box, Capsule, Cylinder, PlacedShape, Sphere

# closed forms: none; the first shape is a sphere; the second is; both are boxes or capsules
NONE, FIRST_BALL, SECOND_BALL, BOXES = 0, 1, 2, 3
# most contacts of a pair: eight corners of a patch, and the deepest point
_MOST = 9


@kernel(
    "i8(f8[:,:,::1], i8[::1], f8[:,:,::1], f8[:,::1], i8[:,::1], i8[::1], i8[::1], f8, i8[::1], f8[::1],"
    " f8[:,::1], f8[:,::1])"
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


def closed_form(first: PlacedShape, second: PlacedShape) -> int:
    """Return the code of the closed form of two shapes, `NONE` if there is none."""
    shapes = first.shape, second.shape
    balls = [isinstance(s, Sphere) or (isinstance(s, Capsule) and s.length == 0.0) for s in shapes]
    cores = [isinstance(s, Sphere | Capsule | Box) for s in shapes]
    if balls[0] and (cores[1] or isinstance(shapes[1], Cylinder)):
        return FIRST_BALL
    if balls[1] and (cores[0] or isinstance(shapes[0], Cylinder)):
        return SECOND_BALL
    return BOXES if all(cores) else NONE


class PrimitivePairs:
    """Contacts of those pairs of a list that have a closed form.

    Parameters
    ----------
    shapes : sequence of PlacedShape
        The shapes.
    tables : Shapes
        The arrays of these shapes and their pairs.

    Attributes
    ----------
    form : ndarray of int, shape (n,)
        The closed form of each pair, `NONE` if it has none.
    smooth : ndarray of bool, shape (n,)
        Which pairs have a continuous gradient: sphere and sphere, sphere and capsule.
    """

    def __init__(self, shapes: Sequence[PlacedShape], tables: Shapes) -> None:
        self._frame, self._fixed, self._sizes = tables[:3]
        self._sides = sides = tables.sides
        self.form = np.array([closed_form(shapes[a], shapes[b]) for a, b in sides.tolist()], dtype=np.int64)
        self.smooth = (self.form == FIRST_BALL) | (self.form == SECOND_BALL)
        self.smooth &= np.array([isinstance(s.shape, Sphere | Capsule) for s in shapes])[sides].all(axis=1)
        self._only_balls = not (self.form == BOXES).any()
        self._room = self._rows(_MOST)

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
        if len(self._room[0]) < len(pairs):
            self._room = self._rows(2 * len(pairs))
        if self._only_balls:
            count = ball_contacts(*shared, *self._room)
        else:
            count = primitive_contacts(*shared, tolerance, *self._room)
            if count > len(self._room[0]):
                self._room = self._rows(2 * count)
                primitive_contacts(*shared, tolerance, *self._room)
        pair, gap, point, normal = self._room
        return pair[:count].copy(), gap[:count].copy(), point[:count].copy(), normal[:count].copy()

    def _rows(self, count: int) -> tuple[Array, Array, Array, Array]:
        return np.empty(count, np.int64), np.empty(count), np.empty((count, 3)), np.empty((count, 3))
