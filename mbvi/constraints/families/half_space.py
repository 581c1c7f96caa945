"""The family of shapes against half-spaces, by the points on which a shape can stand.

A polyhedron stands on its vertices, a capsule on its two end spheres, a cylinder on its rims. Each point is a row of
its own, whose gap and gradient are smooth functions of the configuration. On a rim or an ellipsoid the point is the
lowest one, which moves over the shape.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...compiled import kernel
from ...geometry.narrow.collinear import unique_kinds_along
from ...geometry.narrow.spread import FEW_POINTS
from ...geometry.narrow.support_points import Points, each_point_below, lowest, points_below, spread_below, stand
from ...geometry.shapes.flat_faces import ManyCorners
from ...geometry.shapes.hull_graph import no_graph, stack_graphs
from ...geometry.shapes.shape_table import indexed
from ...geometry.shapes.shapes import HalfSpace, PlacedShape, graph_of
from ...system import System
from ...system.mechanisms.separation import row
from ..features.feature_kernels import FACE_RIM
from ..features.feature_motion import row_biases, touching
from ..mechanism.held_rows import UNKNOWN, RowParts
from ..mechanism.point_parts import PointSelection
from ..row_table import RowTable
from ..rows import Rows
from .pairs import Array, Contacts, PairCandidates, Pairs

# sets of points that are kept gathered; beyond, all are gathered again
_MOST_SELECTIONS = 1000


@kernel("Tuple((i8, b1))(f8[:,:,::1], Tuple(Points), i8[::1], f8, f8[::1])")
def points_within(
    places: Array, table: tuple[Array, ...], pairs: Array, tolerance: float, clearance: Array
) -> tuple[int, bool]:
    """List the points of some pairs within a tolerance; of many on one shape those that `spread_below` keeps.

    Parameters
    ----------
    places : ndarray, shape (b, 4, 3)
        Placements of the bodies: columns of the rotation, then the origin.
    table : tuple
        The fields of `Points`; `found` receives the points.
    pairs : ndarray of int, shape (p,)
        The pairs, ascending.
    tolerance : float
        Gap at and below which a point is active [m].
    clearance : ndarray, shape (n,)
        Of all pairs; receives the least gap of each pair here.

    Returns
    -------
    count : int
        How many points there are.
    any_empty : bool
        Whether a pair has none.
    """
    p, count, any_empty = Points(*table), 0, False
    for i in range(len(pairs)):
        number, clearance[pairs[i]] = points_below(places, p, pairs[i], tolerance, count)
        any_empty = any_empty or number == 0
        count += spread_below(places, p, pairs[i], tolerance, count, number)
    return count, any_empty


@kernel("Tuple((i8, b1))(f8[:,:,::1], Tuple(Points), i8[::1], f8, f8[::1])")
def few_points_within(
    places: Array, table: tuple[Array, ...], pairs: Array, tolerance: float, clearance: Array
) -> tuple[int, bool]:
    """Do what `points_within` does where there is nothing to choose, with fewer kernels to compile.

    Returns a count of -1 if a shape has more than `FEW_POINTS` points within the tolerance.
    """
    p, count, any_empty = Points(*table), 0, False
    for i in range(len(pairs)):
        number, clearance[pairs[i]] = each_point_below(places, p, pairs[i], tolerance, count)
        if number > FEW_POINTS:
            return -1, False
        any_empty = any_empty or number == 0
        count += number
    return count, any_empty


@kernel(
    "Tuple((i8, b1, b1))(f8[:,:,::1], f8[:,::1], f8[:,::1], Tuple(Points), i8[::1], f8, f8[::1], i8[::1], i8[::1],"
    " f8[::1], f8[:,::1], f8[:,::1])"
)
def half_space_rows(
    poses: Array, columns: Array, support: Array, table: tuple[Array, ...], pairs: Array, tolerance: float,
    clearance: Array, index: Array, owner: Array, gap: Array, point: Array, rows: Array,
) -> tuple[int, bool, bool]:  # fmt: skip
    """Write gaps, points and gradients of the points within the tolerance, if they are the points of the last call.

    Parameters
    ----------
    poses, columns, support
        See `Kinematics`.
    table, pairs, tolerance, clearance
        See `points_within`.
    index, owner : ndarray of int, shape (c,)
        The points of the last call, and their pairs.
    gap, point, rows : ndarray, shapes (c,), (c, 3), (c, nv)
        Receive gaps, contact points and gradients.

    Returns
    -------
    count : int
        How many points are within the tolerance; `found` lists them.
    any_empty : bool
        Whether a pair has none.
    same : bool
        Whether they are the points of the last call; only then gap, point and rows are written.
    """
    p = Points(*table)
    count, any_empty = points_within(poses, table, pairs, tolerance, clearance)
    if count != len(index):
        return count, any_empty, False
    for i in range(count):
        if p.found[i] != index[i]:
            return count, any_empty, False
    for i in range(count):
        k, b = p.found[i], p.body[owner[i]]
        lowest(poses, b, p.numbers, k, p.out)
        point[i, 0], point[i, 1], point[i, 2], gap[i] = p.out[0], p.out[1], p.out[2], p.out[3]
        row(columns, support[0], support[b], p.out, p.numbers[k, 12:15], rows[i])
    return count, any_empty, True


class HalfSpaceContacts(Pairs):
    """Half-spaces of the world (first) against shapes of moving bodies (second).

    Parameters
    ----------
    system : System
        What moves the bodies.
    walls : sequence of HalfSpace
        The half-space of each pair.
    shapes : sequence of PlacedShape
        The shape of each pair.
    names : sequence of str
        The name of each pair.
    restitution
        As `Pairs`.
    lines : ndarray, shape (n, 3), optional
        In a planar scene the plane's normal in the frame of each shape's body; of points on one line along it only the
        first is kept.
    friction
        As `Pairs`.

    Attributes
    ----------
    collinear_points : int
        How many support points are left out for that reason.
    """

    def __init__(
        self,
        system: System,
        walls: Sequence[HalfSpace],
        shapes: Sequence[PlacedShape],
        names: Sequence[str],
        restitution: Array,
        lines: Array | None = None,
        friction: Array | float = 0.0,
    ) -> None:
        self.collinear_points = 0
        super().__init__(system, *indexed([None] * len(shapes), shapes), restitution, friction)
        self.names = tuple(names)
        # for a single mechanism `half_space_rows` computes gaps, points and gradients in one call
        self._one_mechanism = system.single_mechanism
        numbers, graphs, begin, many = [np.zeros((0, 17))], [], [0], ManyCorners()
        for pair, (wall, placed) in enumerate(zip(walls, shapes, strict=True)):
            centres, half_axes, radius = placed.shape.support_points()
            points = centres @ placed.rotation.T + placed.position
            # columns of rotation diag(half axes), one after the other
            axes = (placed.rotation * half_axes[:, None, :]).transpose(0, 2, 1).reshape(-1, 9)
            graph = graph_of(placed.shape, len(points))
            if lines is not None:
                # a rim stays beside fixed points on the line through its centre: while it is tilted they do not count
                kept = unique_kinds_along(points, np.asarray(half_axes.any(axis=1)), lines[pair])
                self.collinear_points += len(points) - len(kept)
                points, axes, graph = points[kept], axes[kept], no_graph(len(kept))
            rest = np.tile([*wall.normal, radius, wall.offset + radius], (len(points), 1))
            numbers.append(np.concatenate([points, axes, rest], axis=1))
            graphs.append(graph)
            many.add(placed, begin[-1], len(graph[1]) > 0)
            begin.append(begin[-1] + len(points))
        self._bodies, frame = np.unique(self._second_body, return_inverse=True)
        begin_of, count = np.array(begin, dtype=np.int64), begin[-1]
        self._table = Points(
            np.array(self._second_body if self._one_mechanism else frame, dtype=np.int64),
            begin_of,
            np.concatenate(numbers),
            *stack_graphs(graphs),
            np.array([s.shape.bound for s in shapes]),
            *many.stacked(),
            begin_of[:-1].copy(),
            np.empty(count + 1, np.int64),
            np.zeros(count, bool),
            np.empty(4),
        )
        self._plain_table = tuple(self._table)
        # whether no shape was ever near with many points, nor has so many that they are found by climbing
        self._few = not self._table.neighbour.size
        self.owner = np.repeat(np.arange(self.size), np.diff(begin_of))
        self._selections: dict[bytes, PointSelection] = {}
        # the points of the last rows
        self._last = self._select(np.zeros(0, np.int64))

    @property
    def points(self) -> Points:
        """The support points, as kernels take them."""
        return self._table

    def memory(self) -> tuple[Array, ...]:
        """Return the points at which climbs over hulls begin."""
        return (self._table.start,)

    def describe(self) -> str:
        """Return one line of `Problem.report()`, in words."""
        return f"{self.size} pair{'s' * (self.size != 1)} of a shape and a half-space"

    def _select(self, points: Array) -> PointSelection:
        """Return some points, gathered; they are kept, since a run has few different sets of points."""
        key = points.tobytes()
        found = self._selections.get(key)
        if found is None:
            if len(self._selections) >= _MOST_SELECTIONS:
                self._selections.clear()
            pair = self.owner[points]
            numbers, owners = self._table.numbers[points], np.array([self._table.body[pair], pair], dtype=np.int64)
            found = self._selections[key] = PointSelection(
                points,
                pair,
                self.restitution[pair],
                numbers,
                np.ascontiguousarray(numbers[:, 12:15]),
                owners.T.copy(),
                self._second_body[pair],
            )
        return found

    def _placements(self, q: Array) -> Array:
        """Return where the bodies are; for a single mechanism its kinematics holds the poses of all bodies."""
        return self.system.kinematics(q).poses if self._one_mechanism else self.system.placements(q, self._bodies)

    def row_table(self, t: float, q: Array) -> RowTable:
        """Return the table of the rows: one for each point that a shape can stand on."""
        pair = self.owner
        smooth = np.ones(len(pair), bool)
        return RowTable(pair, self.restitution[pair], smooth, self.reach()[pair], self.thickness[pair])

    def _row_contacts(self, q: Array, points: Array) -> Contacts:
        """Return the contacts of some rows of `row_table`, which are points in ascending order."""
        return self._point_contacts(q, self._select(points))

    def measure(self, q: Array, pairs: Array, tolerance: float) -> Contacts:
        wanted = np.bincount(pairs, minlength=self.size) > 0
        return self._point_contacts(q, self._select(wanted[self.owner].nonzero()[0]))

    def row_bias(self, t: float, q: Array, v: Array, points: Array) -> Array:
        """Return (dJ/dt) v of some points; NaN for those that move along their bodies on ellipsoids."""
        numbers, parts = self._table.numbers[points], self.row_parts(points)
        moved = self.system.point_bias(q, v, self._second_body[self.owner[points]], numbers[:, :3].copy())
        bias = np.where(parts.kind == UNKNOWN, np.nan, np.vecdot(moved, numbers[:, 12:15]))
        if (rims := parts.kind == FACE_RIM).any():
            own = RowParts(*(column[rims] for column in parts))
            bias[rims] = row_biases(self.system, q, v, touching(self.system, q, own), own.radius)
        return bias

    def row_parts(self, rows: Array) -> RowParts:
        """Return what some points are, for kernels; see `parts_of_points`."""
        return self._select(rows).parts

    def bearing(self, t: float, q: Array, points: Array) -> Array:
        """Return which of some points that touch `spread_below` keeps, shape (k,) of bool."""
        owner, kept, places = self.owner[points], np.ones(len(points), bool), self._placements(q)
        for pair in np.flatnonzero(np.bincount(owner) > FEW_POINTS).tolist():
            own = np.flatnonzero(owner == pair)
            self._table.found[: len(own)] = points[own]
            # none of them is above the half-space
            count = spread_below(places, self._table, pair, 0.0, 0, len(own))
            kept[own] = np.isin(points[own], self._table.found[:count])
        return kept

    def _point_contacts(self, q: Array, selection: PointSelection, places: Array | None = None) -> Contacts:
        """Return a contact for each point of a selection, whatever its gap."""
        gap, point = np.empty(len(selection.pair)), np.empty((len(selection.pair), 3))
        stand(self._placements(q) if places is None else places, selection.owners, selection.numbers, gap, point)
        return Contacts(selection.pair, gap, point, selection.up)

    def _near(self, q: Array, pairs: Array, tolerance: float, clearance: Array) -> tuple[Contacts | None, bool]:
        places = self._placements(q)
        count, any_empty = self._points_within(places, pairs, tolerance, clearance)
        if not count:
            return None, any_empty
        return self._point_contacts(q, self._select(self._table.found[:count].copy()), places), any_empty

    def _points_within(self, places: Array, pairs: Array, tolerance: float, clearance: Array) -> tuple[int, bool]:
        if self._few:
            count, any_empty = few_points_within(places, self._plain_table, pairs, tolerance, clearance)
            if count >= 0:
                return count, any_empty
            self._few = False
        return points_within(places, self._plain_table, pairs, tolerance, clearance)

    def _rows(self, q: Array, pairs: Array, tolerance: float, candidates: PairCandidates) -> Rows | None:
        if not self._one_mechanism:
            return super()._rows(q, pairs, tolerance, candidates)
        kinematics, found = self.system.kinematics(q), self._table.found
        # if other points than at the last call are within the tolerance, the kernel is called again with room for them
        while True:
            last = self._last
            size = len(last.pair)
            gap, point, rows = np.empty(size), np.empty((size, 3)), np.empty((size, self.system.nv))
            count, any_empty, same = half_space_rows(
                *kinematics, self._plain_table, pairs, tolerance, candidates.clearance, last.points, last.pair, gap,
                point, rows,
            )  # fmt: skip
            if same:
                candidates.any_empty = any_empty
                return Rows(last.pair, gap, rows, last.restitution, point, last.up) if count else None
            self._last = self._select(found[:count].copy())
