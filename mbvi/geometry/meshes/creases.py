"""Where a triangle mesh is bent: planes of triangles, ridges, peaks, and which normals each of these can have."""

from __future__ import annotations

from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from ...arguments import Array
from ...compiled import record
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
    a, b, c = (x[corner[:, k]] for k in range(3))
    planes = np.zeros((len(corner), 4, 4))
    normal = _unit(_cross(b - a, c - a))
    planes[:, 0, :3], planes[:, 0, 3] = normal, np.vecdot(normal, (a + b + c) / 3.0)
    for k, (one, other) in enumerate(((a, b), (b, c), (c, a))):
        inward = _unit(_cross(normal, other - one))
        planes[:, 1 + k, :3], planes[:, 1 + k, 3] = inward, np.vecdot(inward, one)
    number = surface.features[:, 3:6].ravel() - len(x)
    side, count = np.arange(len(number)), int(number.max()) + 1
    # of each edge the first and the last triangle that has it
    first, last = np.empty(count, np.int64), np.empty(count, np.int64)
    first[number[::-1]], last[number] = side[::-1], side
    tail, head = corner.ravel(), corner[:, [1, 2, 0]].ravel()
    forward = tail < head
    joined = (np.bincount(number) == 2) & (forward[first] != forward[last])
    beyond, one, other = np.full(len(number), -1), first[joined], last[joined]
    beyond[one], beyond[other] = other // 3, one // 3
    along, here, there = _unit(x[head[one]] - x[tail[one]]), normal[one // 3], normal[other // 3]
    angle = np.arctan2(np.vecdot(_cross(here, there), along), np.vecdot(here, there))
    of_edge = np.full(count, RIM)
    of_edge[joined] = np.where(angle > _ONE_FACE, RIDGE, np.where(angle < -_ONE_FACE, VALLEY, FLAT))
    bend = of_edge[number]
    owned = np.flatnonzero((bend == RIM) | ((bend == RIDGE) & (side == first[number])))
    ridge = np.full(len(number), -1)
    ridge[owned] = np.arange(len(owned))
    ends = np.column_stack([tail[owned], head[owned], owned // 3, beyond[owned]])
    at_edge = tail[first], head[first]
    made = beyond.reshape(-1, 3), bend.reshape(-1, 3), ridge.reshape(-1, 3)
    return Creases(x, corner, *surface.tree, planes, *made, *_peaks(corner, ends, at_edge, x, normal))


def _cross(a: Array, b: Array) -> Array:
    """Return cross products, shape (n, 3): `numpy.cross` takes longer."""
    x, y = a.T, b.T
    return np.stack([x[1] * y[2] - x[2] * y[1], x[2] * y[0] - x[0] * y[2], x[0] * y[1] - x[1] * y[0]], axis=1)


def _unit(a: Array) -> Array:
    """Return vectors divided by their lengths, shape (n, 3)."""
    return np.asarray(a / np.sqrt(np.vecdot(a, a))[:, None])


def _peaks(corner: Array, ends: Array, at_edge: tuple[Array, Array], x: Array, normal: Array) -> tuple[Array, ...]:
    """Return `owned`, `peak`, `ends`, `first` and `edges` of `Creases`."""
    rim = ends[:, 3] < 0
    sharp = np.bincount(ends[:, :2].ravel(), minlength=len(x))
    sharp += 3 * np.bincount(ends[rim, :2].ravel(), minlength=len(x))
    chosen = np.flatnonzero(sharp >= 3)
    peak = np.full(len(x), -1)
    peak[chosen] = np.arange(len(chosen))
    owned, where = np.full(corner.size, -1), np.full(len(x), -1)
    where[corner.ravel()[::-1]] = np.arange(corner.size)[::-1]
    owned[where[chosen]] = peak[chosen]
    a, b = at_edge
    at, to = np.concatenate([peak[a], peak[b]]), np.concatenate([b, a])
    at, to = at[at >= 0], to[at >= 0]
    down = ends[rim, :2].T.ravel()
    along = np.concatenate([_unit(x[to] - x[chosen[at]]), -normal[np.tile(ends[rim, 2], 2)]])
    at = np.concatenate([at, peak[down]])
    order = np.argsort(at, kind="stable")
    first = np.concatenate([[0], np.cumsum(np.bincount(at, minlength=len(chosen)))])
    return owned.reshape(-1, 3), peak, ends, first, np.ascontiguousarray(along[order])
