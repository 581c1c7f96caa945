"""Where fixed polyhedra touch or overlap each other: contacts there that the surface of their union does not have.

A body that slides from one tile to the next touches the side of the next one, which no surface shows. A contact of the
union at a point p has a normal n in its limiting normal cone at p (R. T. Rockafellar and R. J.-B. Wets, Variational
Analysis (1998), definition 6.3). Here n is regular at p if no other part that holds p reaches farther along n than p;
it is limiting if it is regular at p or at points next to p on the same face.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ...arguments import Array
from ...compiled import kernel, record
from ..same_motions import numbered
from .polyhedra import Polyhedron
from .shapes import PlacedShape

# lengths are relative to the bounding radius of a shape
# parts that are apart by less touch each other; points that are so level belong to one face
TOUCHING = 1e-6
# how far beside a point of contact a face is looked at: a body that has sunk into a corner touches both faces behind it
_BESIDE = 0.02


@record("i8[::1], i8[::1], i8[::1], f8[:,::1], i8[::1], f8[:,::1], f8[::1]")
class Seams(NamedTuple):
    """Fixed polyhedra that are near others, as kernels take them.

    Attributes
    ----------
    first_neighbour, neighbour : ndarray of int, shapes (s + 1,) and (k,)
        The shapes near each shape s are `neighbour[first_neighbour[s] : first_neighbour[s + 1]]`; of none near another
        all are empty, `first_neighbour` too.
    first_vertex, vertex : ndarray, shapes (s + 1,) and (v, 3)
        Vertices of each of them in the world [m].
    first_face, face : ndarray, shapes (s + 1,) and (f, 4)
        Outward unit normals and offsets of their faces.
    size : ndarray, shape (s,)
        Bounding radius of each shape [m].
    """

    first_neighbour: Array
    neighbour: Array
    first_vertex: Array
    vertex: Array
    first_face: Array
    face: Array
    size: Array


def seams_of(placed: Sequence[PlacedShape]) -> Seams:
    """Return the seams among the polyhedra of the world, those of one motion among each other."""
    solid: dict[int, Any] = {k: s.shape for k, s in enumerate(placed) if not s.body and isinstance(s.shape, Polyhedron)}
    vertices = {k: shape.vertices @ placed[k].rotation.T + placed[k].position for k, shape in solid.items()}
    low, high = (np.array([end(v, axis=0) for v in vertices.values()]).reshape(-1, 3) for end in (np.min, np.max))
    size, numbers = np.array([s.shape.bound for s in placed]), np.array(list(solid), np.int64)
    motion = numbered(placed[k].motion for k in solid)
    near: dict[int, Array] = {}
    for i, k in enumerate(solid):
        reach = TOUCHING * size[k]
        beside = (low <= high[i] + reach).all(axis=1) & (high >= low[i] - reach).all(axis=1) & (motion == motion[i])
        beside[i] = False
        if beside.any():
            near[k] = numbers[beside]
    planes: dict[int, Array] = {}
    count = len(placed)
    for k in solid:
        # what is solid beside it has numbers behind those of the shapes
        for part in placed[k].beside:
            near[k] = np.append(near.get(k, numbers[:0]), count)
            (vertices[count], planes[count]), count = part, count + 1
    if not near:
        none: Any = np.zeros(0, np.int64)
        return Seams(none, none, none, np.zeros((0, 3)), none, np.zeros((0, 4)), size)
    planes |= {k: _planes(placed[k], solid[k]) for k in near}
    return Seams(*_stacked(near, count), *_stacked(vertices, count), *_stacked(planes, count), size)


def _planes(placed: PlacedShape, shape: Polyhedron) -> Array:
    """Return the faces of a polyhedron in the world, outward unit normal and offset, shape (f, 4)."""
    normals, offsets = shape.faces
    turned = normals @ placed.rotation.T
    return np.column_stack([turned, offsets + turned @ placed.position])


def _stacked(parts: dict[int, Array], count: int) -> tuple[Array, Array]:
    """Return where the part of each of some shapes begins, and the last one ends, and all parts in one array."""
    begin = np.cumsum([0, *(len(parts.get(k, ())) for k in range(count))])
    return begin, np.concatenate([parts[k] for k in sorted(parts)])


@kernel("f8(Seams, i8, f8[::1])")
def reach_along(seams: Seams, shape: int, n: Array) -> float:
    """Return how far a shape reaches along n [m]."""
    most = -np.inf
    for k in range(seams.first_vertex[shape], seams.first_vertex[shape + 1]):
        v = seams.vertex[k]
        most = max(most, n[0] * v[0] + n[1] * v[1] + n[2] * v[2])
    return most


@kernel("b1(Seams, i8, f8[::1], f8[::1])")
def is_hidden_at(seams: Seams, shape: int, point: Array, n: Array) -> bool:
    """Return whether a neighbour of a shape holds a point, shape (3,), and reaches farther than it along n."""
    reach = TOUCHING * seams.size[shape]
    level = n[0] * point[0] + n[1] * point[1] + n[2] * point[2]
    for i in range(seams.first_neighbour[shape], seams.first_neighbour[shape + 1]):
        other, holds = seams.neighbour[i], True
        for k in range(seams.first_face[other], seams.first_face[other + 1]):
            f = seams.face[k]
            if f[0] * point[0] + f[1] * point[1] + f[2] * point[2] > f[3] + reach:
                holds = False
                break
        if holds and reach_along(seams, other, n) > level + reach:
            return True
    return False


@kernel("b1(Seams, i8, f8, f8[::1], f8[::1], f8)")
def is_covered(seams: Seams, shape: int, gap: float, middle: Array, normal: Array, sign: float) -> bool:
    """Return whether a contact of a fixed shape is none of the union of the shapes near it.

    Parameters
    ----------
    seams : Seams
        The fixed shapes; not empty.
    shape : int
        Which of them.
    gap : float
        Signed distance [m].
    middle, normal : ndarray, shape (3,)
        The point midway between the surfaces, and a unit vector.
    sign : float
        1 if the vector leads out of the shape, -1 if it leads into it.
    """
    if seams.first_neighbour[shape] == seams.first_neighbour[shape + 1]:
        return False
    n, point, beside = np.empty(3), np.empty(3), np.empty(3)
    for c in range(3):
        n[c] = sign * normal[c]
        point[c] = middle[c] - 0.5 * gap * n[c]
    if not is_hidden_at(seams, shape, point, n):
        return False
    size = seams.size[shape]
    level = reach_along(seams, shape, n) - TOUCHING * size
    for k in range(seams.first_vertex[shape], seams.first_vertex[shape + 1]):
        v, square = seams.vertex[k], 0.0
        if n[0] * v[0] + n[1] * v[1] + n[2] * v[2] < level:
            continue
        for c in range(3):
            square += (v[c] - point[c]) ** 2
        if square > (TOUCHING * size) ** 2:
            share = min(_BESIDE * size / np.sqrt(square), 1.0)
            for c in range(3):
                beside[c] = point[c] + share * (v[c] - point[c])
            if not is_hidden_at(seams, shape, beside, n):
                return False
    return True


@kernel("b1(Seams, i8, i8, f8, f8[::1], f8[::1])")
def at_seam(seams: Seams, first: int, second: int, gap: float, middle: Array, normal: Array) -> bool:
    """Return whether a contact is none of the unions of fixed shapes.

    `first` and `second` are the fixed shapes on either side, -1 for one that moves; the normal leads to the second.
    """
    if first >= 0 and is_covered(seams, first, gap, middle, normal, 1.0):
        return True
    return second >= 0 and is_covered(seams, second, gap, middle, normal, -1.0)


@kernel("i8(Seams, i8[::1], i8[::1], f8[::1], f8[:,::1], f8[:,::1], i8[::1])")
def uncovered(seams: Seams, first: Array, second: Array, gap: Array, middle: Array, normal: Array, kept: Array) -> int:
    """Write the places of the contacts that the unions of fixed shapes have; return how many.

    Parameters
    ----------
    seams : Seams
        The fixed shapes; not empty.
    first, second : ndarray of int, shape (k,)
        The fixed shape on either side of each contact, -1 for one that moves.
    gap, middle, normal : ndarray, shapes (k,), (k, 3) and (k, 3)
        The contacts; normals lead from the first side to the second.
    kept : ndarray of int, shape (k,)
        Receives the places, ascending.
    """
    count = 0
    for i in range(len(gap)):
        if not at_seam(seams, first[i], second[i], gap[i], middle[i], normal[i]):
            kept[count] = i
            count += 1
    return count
