"""Distances of pairs of shapes of one mechanism, several pairs by one call of a kernel."""

from __future__ import annotations

import numpy as np

from ....compiled import held, kernel, plain_array
from ....constraints.mechanism.pairs import (
    LEFT_TO_PYTHON,
    PairShapes,
    distance_of,
    measured_in_closed_form,
    place_bodies,
)
from ....geometry.closed_form.primitive_pairs import NONE
from ....geometry.narrow.pair_contacts import write_contacts
from ....geometry.shapes.shape_table import Shapes  # noqa: F401  (a signature names it)
from ....system.mechanisms.mechanism import Mechanism, place
from ....system.system import Array

# in the place of a row's pair: a row that is none, and one that kernels do not know
NO_PAIR, UNKNOWN_ROW = -1, -2
# gap of a contact above the distance of its pair by which it is not the nearest, relative to the smaller shape
_ALONE = 1e-13


@kernel("f8(Tuple(Shapes), PairShapes, i8, f8, f8[::1], f8[::1])")
def nearest_contact(
    tables: tuple[Array, ...], shapes: PairShapes, pair: int, near: float, point: Array, normal: Array
) -> float:
    """Write the nearest contact of a pair where its bodies are placed; return its gap, a lower bound if it is not near.

    Point and normal, shapes (3,), are those of the distance; where that is a lower bound, they mean nothing.
    """
    if shapes.form[pair] != NONE:
        shapes.closed[0] = pair
        total, least = measured_in_closed_form(shapes.places, tables, shapes, 0.0, 1, 0), 0
    else:
        # the pair is then the chosen one
        distance, chosen = distance_of(tables, shapes, pair, near), shapes.others[:1]
        for c in range(3):
            point[c], normal[c] = shapes.middle[0, c], shapes.normal[0, c]
        if distance > 0.0:
            return distance
        # the normals of faces are more exact than those that were found
        total, least = write_contacts(
            shapes.places, tables, shapes.bound, shapes.flat, chosen, 0.0, shapes.distance, shapes.normal,
            shapes.middle, shapes.state, shapes.owner, shapes.gap, shapes.point, shapes.normals,
        ), 0  # fmt: skip
    for j in range(1, total):
        least = j if shapes.gap[j] < shapes.gap[least] else least
    if shapes.form[pair] == NONE and shapes.gap[least] > shapes.distance[0] + _ALONE * shapes.bound[pair]:
        # where edges cross, corners of nearly level faces lie higher
        for c in range(3):
            point[c], normal[c] = shapes.middle[0, c], shapes.normal[0, c]
        return shapes.distance[0]
    for c in range(3):
        point[c], normal[c] = shapes.point[least, c], shapes.normals[least, c]
    return shapes.gap[least]


@kernel("void(Tuple(Shapes), PairShapes, i8[::1], f8, f8[::1])")
def write_placed_distances(
    tables: tuple[Array, ...], shapes: PairShapes, pairs: Array, near: float, distance: Array
) -> None:
    """Write what `write_distances` does where bodies are placed."""
    point, normal = np.empty(3), np.empty(3)
    for i in range(len(pairs)):
        distance[i] = nearest_contact(tables, shapes, pairs[i], near, point, normal)


@kernel("void(Mechanism, Tuple(Shapes), PairShapes, i8[::1], f8, f8[::1])")
def write_distances(
    m: Mechanism, tables: tuple[Array, ...], shapes: PairShapes, pairs: Array, near: float, distance: Array
) -> None:  # fmt: skip
    """Write the distances of some pairs, or lower bounds if they are not near, where the mechanism is placed."""
    place_bodies(m, shapes)
    write_placed_distances(tables, shapes, pairs, near, distance)


@kernel("void(Mechanism, Tuple(Shapes), PairShapes, i8[::1], f8, f8[::1], f8[::1])")
def distances_at(
    m: Mechanism, tables: tuple[Array, ...], shapes: PairShapes, pairs: Array, near: float, q: Array, distance: Array
) -> None:  # fmt: skip
    """Write the distances of some pairs at q; see `write_distances`."""
    place(m, q)
    write_distances(m, tables, shapes, pairs, near, distance)


class KnownPairs:
    """The pairs of shapes of one mechanism whose distances are searched.

    Parameters
    ----------
    mechanism : Mechanism
        What `held` returns of a record of its own.
    bodies : tuple of ndarray
        The first and the second body of each pair.
    tables, shapes
        What `ConstraintFamily.loop_tables` returns.

    Attributes
    ----------
    tables, shapes
        The same, the second as `held` returns it.
    bodies : ndarray of int, shape (2, n)
        The same.
    known : ndarray of bool, shape (n,)
        Which pairs the kernels know.
    """

    def __init__(
        self, mechanism: Mechanism, bodies: tuple[Array, Array], tables: tuple[Array, ...], shapes: PairShapes
    ) -> None:
        self._mechanism, self.tables, self.bodies = mechanism, tables, np.array(bodies)
        self.known = np.full(len(shapes.form), shapes.mode != LEFT_TO_PYTHON)
        self.shapes: PairShapes = held(shapes)

    def distances(self, q: Array, pairs: Array, near: float) -> Array:
        """Return the distances of some pairs at q; lower bounds of those that are not `near` [m]."""
        found = np.empty(len(pairs))
        distances_at(self._mechanism, self.tables, self.shapes, pairs, near, plain_array(q), found)
        return found


def searched_pairs(
    known: Array | None, found: list[tuple[KnownPairs, slice]], count: int
) -> tuple[KnownPairs | None, Array]:
    """Return the pairs that kernels search, if they are of one family, and of each of `count` rows its pair.

    Parameters
    ----------
    known : ndarray of bool, shape (count,), or None
        Which rows kernels know that are no pairs.
    found : list
        The pairs of each family with the rows that they are.
    count : int
        How many rows there are.
    """
    if known is None or len(found) != 1:
        return None, np.full(count, UNKNOWN_ROW)
    pair = np.where(known, NO_PAIR, UNKNOWN_ROW)
    (pairs, own), numbers = found[0], np.arange(len(found[0][0].known))
    pair[own] = np.where(pairs.known, numbers, pair[own])
    return pairs, pair
