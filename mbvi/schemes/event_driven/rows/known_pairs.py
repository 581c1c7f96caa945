"""Distances of pairs of shapes of one mechanism, several pairs by one call of a kernel."""

from __future__ import annotations

import numpy as np

from ....compiled import held, kernel, plain_array
from ....constraints.mechanism.pairs import LEFT_TO_PYTHON, PairShapes, distance_of, place_bodies
from ....geometry.closed_form.primitive_pairs import NONE
from ....geometry.narrow.pair_contacts import write_contacts
from ....geometry.shapes.shape_table import Shapes  # noqa: F401  (a signature names it)
from ....system.mechanisms.mechanism import Mechanism, place
from ....system.system import Array


@kernel("void(Mechanism, Tuple(Shapes), PairShapes, i8[::1], f8, f8[::1])")
def write_distances(
    m: Mechanism, tables: tuple[Array, ...], shapes: PairShapes, pairs: Array, near: float, distance: Array
) -> None:  # fmt: skip
    """Write the distances of some pairs, or lower bounds if they are not near, where the mechanism is placed."""
    place_bodies(m, shapes)
    chosen = shapes.others[:1]
    for i in range(len(pairs)):
        # the pair is then the chosen one
        distance[i] = distance_of(tables, shapes, pairs[i], near)
        if distance[i] > 0.0:
            continue
        # the normals of faces are more exact than those that were found
        total = write_contacts(
            shapes.places, tables, shapes.bound, shapes.flat, chosen, 0.0, shapes.distance, shapes.normal,
            shapes.middle, shapes.state, shapes.owner, shapes.gap, shapes.point, shapes.normals,
        )  # fmt: skip
        for j in range(total):
            distance[i] = shapes.gap[j] if j == 0 else min(distance[i], shapes.gap[j])


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
    tables, shapes
        What `ConstraintFamily.loop_tables` returns.

    Attributes
    ----------
    tables, shapes
        The same, the second as `held` returns it.
    known : ndarray of bool, shape (n,)
        Which pairs the kernels know.
    """

    def __init__(self, mechanism: Mechanism, tables: tuple[Array, ...], shapes: PairShapes) -> None:
        self._mechanism, self.tables = mechanism, tables
        self.known = (shapes.form == NONE) & (shapes.mode != LEFT_TO_PYTHON)
        self.shapes: PairShapes = held(shapes)

    def distances(self, q: Array, pairs: Array, near: float) -> Array:
        """Return the distances of some pairs at q; lower bounds of those that are not `near` [m]."""
        found = np.empty(len(pairs))
        distances_at(self._mechanism, self.tables, self.shapes, pairs, near, plain_array(q), found)
        return found
