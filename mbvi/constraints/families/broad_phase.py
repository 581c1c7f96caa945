"""The family of many shapes against each other: only pairs of a Verlet list have their distance computed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...geometry.broad.near_boxes import near_boxes, place_shapes
from ...geometry.broad.sweep import may_pass
from ...geometry.broad.verlet_list import VerletList
from ...geometry.shapes.shape_table import ShapeTable
from ...system import System
from ...system.free.sparse_rows import dense
from ..family import ConstraintFamily
from ..rebuilt import Rebuilt
from ..relative_ways import PairBalls, balls_of_sides, relative_ways, shared_lengths, ways_of
from ..rows import Array, Rows
from .pairs import Contacts, relative_reaches, sparse_reaches
from .signed_distance import SignedDistances

# shapes that are larger than the median by this factor may turn while a list is valid
_LARGE = 4.0


class BroadPhasePairs(Rebuilt, ConstraintFamily):
    """Every pair of shapes on different bodies, except those that `left_out` names.

    Parameters
    ----------
    system : System
        What moves the bodies.
    table : ShapeTable
        The shapes; constraints are numbered by their places in it.
    left_out : callable
        left_out(i, j) -> ndarray of bool: which pairs of shapes, i < j, are left out.
    restitution_of : callable
        restitution_of(i, j) -> ndarray: e of pairs of shapes, i < j.
    line, at_rest
        As `SignedDistances`.
    friction_of : callable, optional
        friction_of(i, j) -> ndarray: coefficients of friction of pairs of shapes, i < j; no friction by default.
    most_friction : float
        The largest of them.

    Notes
    -----
    Constraint i n + j is the pair of shapes i < j of n shapes. A pair is listed if its bounding spheres are near each
    other, and its bounding boxes too, which turn with the bodies unless these are large. A list is valid until two
    shapes can have come nearer to each other by the skin of the `VerletList`.
    """

    smooth = False
    # EventDriven needs all rows in advance; here pairs are listed only when near
    tracked = False
    skips_resting = True
    isotropic = True

    def __init__(
        self,
        system: System,
        table: ShapeTable,
        left_out: Callable[[Array, Array], Array],
        restitution_of: Callable[[Array, Array], Array],
        line: Array | None = None,
        at_rest: bool = True,
        friction_of: Callable[[Array, Array], Array] | None = None,
        most_friction: float = 0.0,
    ) -> None:
        self.system, self._line, self._at_rest = system, line, at_rest
        self._shapes, self._left_out, self._restitution_of = table, left_out, restitution_of
        # large bodies among small ones would end a list as soon as they turn a little: of these only spheres count
        turning = (table.body == 0) | (table.bound <= _LARGE * np.median(table.bound))
        middle, half = table.boxes
        self._boxes = turning[:, None] * middle, np.where(turning[:, None], half, table.bound[:, None])
        self._neighbours = VerletList(table.bound, turning * table.bound)
        # computed when first needed
        self._reach: Array | None = None
        self._listed = self._pairs_of(np.zeros(0, np.int64))
        self._queried: tuple[bytes, SignedDistances] | None = None
        self._list_count = -1
        self._resting: Array | None = None
        self.size = len(table) ** 2
        # e is looked up when a pair is listed
        self.restitution = np.zeros(0)
        self._friction_of, self.friction = friction_of, most_friction

    def friction_of(self, numbers: Array) -> Array:
        """Return the coefficients of friction of some pairs, shape (k,)."""
        if self._friction_of is None:
            return np.zeros(len(numbers))
        return self._friction_of(*np.divmod(numbers, len(self._shapes)))

    def bodies_of(self, numbers: Array) -> tuple[Array, Array]:
        """Return the first and the second body of some pairs, shapes (k,)."""
        i, j = np.divmod(numbers, len(self._shapes))
        return self._shapes.body[i], self._shapes.body[j]

    @property
    def count(self) -> int:
        """How many pairs of shapes on different bodies there are, with those that are left out."""
        n, each = len(self._shapes), np.bincount(self._shapes.body)
        return int(n * (n - 1) - (each * (each - 1)).sum()) // 2

    def name(self, constraint: int) -> str:
        """Return the name of one pair."""
        return self._shapes.name(*divmod(constraint, len(self._shapes)))

    def describe(self) -> str:
        """Return one line of `Problem.report()`, in words."""
        paths = f": {self._listed.describe_paths()}" if self._listed.size else ""
        return f"pairs of {len(self._shapes)} shapes, found when near; {self._listed.size} are near now{paths}"

    def _places(self, placements: Array) -> Array:
        """Return where all shapes are in the world, shape (n, 4, 3), given the placements of their bodies."""
        table = self._shapes
        places = np.empty((len(table), 4, 3))
        place_shapes(placements, table.frame, table.arrays[1], places)
        return places

    def contacts(self, t: float, q: Array, tolerance: float) -> Rows | None:
        """Return the rows within the tolerance, or None."""
        placements = self.system.placements(q, self._shapes.bodies)
        places = self._places(placements)
        pairs = self._neighbours.within(places[:, 3], max(tolerance, 0.0), places[:, :3])
        if self._list_count != self._neighbours.lists:
            self._list_count, last = self._neighbours.lists, self._listed
            near = np.empty(len(pairs), np.int64)
            # if two shapes can touch before they have moved by the skin
            count = near_boxes(places, *self._boxes, pairs, self._neighbours.reach, near)
            self._listed = self._pairs_of(self._allowed(near[:count]))
            self._listed.keep_axes_of(last)
            self._listed.skip_resting(self._resting)
        return self._listed.contacts_of_placed(q, placements, tolerance)

    def skip_resting(self, resting: Array | None) -> None:
        """Leave out the pairs of bodies that are both at rest; see the base class."""
        self._resting = resting
        self._listed.skip_resting(resting)

    def _allowed(self, pairs: Array) -> Array:
        """Return those of the pairs that are on different bodies and not left out."""
        i, j = np.divmod(pairs, len(self._shapes))
        return pairs[(self._shapes.body[i] != self._shapes.body[j]) & ~self._left_out(i, j)]

    def _pairs_of(self, pairs: Array) -> SignedDistances:
        """Return the family of the given pairs of shapes."""
        i, j = np.divmod(pairs, len(self._shapes))
        e, sides = self._restitution_of(i, j), np.stack([i, j], axis=1)
        return SignedDistances(self.system, self._shapes, sides, e, self._line, self._at_rest, pairs)

    def passable(self, q: Array, displacement: Array) -> tuple[Array, Array, Array]:
        """Return the pairs that may pass through each other, their travel and their thickness; see the base class."""
        inner, travel = self._shapes.inner, self._reaches() @ shared_lengths(self.system, displacement)
        if not (travel > inner).any():
            return np.zeros(0, np.int64), np.zeros(0), np.zeros(0)
        both = (self.system.placements(at, self._shapes.bodies) for at in (q, self.system.integrate(q, displacement)))
        centres, ends = (self._places(placements)[:, 3] for placements in both)
        i, j = may_pass(centres, ends - centres, travel, self._shapes.bound, inner)
        pairs = self._allowed(i * len(inner) + j)
        sides = self._sides_of(pairs)
        ways = ways_of(self.system, displacement, relative_reaches(self._reaches(), sides))
        travel = relative_ways(self.system, q, displacement, ways, balls_of_sides(self._shapes, sides))
        thickness = inner[sides].sum(axis=1)
        passing = travel > thickness
        return pairs[passing], travel[passing], thickness[passing]

    def least_displacement(self) -> float:
        """Return the largest entry of a tangent vector up to which no shape travels its thickness."""
        carried, inner = self._reaches().sum(axis=1), self._shapes.inner
        return float((inner[carried > 0.0] / carried[carried > 0.0]).min(initial=np.inf))

    def bending_envelope(self) -> Array:
        """Return the largest reach of any shape, shape (nv,)."""
        return np.asarray(self._reaches().max(axis=0).toarray()).ravel()

    def _reaches(self) -> Array:
        """Return how far each velocity can carry a point of each shape, sparse, shape (n, nv)."""
        if self._reach is None:
            self._reach = sparse_reaches(self.system, self._shapes)[:-1]
        return self._reach

    def nearest_of(self, t: float, q: Array, pairs: Array) -> tuple[Array, Array]:
        """Return the signed distances and normals of some pairs, shapes (k,) [m] and (k, 3)."""
        if self._queried is None or self._queried[0] != pairs.tobytes():
            self._queried = pairs.tobytes(), self._pairs_of(pairs)
        return self._queried[1].nearest_of(t, q, np.arange(len(pairs)))

    def balls_of(self, numbers: Array) -> PairBalls:
        """Return balls that hold the shapes of some pairs."""
        return balls_of_sides(self._shapes, self._sides_of(numbers))

    def reach_of(self, numbers: Array) -> Array:
        """Return the reach of some pairs, shape (k, nv)."""
        return np.asarray(relative_reaches(self._reaches(), self._sides_of(numbers)).T.toarray())

    def _sides_of(self, numbers: Array) -> Array:
        """Return the two shapes of some pairs, shape (k, 2)."""
        return np.stack(np.divmod(numbers, len(self._shapes)), axis=1)

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

    def _nearest_of_all(self, q: Array) -> tuple[Contacts, SignedDistances]:
        """Return the nearest contact of every pair that is not left out, and the family of these pairs."""
        i, j = np.triu_indices(len(self._shapes), 1)
        listed = self._pairs_of(self._allowed(i * len(self._shapes) + j))
        return listed.nearest(q, np.arange(listed.size)), listed
