"""Where a triangle mesh is bent: planes of triangles, ridges, peaks, and which normals each of these can have."""

from __future__ import annotations

from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from ...arguments import Array
from ...compiled import record
from .mesh_planes import count_peaks, write_angles, write_peak_edges, write_planes
from .triangles import Surface

# how triangles meet at an edge, seen from the free side
FLAT, RIDGE, VALLEY, RIM = range(4)
# angle of two triangles below which they are one flat face [rad]
_ONE_FACE = 1e-6


@record(
    "f8[:,::1], i8[:,::1], i8[::1], f8[:,::1], f8[:,:,::1], i8[:,::1], i8[:,::1], i8[:,::1], i8[:,::1], i8[::1],"
    " i8[:,::1], i8[::1], f8[:,::1]"
)
class Creases(NamedTuple):
    """A mesh whose free side is where its triangles' corners run anticlockwise, as kernels take it.

    A ridge is an edge that bends away from the free side, or belongs to one triangle only: then a wall below it is
    imagined. A peak is a vertex at which three ridges or the rim meet.

    Attributes
    ----------
    vertices, triangles, order, boxes
        Of `Surface` and its `Tree`.
    planes : ndarray, shape (t, 4, 4)
        Unit normal and offset [m] of each triangle; then of its edges ab, bc, ca, within its plane and inwards.
    beyond : ndarray of int, shape (t, 3)
        The triangle beyond each edge ab, bc, ca; -1 beyond the rim.
    bend : ndarray of int, shape (t, 3)
        `FLAT`, `RIDGE`, `VALLEY` or `RIM` of each edge.
    ridge : ndarray of int, shape (t, 3)
        The number of the ridge at each edge, in one of its triangles; -1 elsewhere.
    owned : ndarray of int, shape (t, 3)
        The number of the peak at each corner, in one of its triangles; -1 elsewhere.
    peak : ndarray of int, shape (v,)
        The number of the peak at each vertex, -1 where there is none.
    ends : ndarray of int, shape (r, 4)
        Both vertices of each ridge, and its two triangles; -1 for the second at the rim.
    first : ndarray of int, shape (p + 1,)
        Where the edges of each peak begin.
    edges : ndarray, shape (e, 3)
        Unit vectors from the peak along its edges, and down imagined walls.
    """

    vertices: Array
    triangles: Array
    order: Array
    boxes: Array
    planes: Array
    beyond: Array
    bend: Array
    ridge: Array
    owned: Array
    peak: Array
    ends: Array
    first: Array
    edges: Array


# copies of a problem share its meshes
_known: WeakKeyDictionary[Surface, Creases] = WeakKeyDictionary()


def creases_of(surface: Surface) -> Creases:
    """Return the creases of a mesh."""
    if surface not in _known:
        _known[surface] = _creases_of(surface)
    return _known[surface]


def _creases_of(surface: Surface) -> Creases:
    x, corner = surface.vertices, surface.triangles
    beyond: Array = np.empty(corner.shape, np.int64)
    planes = np.empty((len(corner), 4, 4))
    write_planes(x, corner, planes)
    number: Array = surface.features[:, 3:6] - len(x)
    count = int(number.max()) + 1
    first, angle = np.empty(count, np.int64), np.empty(count)
    write_angles(x, corner, planes, number, first, beyond, angle)
    number, beyond = number.ravel(), beyond.ravel()
    of_edge: Array = np.full(count, RIM)
    of_edge[np.abs(angle) <= _ONE_FACE] = FLAT
    of_edge[angle > _ONE_FACE], of_edge[angle < -_ONE_FACE] = RIDGE, VALLEY
    side, tail, head = np.arange(len(number)), corner.ravel(), corner[:, [1, 2, 0]].ravel()
    bend = of_edge[number]
    owned = np.flatnonzero((bend == RIM) | ((bend == RIDGE) & (side == first[number])))
    ridge = np.full(len(number), -1)
    ridge[owned] = np.arange(len(owned))
    ends = np.column_stack([tail[owned], head[owned], owned // 3, beyond[owned]])
    made = beyond.reshape(-1, 3), bend.reshape(-1, 3), ridge.reshape(-1, 3)
    return Creases(x, corner, *surface.tree, planes, *made, *_peaks(x, corner, planes, ends, first))


def _peaks(x: Array, corner: Array, planes: Array, ends: Array, first: Array) -> tuple[Array, ...]:
    """Return `owned`, `peak`, `ends`, `first` and `edges` of `Creases`, from the first side of each edge."""
    owned, peak, edges = np.empty(corner.shape, np.int64), np.empty(len(x), np.int64), np.empty(len(x), np.int64)
    count = count_peaks(corner, ends, first, peak, owned, edges)
    begin = np.concatenate([[0], np.cumsum(edges[:count])])
    along = np.empty((begin[-1], 3))
    write_peak_edges(x, corner, planes, ends, first, peak, begin[:-1].copy(), along)
    return owned, peak, ends, begin, along
