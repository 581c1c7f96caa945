"""Which features of a polyhedron and a round shape, or of two capsules, touch."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...geometry.shapes.shapes import Capsule, Cylinder, PlacedShape, Sphere
from ..rows import Array
from .feature_kernels import EDGES, FACE_RIM, FACE_VERTEX, LINE_VERTEX, POINTS, RIM_FACE, VERTEX_FACE, VERTEX_LINE
from .normal_cones import nearest_feature

# lengths are relative to the bounding radius of the smaller shape
# points this little below the outermost one belong to its face or edge; corners of a region that two faces share are so
# near to vertices and edges
LEVEL, NEAR = 1e-11, 1e-6
# parts of features so near to others are the same
SAME = 1e-8
# sine of the angle of two edges above which they cross
CROSS = 1e-6
# sine of the angle between an axis and a direction along which it counts as parallel or at right angles; and one less
# the cosine of the angle between normals of the same face
_STRAIGHT, _SAME_FACE = 1e-7, 1e-9


class Features(NamedTuple):
    """Features that touch.

    Attributes
    ----------
    kind : int
        Which features.
    parts : ndarray, shape (2, 2, 3)
        See `FeatureRows`.
    radius : float
        See `touch`.
    shift : float
        How far along the normal the contact point on the surface of the polyhedron lies from that of `touch` [m].
    """

    kind: int
    parts: Array
    radius: float = 0.0
    shift: float = 0.0


def is_round(placed: PlacedShape) -> bool:
    """Return whether a shape is a ball, a capsule or a cylinder."""
    return isinstance(placed.shape, Sphere | Capsule | Cylinder)


def ends_of(placed: PlacedShape) -> Array:
    """Return the planes at both ends of the axis of a round shape, shape (2, 4); a ball has none. See `Surfaces`."""
    if isinstance(placed.shape, Sphere):
        return np.zeros((0, 4))
    assert isinstance(placed.shape, Capsule | Cylinder)
    axis, half = placed.rotation[:, 2], 0.5 * placed.shape.length
    along = float(axis @ placed.position)
    return np.array([[*axis, half + along], [*-axis, half - along]])


class _Polyhedron:
    """The vertex, the edge or the face of a polyhedron that a contact point is on, in the frame of its body.

    Parameters
    ----------
    placed, planes, place
        The shape, its faces, and the placement of its body.
    bound : float
        Lengths are relative to this one [m].
    point, towards : ndarray, shape (3,)
        The contact point, and the direction from the other shape to this one.
    """

    def __init__(
        self, placed: PlacedShape, planes: Array, place: Array, bound: float, point: Array, towards: Array
    ) -> None:
        own = placed.shape.support_points()[0] @ placed.rotation.T + placed.position
        self.planes, self.place, self.bound = planes, place, bound
        world = own @ place[:3] + place[3]
        height = world @ towards
        level = np.flatnonzero(height <= height.min() + LEVEL * bound)
        # the outermost points, in the world
        self.level = world[level]
        nearest = level[np.linalg.norm(world[level] - point, axis=1).argmin()]
        self.vertex: Array | None = None
        self.edge: tuple[Array, Array] | None = None
        self.face: Array | None = None
        if len(level) == 1 or np.linalg.norm(world[nearest] - point) <= NEAR * bound:
            self.vertex = own[nearest]
            return
        if len(level) > 2:
            normal = planes[:, :3] @ (place[:3] @ -towards)
            if normal.max() >= 1.0 - _SAME_FACE:
                self.face = planes[normal.argmax()]
        for i, j in edges_through(world, level, point, towards, bound)[:1] if len(level) > 1 else ():
            d = own[j] - own[i]
            self.edge = own[i], d / np.linalg.norm(d)


def cross_of(a: Array, b: Array) -> Array:
    """Return the cross product of two vectors, shape (3,); NumPy's function takes twenty times as long."""
    (x, y, z), (u, v, w) = a.tolist(), b.tolist()
    return np.array([y * w - z * v, z * u - x * w, x * v - y * u])


def edges_through(points: Array, level: Array, place: Array, normal: Array, bound: float) -> list[tuple[int, int]]:
    """Return the ends of the edges of a flat convex polygon, of some points, that pass through a place."""
    found, own = [], points[level] - place
    for i in range(len(level)):
        for j in range(i + 1, len(level)):
            d = own[j] - own[i]
            size = float(np.linalg.norm(d))
            # the place is on the segment, and all other points are on one side of it
            side = cross_of(normal, d / max(size, SAME * bound)) @ own.T
            one_side = side.max() <= NEAR * bound or side.min() >= -NEAR * bound
            slack = NEAR * bound * size
            on = abs(side[i]) <= NEAR * bound and own[i] @ d <= slack and own[j] @ d >= -slack
            if size > SAME * bound and (len(level) == 2 or (on and one_side)):
                found.append((int(level[i]), int(level[j])))
    return found


def features_of_round(
    shapes: list[PlacedShape], planes: list[Array], places: Array, bound: float, point: Array, normal: Array,
    alone: bool,
) -> Features | None:  # fmt: skip
    """Return which features of two shapes touch, of which one is a polyhedron and one round.

    None where that is unclear: where a rim touches an edge or a vertex, or, if they are to touch `alone`, where they
    may share more than the point.
    """
    k = int(is_round(shapes[1]))
    placed, place, towards = shapes[k], places[k], normal if k == 0 else -normal
    shape = placed.shape
    other = _Polyhedron(shapes[1 - k], planes[1 - k], places[1 - k], bound, point, towards)
    if isinstance(shape, Sphere):
        return _at_end(shape.radius, placed.position, place, other, k)
    assert isinstance(shape, Capsule | Cylinder)
    axis, centre, half = placed.rotation[:, 2], placed.position, 0.5 * shape.length
    straight = float(axis @ (place[:3] @ towards))
    along = float((place[:3] @ (point - place[3]) - centre) @ axis)
    at_end = abs(along) >= half - NEAR * bound
    end = centre + np.copysign(half, along if abs(straight) <= _STRAIGHT else straight) * axis
    if isinstance(shape, Cylinder) and abs(straight) > _STRAIGHT:
        if abs(straight) >= 1.0 - _STRAIGHT**2:
            unclear = alone and other.vertex is None
            return None if unclear else _on_cap(shape.radius, placed, place, end, bound, point, other, k)
        return _on_rim(shape.radius, axis, end, other, k)
    if abs(straight) <= _STRAIGHT:
        # of a face, or an edge along the axis, more than one point touches
        d = other.level[-1] - other.level[0]
        along_axis = np.linalg.norm(np.cross(d, axis @ place[:3])) <= CROSS * np.linalg.norm(d)
        if alone and len(other.level) > 1 and (len(other.level) > 2 or along_axis):
            return None
        if isinstance(shape, Cylinder) and at_end and not (along_axis and len(other.level) == 2):
            return _on_rim(shape.radius, axis, end, other, k)
        if isinstance(shape, Cylinder) or not at_end:
            return _on_side(shape.radius, axis, centre, point, normal, places, other, k)
    return _at_end(shape.radius, end, place, other, k)


def features_of_capsules(
    shapes: list[PlacedShape], places: Array, bound: float, point: Array, normal: Array, alone: bool
) -> Features | None:  # fmt: skip
    """Return which features of two capsules touch.

    None if they are to touch `alone` and lie along each other.
    """
    capsules = [placed.shape for placed in shapes]
    first, second = capsules
    assert isinstance(first, Capsule) and isinstance(second, Capsule)
    axes = [placed.rotation[:, 2] @ place[:3] for placed, place in zip(shapes, places, strict=True)]
    centres = [placed.position @ place[:3] + place[3] for placed, place in zip(shapes, places, strict=True)]
    halves = 0.5 * np.array([first.length, second.length])
    along = np.array([float((point - centre) @ axis) for centre, axis in zip(centres, axes, strict=True)])
    beside = np.abs(along) - halves
    at_end = beside >= -NEAR * bound
    if np.linalg.norm(np.cross(*axes)) <= CROSS and not at_end.all():
        # they touch along a line, of which the ends count
        if alone:
            return None
        at_end = np.arange(2) == beside.argmax()
    lines = [np.array([placed.position, placed.rotation[:, 2]]) for placed in shapes]
    ends = [
        np.array([placed.position + np.copysign(half, x) * placed.rotation[:, 2], np.zeros(3)])
        for placed, half, x in zip(shapes, halves, along, strict=True)
    ]
    parts = np.array([ends[k] if at_end[k] else lines[k] for k in range(2)])
    kind = (EDGES, LINE_VERTEX, VERTEX_LINE, POINTS)[2 * int(at_end[0]) + int(at_end[1])]
    if kind == EDGES:
        # the cross product of both leads from the first shape to the second
        parts[1, 1] *= np.sign(np.cross(*axes) @ normal)
    return Features(kind, parts, first.radius + second.radius, -second.radius if kind == LINE_VERTEX else first.radius)


def _ordered(k: int, kinds: tuple[int, int], of_round: Array, of_other: Array, radius: float, shift: float) -> Features:
    """Return features, those of the round shape at place k; `kinds` are those with it as the first and the second."""
    parts = np.array([of_round, of_other] if k == 0 else [of_other, of_round])
    return Features(kinds[k], parts, radius, shift)


def _face(other: _Polyhedron, k: int) -> Array:
    """Return a point of its face and the normal from the first shape to the second."""
    assert other.face is not None
    return _sides_of(other.face, k)


def _sides_of(face: Array, k: int) -> Array:
    """Return a point of a face, shape (4,), and the normal from the first shape to the second."""
    return np.array([face[:3] * face[3], -face[:3] if k == 0 else face[:3]])


def _at_end(radius: float, end: Array, place: Array, other: _Polyhedron, k: int) -> Features | None:
    """Return the features where the end of a capsule, or a ball, touches; its body is at `place`."""
    own, shift, face = np.array([end, np.zeros(3)]), radius if k == 0 else -radius, other.face
    if other.vertex is not None or other.edge is not None:
        part = np.array(other.edge if other.vertex is None else [other.vertex, np.zeros(3)])
        centre = other.place[:3] @ (end @ place[:3] + place[3] - other.place[3])
        part, face = nearest_feature(part, other.planes, other.bound, centre)
        if face is None and not part[1].any():
            return _ordered(k, (POINTS, POINTS), own, part, radius, radius if k == 0 else 0.0)
        if face is None:
            return _ordered(k, (VERTEX_LINE, LINE_VERTEX), own, part, radius, shift)
    if face is None:
        return None
    return _ordered(k, (VERTEX_FACE, FACE_VERTEX), own, _sides_of(face, k), radius, shift)


def _on_side(
    radius: float, axis: Array, centre: Array, point: Array, normal: Array, places: Array, other: _Polyhedron, k: int
) -> Features | None:  # fmt: skip
    """Return the features where the side of a capsule or a cylinder touches a vertex or an edge."""
    own, shift, vertex = np.array([centre, axis]), radius if k == 0 else 0.0, other.vertex
    if other.edge is not None:
        place, d = places[1 - k], axis @ places[k][:3]
        if np.linalg.norm(np.cross(d, other.edge[1] @ place[:3])) <= CROSS:
            # where an edge lies along the axis, fixed points of it touch
            vertex = place[:3] @ (point - place[3])
            vertex = other.edge[0] + (vertex - other.edge[0]) @ other.edge[1] * other.edge[1]
    if vertex is not None:
        return _ordered(k, (LINE_VERTEX, VERTEX_LINE), own, np.array([vertex, np.zeros(3)]), radius, 0.0)
    if other.edge is None:
        return None
    found = _ordered(k, (EDGES, EDGES), own, np.array(other.edge), radius, shift)
    d, e = (part[1] @ place[:3] for part, place in zip(found.parts, places, strict=True))
    # the cross product of both leads from the first shape to the second
    found.parts[1, 1] *= np.sign(np.cross(d, e) @ normal)
    return found


def _on_rim(radius: float, axis: Array, end: Array, other: _Polyhedron, k: int) -> Features | None:
    """Return the features where a rim touches the inside of a face."""
    if other.face is None or other.vertex is not None or other.edge is not None:
        return None
    return _ordered(k, (RIM_FACE, FACE_RIM), np.array([end, radius * axis]), _face(other, k), 0.0, 0.0)


def _on_cap(
    radius: float, placed: PlacedShape, place: Array, end: Array, bound: float, point: Array, other: _Polyhedron, k: int
) -> Features | None:  # fmt: skip
    """Return the features where the flat end of a cylinder touches a vertex, or a face a fixed point of its rim."""
    axis = placed.rotation[:, 2]
    outward = axis if (end - placed.position) @ axis > 0.0 else -axis
    beside = place[:3] @ (point - place[3]) - end
    beside -= (beside @ axis) * axis
    size = float(np.linalg.norm(beside))
    if other.vertex is not None:
        if size >= radius - NEAR * bound:
            return None
        cap = np.array([end, outward if k == 0 else -outward])
        return _ordered(k, (FACE_VERTEX, VERTEX_FACE), cap, np.array([other.vertex, np.zeros(3)]), 0.0, 0.0)
    if other.face is None or other.edge is not None:
        return None
    if size < 0.5 * radius:
        return None
    fixed = np.array([end + radius / size * beside, np.zeros(3)])
    return _ordered(k, (VERTEX_FACE, FACE_VERTEX), fixed, _face(other, k), 0.0, 0.0)
