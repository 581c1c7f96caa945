"""Rows of touching polyhedra and round shapes that keep their features, such as a vertex on a face.

The distance of two polyhedra has a gradient that jumps where the nearest features change. As long as they do not, it is
the distance of a vertex from the plane of a face, or of two lines: a smooth function of q.
"""

from __future__ import annotations

import numpy as np

from ...geometry.shapes.shape_table import ShapeTable
from ...geometry.shapes.shapes import PlacedShape
from ...system import System
from ..mechanism.held_rows import RowParts
from ..rows import Array
from .feature_kernels import (
    EDGES,
    FACE_VERTEX,
    LINE_VERTEX,
    POINTS,
    VERTEX_FACE,
    VERTEX_LINE,
    Surfaces,
    write_outside,
)
from .feature_motion import NOWHERE, Touching, places_of, row_biases, touching
from .normal_cones import bounding_directions
from .round_features import (
    CROSS,
    LEVEL,
    NEAR,
    SAME,
    Features,
    cross_of,
    edges_through,
    ends_of,
    features_of_capsules,
    features_of_round,
    is_round,
)

# lengths are relative to the bounding radius of the smaller shape
# points this little below the outermost one belong to its edge, if that one is not where the shapes touch
_WIDE = 1e-9
# vertices so far beside the other shape do not touch it
_OFF = 1e-13


def is_polyhedron(placed: PlacedShape) -> bool:
    """Return whether a shape is the convex hull of its support points."""
    points, half_axes, radius = placed.shape.support_points()
    return radius == 0.0 and len(points) > 3 and not half_axes.any()


def _faces(placed: PlacedShape) -> Array:
    """Return the faces of a polyhedron in its body's frame, outward unit normal and offset, shape (f, 4)."""
    # only pairs of polyhedra that touch need it, and its import is slow
    from scipy.spatial import ConvexHull

    points = placed.shape.support_points()[0] @ placed.rotation.T + placed.position
    planes = np.unique(ConvexHull(points).equations, axis=0)
    return planes * np.array([1.0, 1.0, 1.0, -1.0])


class FeatureRows:
    """Rows of pairs of polyhedra, of one with a round shape, and of two capsules; more are added as they touch.

    Each has the features that touched when it was found.

    Parameters
    ----------
    system : System
        What moves the bodies.
    """

    def __init__(self, system: System) -> None:
        self._system = system
        self._kind, self._bodies = np.zeros(0, np.int64), np.zeros((0, 2), np.int64)
        # of each row a point and a direction on either body, in the body's frame: of a vertex the point, of a face a
        # point and the normal from the first shape to the second, of an edge a point and its direction
        self._parts = np.zeros((0, 2, 2, 3))
        # of each row what surfaces lie outside its features, and where its contact point is on the polyhedron
        self._radius, self._shift = np.zeros(0), np.zeros(0)
        # faces of shapes in frames of bodies; where those of both shapes of each row begin and end, and of each shape
        self._planes, self._faces = np.zeros((0, 4)), np.zeros((0, 2, 2), np.int64)
        self._known: dict[int, tuple[int, int]] = {}
        # of each row both shapes, by their places in that
        self._shapes = np.zeros((0, 2), np.int64)
        # what bounds the normals of round shapes on vertices and edges; see `Surfaces`
        self._directions, self._bounds = np.zeros((0, 3)), np.zeros((0, 3), np.int64)
        self._last_key, self._last = b"", NOWHERE

    def add(
        self, table: ShapeTable, sides: Array, q: Array, point: Array, normal: Array, alone: bool = False
    ) -> int | None:
        """Add the row of two such shapes that touch at a point; return its number, or None where features are unclear.

        If `alone`, features are also unclear where they may share more than that point.

        Parameters
        ----------
        table, sides
            The shapes, and which two of them.
        q : ndarray, shape (nq,)
            Where they touch.
        point, normal : ndarray, shape (3,)
            In the world; the normal leads from the first shape to the second.
        """
        shapes = [table.placed[s] for s in sides.tolist()]
        bodies = np.array([shape.body for shape in shapes])
        for shape in shapes:
            if id(shape) not in self._known:
                planes = ends_of(shape) if is_round(shape) else _faces(shape)
                begin, self._planes = len(self._planes), np.vstack([self._planes, planes])
                self._known[id(shape)] = begin, len(self._planes)
        ranges = [self._known[id(shape)] for shape in shapes]
        faces = [self._planes[begin:end] for begin, end in ranges]
        places, bound = places_of(self._system, q, bodies), float(table.bound[sides].min())
        if all(map(is_round, shapes)):
            found = features_of_capsules(shapes, places, bound, point, normal, alone)
        else:
            features = features_of_round if any(map(is_round, shapes)) else _features
            found = features(shapes, faces, places, bound, point, normal, alone)
        if found is None:
            return None
        kind, parts, radius, shift = found
        # by their places in the list: balls have no faces that would tell them apart
        which = np.array([list(self._known).index(id(shape)) for shape in shapes])
        same = (self._kind == kind) & (self._shapes == which).all(axis=1)
        same &= (np.abs(self._parts - parts) <= SAME).all(axis=(1, 2, 3))
        if same.any():
            return int(same.argmax())
        self._kind, self._bodies = np.append(self._kind, kind), np.vstack([self._bodies, bodies])
        self._parts = np.concatenate([self._parts, parts[None]])
        self._radius, self._shift = np.append(self._radius, radius), np.append(self._shift, shift)
        self._faces = np.concatenate([self._faces, np.array([ranges])])
        self._shapes = np.vstack([self._shapes, which])
        side = int(is_round(shapes[0]))
        directions = np.zeros((0, 3))
        if not is_round(shapes[side]) and kind in (POINTS, LINE_VERTEX if side == 0 else VERTEX_LINE):
            # a ball, or the end of a capsule, on a vertex or an edge
            directions, _ = bounding_directions(parts[side], faces[side], bound)
        begin, self._directions = len(self._directions), np.vstack([self._directions, directions])
        self._bounds = np.vstack([self._bounds, [begin, len(self._directions), side]])
        return len(self._kind) - 1

    def shared(self, table: ShapeTable, sides: Array, q: Array, normal: Array) -> Array:
        """Return the corners of what the outermost faces or edges of two polyhedra share along a normal, shape (k, 3).

        The other arguments are those of `add`.
        """
        shapes = [table.placed[s] for s in sides.tolist()]
        if any(map(is_round, shapes)):
            return np.zeros((0, 3))
        bound, level = float(table.bound[sides].min()), []
        places = places_of(self._system, q, np.array([shape.body for shape in shapes]))
        for shape, place, sign in zip(shapes, places, (1.0, -1.0), strict=True):
            world = (shape.shape.support_points()[0] @ shape.rotation.T + shape.position) @ place[:3] + place[3]
            below = (sign * (world @ normal)).max() - sign * (world @ normal)
            least = LEVEL if np.count_nonzero(below <= LEVEL * bound) > 1 else _WIDE
            level.append(world[below <= least * bound])
        return _overlap(level[0], level[1], normal)

    def _at(self, q: Array, rows: Array) -> Touching:
        """Return where some rows touch; kept, because gradients and their change are wanted at the same place."""
        key = q.tobytes() + rows.tobytes()
        if key != self._last_key:
            self._last_key, self._last = key, touching(self._system, q, self.row_parts(rows))
        return self._last

    def outside(self, q: Array, rows: Array) -> Array:
        """Return how far the contact points of some rows are outside the shapes, beyond their gaps, shape (k,) [m]."""
        at, found = self._at(q, rows), np.empty(len(rows))
        point, surfaces = self._on_surfaces(at, rows), self.surfaces(rows)
        write_outside(at.kind, self._radius[rows], at.places, at.gap, point, at.normal, surfaces, found)
        return found

    def surfaces(self, rows: Array) -> Surfaces:
        """Return what the features of some rows are on."""
        return Surfaces(self._planes, self._faces[rows], self._directions, self._bounds[rows])

    def _on_surfaces(self, at: Touching, rows: Array) -> Array:
        """Return the contact points of some rows on the surfaces, shape (k, 3)."""
        return np.asarray(at.point + self._shift[rows, None] * at.normal)

    def row_gap(self, t: float, q: Array, rows: Array) -> Array:
        """Return the gaps of some rows, shape (k,) [m]."""
        return self._at(q, rows).gap

    row_lower_bound = row_gap

    def row_gradient(self, t: float, q: Array, rows: Array) -> Array:
        """Return the gradients of some rows, shape (k, nv)."""
        at = self._at(q, rows)
        first, second = np.ascontiguousarray(at.bodies.T)
        return self._system.separation_rows(q, first, second, at.point, at.normal)

    def row_bias(self, t: float, q: Array, v: Array, rows: Array) -> Array:
        """Return (dJ/dt) v of some rows where they touch, shape (k,)."""
        return row_biases(self._system, q, v, self._at(q, rows), self._radius[rows])

    def row_parts(self, rows: Array) -> RowParts:
        """Return what some rows are, for kernels."""
        return RowParts(self._kind[rows], self._bodies[rows], self._parts[rows], self._radius[rows], self._shift[rows])

    def row_points(self, t: float, q: Array, rows: Array) -> tuple[Array, Array]:
        """Return contact points and normals of some rows, shapes (k, 3)."""
        at = self._at(q, rows)
        return self._on_surfaces(at, rows), at.normal

    def bearing(self, t: float, q: Array, rows: Array) -> Array:
        """Return True for each row: of a face on a face few corners were found."""
        return np.ones(len(rows), bool)

    def check_rows(self, t: float, q: Array, rows: Array) -> None:
        """Do nothing: gradients of features are exact."""


def _overlap(first: Array, second: Array, normal: Array) -> Array:
    """Return the corners of what two flat convex polygons or segments share, shape (k, 3); none if one is a point."""
    if min(len(first), len(second)) < 2 or len(first) + len(second) < 5:
        return np.zeros((0, 3))
    fewer, more = (first, second) if len(first) <= len(second) else (second, first)
    points = list(_in_order(fewer, normal))
    corners = _in_order(more, normal)
    for corner, after in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        inward = np.cross(normal, after - corner)
        side, kept = [float((point - corner) @ inward) for point in points], []
        for k, point in enumerate(points):
            other = (k + 1) % len(points)
            if side[k] >= 0.0:
                kept.append(point)
            if side[k] * side[other] < 0.0:
                kept.append(point + side[k] / (side[k] - side[other]) * (points[other] - point))
        points = kept
    # a segment is followed to its end and back
    return np.unique(np.array(points).reshape(-1, 3), axis=0)


def _in_order(points: Array, normal: Array) -> Array:
    """Return the corners of a flat convex polygon in the order in which they turn about a normal."""
    across, _, _ = np.linalg.svd(normal[None].T)
    along = across[:, 1]
    beside = points - points.mean(axis=0)
    return points[np.argsort(np.arctan2(beside @ np.cross(normal, along), beside @ along))]


def _features(
    shapes: list[PlacedShape],
    faces: list[Array],
    places: Array,
    bound: float,
    point: Array,
    normal: Array,
    alone: bool,
) -> Features | None:
    """Return which features of two polyhedra touch at a point; see `FeatureRows`."""
    inside, level, near = [], [], []
    for shape, place, sign in zip(shapes, places, (1.0, -1.0), strict=True):
        own = shape.shape.support_points()[0] @ shape.rotation.T + shape.position
        world = own @ place[:3] + place[3]
        height = sign * (world @ normal)
        level.append(np.flatnonzero(height >= height.max() - LEVEL * bound))
        distance = np.linalg.norm(world[level[-1]] - point, axis=1)
        if len(distance) == 1 and distance[0] > NEAR * bound:
            # the place is on an edge or a face that is nearly level, of which this is the outermost end
            level[-1] = np.flatnonzero(height >= height.max() - _WIDE * bound)
            distance = np.linalg.norm(world[level[-1]] - point, axis=1)
        one = len(level[-1]) == 1
        near.append(level[-1][distance.argmin()] if one or distance.min() <= NEAR * bound else None)
        inside.append((own, world))
    (own_a, world_a), (own_b, world_b) = inside
    sizes, edges = [len(each) for each in level], None
    for side, vertex in enumerate(near):
        if vertex is not None and sizes[side] > 1:
            # a vertex that has slid off the other shape is no corner
            own = places[1 - side, :3] @ (inside[side][1][vertex] - places[1 - side, 3])
            off = float((faces[1 - side][:, :3] @ own - faces[1 - side][:, 3]).max())
            apart = abs(float((inside[side][1][vertex] - inside[1 - side][1][level[1 - side][0]]) @ normal))
            near[side] = None if off - apart > _OFF * bound else vertex
    a, b = near
    if alone and min(sizes) > 1 and sizes != [2, 2]:
        return None
    if sizes == [2, 2] or (a is None and b is None):
        edges = _crossing(world_a, world_b, level, point, normal, bound)
    nothing = np.zeros(3)
    if edges is not None:
        (i, j), (k, m) = edges
        d, e = (own_a[j] - own_a[i]) / np.linalg.norm(own_a[j] - own_a[i]), own_b[m] - own_b[k]
        return Features(EDGES, np.array([[own_a[i], d], [own_b[k], e / np.linalg.norm(e)]]))
    if alone and min(sizes) > 1:
        return None
    if a is not None and (b is None or sizes[1] > 2 or sizes[0] < 3):
        return Features(VERTEX_FACE, np.array([[own_a[a], nothing], [own_b[level[1][0]], places[1, :3] @ normal]]))
    if b is not None:
        return Features(FACE_VERTEX, np.array([[own_a[level[0][0]], places[0, :3] @ normal], [own_b[b], nothing]]))
    return None


def _crossing(
    first: Array, second: Array, level: list[Array], point: Array, normal: Array, bound: float
) -> tuple[tuple[int, int], tuple[int, int]] | None:
    """Return the ends of an edge of either shape that cross at a point, so ordered that their cross product is n."""
    for i, j in edges_through(first, level[0], point, normal, bound):
        for k, m in edges_through(second, level[1], point, normal, bound):
            d, e = first[j] - first[i], second[m] - second[k]
            turn = float(cross_of(d, e) @ normal)
            if abs(turn) > CROSS * np.linalg.norm(d) * np.linalg.norm(e):
                return (i, j), (k, m) if turn > 0.0 else (m, k)
    return None
