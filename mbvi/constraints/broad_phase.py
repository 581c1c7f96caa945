"""The family of many shapes against each other: only pairs of a Verlet list have their distance computed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from scipy.sparse import csr_array, vstack

from ..geometry.shapes import Box, PlacedShape, length_unit
from ..geometry.sweep import may_pass
from ..geometry.verlet_list import VerletList
from ..system import System
from ..system.sparse_rows import dense
from .family import ConstraintFamily
from .pairs import Contacts
from .rebuilt import Rebuilt
from .rows import Array, Rows
from .signed_distance import SignedDistances


class BroadPhasePairs(Rebuilt, ConstraintFamily):
    """Every pair of shapes on different bodies, except those that `left_out` names.

    Parameters
    ----------
    system : System
        What moves the bodies.
    shapes : sequence of PlacedShape
        The shapes; constraints are numbered by their places in this list.
    left_out : callable
        left_out(i, j) -> ndarray of bool: which pairs of shapes, i < j, are left out.
    restitution_of : callable
        restitution_of(a, b) -> e of two shapes by name.
    line, at_rest
        As `SignedDistances`.

    Notes
    -----
    Constraint i n + j is the pair of shapes i < j of n shapes. A pair is listed if its bounding spheres are near each
    other. If one shape is a box of the world, the box itself must be near the bounding sphere of the other. A list is
    valid until two shapes can have come nearer to each other by the skin of the `VerletList`.
    """

    smooth = False
    # EventDriven needs all rows in advance; here pairs are listed only when near
    tracked = False
    skips_resting = True

    def __init__(
        self,
        system: System,
        shapes: Sequence[PlacedShape],
        left_out: Callable[[Array, Array], Array],
        restitution_of: Callable[[str, str], float],
        line: Array | None = None,
        at_rest: bool = True,
    ) -> None:
        self.system, self._line, self._at_rest = system, line, at_rest
        self._shapes, self._left_out, self._restitution_of = tuple(shapes), left_out, restitution_of
        self._body = np.array([s.body for s in shapes], dtype=np.int64)
        self._moving = np.unique(self._body[self._body > 0])
        self._frame = np.searchsorted(self._moving, self._body)
        self._bound = np.array([s.shape.bound for s in shapes])
        self._turn = np.array([s.rotation for s in shapes])
        self._position = np.array([s.position for s in shapes])
        # half edges of boxes of the world; other boxes may turn while a list is valid, so that only their spheres count
        self._half = np.array(
            [np.array(s.shape.size) / 2 if isinstance(s.shape, Box) and not s.body else [np.inf] * 3 for s in shapes]
        )
        self._neighbours = VerletList(self._bound)
        # Coal's hulls are expensive to build: one for each shape serves all lists
        self._geometries: dict[Any, Any] = {}
        self._unit = length_unit(self._bound.tolist())
        self._inner = np.array([s.shape.inner for s in shapes])
        # computed when first needed
        self._reach: csr_array | None = None
        self._listed: _ListedPairs | None = None
        self._queried: tuple[bytes, _ListedPairs] | None = None
        self._list_count = -1
        self._resting: Array | None = None
        self.size = len(self._shapes) ** 2
        # e is looked up when a pair is listed
        self.restitution = np.zeros(0)

    def name(self, constraint: int) -> str:
        """Return the name of one pair."""
        i, j = divmod(constraint, len(self._shapes))
        return f"{self._shapes[i].name} | {self._shapes[j].name}"

    def describe(self) -> str:
        """Return one line of `Problem.report()`, in words."""
        return f"pairs of {len(self._shapes)} shapes, found when near"

    def _places(self, q: Array) -> tuple[Array, Array]:
        """Return rotations, shape (n, 3, 3), and centres, shape (n, 3), of all shapes in the world."""
        turns, centres = self._turn.copy(), self._position.copy()
        on = self._body > 0
        places = self.system.placements(q, self._moving)[self._frame[on]]
        turn = places[:, :3].transpose(0, 2, 1)
        turns[on] = turn @ turns[on]
        centres[on] = (turn @ centres[on][:, :, None])[:, :, 0] + places[:, 3]
        return turns, centres

    def contacts(self, t: float, q: Array, tolerance: float) -> Rows | None:
        """Return the rows within the tolerance, or None."""
        turns, centres = self._places(q)
        pairs = self._neighbours.within(centres, max(tolerance, 0.0))
        if self._listed is None or self._list_count != self._neighbours.lists:
            self._list_count = self._neighbours.lists
            self._listed = self._list_near(*np.divmod(pairs, len(self._shapes)), turns, centres)
            self._listed.skip_resting(self._resting)
        return self._listed.contacts(t, q, tolerance)

    def skip_resting(self, resting: Array | None) -> None:
        """Leave out the pairs of bodies that are both at rest; see the base class."""
        self._resting = resting
        if self._listed is not None:
            self._listed.skip_resting(resting)

    def _list_near(self, i: Array, j: Array, turns: Array, centres: Array) -> _ListedPairs:
        """Return those of the pairs (i, j) whose shapes can touch before they have moved by the skin."""
        kept, far = (self._body[i] != self._body[j]) & ~self._left_out(i, j), self._neighbours.reach
        for a, b in ((i, j), (j, i)):
            # the centre of the other's bounding sphere in the axes of the box, beyond its faces
            outside = np.abs(np.vecmat(centres[b] - centres[a], turns[a])) - self._half[a]
            kept &= np.linalg.norm(np.maximum(outside, 0.0), axis=1) <= self._bound[b] + far
        return self._pairs_of(i[kept], j[kept])

    def _pairs_of(self, i: Array, j: Array) -> _ListedPairs:
        """Return the family of the given pairs of shapes."""
        first, second = [self._shapes[k] for k in i.tolist()], [self._shapes[k] for k in j.tolist()]
        e = np.array([self._restitution_of(a.name, b.name) for a, b in zip(first, second, strict=True)])
        return _ListedPairs(
            self.system,
            first,
            second,
            i * len(self._shapes) + j,
            e,
            self._geometries,
            self._line,
            self._at_rest,
            self._unit,
        )

    def passable(self, q: Array, displacement: Array) -> tuple[Array, Array, Array]:
        """Return the pairs that may pass through each other, their travel and their thickness; see the base class."""
        centres = self._places(q)[1]
        moved = self._places(self.system.integrate(q, displacement))[1] - centres
        travel = self._reaches() @ np.abs(displacement)
        i, j = may_pass(centres, moved, travel, self._bound, self._inner)
        kept = (self._body[i] != self._body[j]) & ~self._left_out(i, j)
        i, j = i[kept], j[kept]
        return i * len(self._shapes) + j, travel[i] + travel[j], self._inner[i] + self._inner[j]

    def least_displacement(self) -> float:
        """Return the largest entry of a tangent vector up to which no shape travels its thickness."""
        carried = self._reaches().sum(axis=1)
        return float((self._inner[carried > 0.0] / carried[carried > 0.0]).min(initial=np.inf))

    def _reaches(self) -> csr_array:
        """Return how far each velocity can carry a point of each shape, shape (n, nv)."""
        if self._reach is None:
            nothing = csr_array((1, self.system.nv))
            self._reach = vstack([
                csr_array(self.system.reach(s.body, s.position, s.shape.bound)[None]) if s.body else nothing
                for s in self._shapes
            ], format="csr")  # fmt: skip
        return self._reach

    def pair_gap(self, t: float, q: Array, pairs: Array) -> Array:
        """Return the signed distances of some pairs, shape (k,) [m]."""
        if self._queried is None or self._queried[0] != pairs.tobytes():
            self._queried = pairs.tobytes(), self._pairs_of(*np.divmod(pairs, len(self._shapes)))
        return self._queried[1].nearest(q, np.arange(len(pairs))).gap

    def nearest_points(self, q: Array) -> tuple[Array, Array]:
        """Return point and normal of the nearest contact of each pair that is not left out, in the order of `gap`."""
        contacts = self._nearest_of_all(q)[0]
        return contacts.point, contacts.normal

    def gap(self, t: float, q: Array) -> Array:
        """Return the signed distance of every pair that is not left out, shape (m,) [m]."""
        return self._nearest_of_all(q)[0].gap

    def gradient(self, t: float, q: Array) -> Array:
        """Return the gradient of every pair's distance, shape (m, nv)."""
        contacts, listed = self._nearest_of_all(q)
        return dense(listed._gradients(q, contacts))

    def _nearest_of_all(self, q: Array) -> tuple[Contacts, _ListedPairs]:
        """Return the nearest contact of every pair that is not left out, and the family of these pairs."""
        i, j = np.triu_indices(len(self._shapes), 1)
        kept = (self._body[i] != self._body[j]) & ~self._left_out(i, j)
        listed = self._pairs_of(i[kept], j[kept])
        return listed.nearest(q, np.arange(len(listed.names))), listed


class _ListedPairs(SignedDistances):
    """The pairs of one Verlet list, all of which are measured at every query.

    They have no clearances: the list itself leaves out the pairs that are far apart, and it is short-lived.
    """

    def __init__(
        self,
        system: System,
        first: Sequence[PlacedShape],
        second: Sequence[PlacedShape],
        numbers: Array,
        restitution: Array,
        geometries: dict[Any, Any],
        line: Array | None,
        at_rest: bool,
        unit: float,
    ) -> None:
        self._numbers = numbers
        names = [f"{a.name} | {b.name}" for a, b in zip(first, second, strict=True)]
        super().__init__(system, first, second, names, restitution, line, at_rest, unit, geometries)

    def _set_reach(self, first: Sequence[PlacedShape | None], second: Sequence[PlacedShape]) -> None:
        """Set no bounds: without clearances they are not read."""

    def _constants_of(self, pair: Array) -> tuple[Array, Array, Array, Array]:
        return self._numbers[pair], self._first_body[pair], self._second_body[pair], self.restitution[pair]
