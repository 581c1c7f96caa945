"""Triangle meshes: faces, edges and vertices, and a tree of boxes about the triangles."""

from __future__ import annotations

import copy
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ...arguments import Array
from ...arguments.bar import parts
from ...errors import InputError

# vertices nearer than this part of the mesh's extent are merged; triangles of less than its square have no area
_SAME_VERTEX = 1e-9
# triangles in a box of the tree that is not divided further
FEW = 4
# bits of each coordinate along the curve on which triangles are sorted: three times 21 fit into an integer
_BITS = 21


class Tree(NamedTuple):
    """A binary tree of boxes about triangles.

    Attributes
    ----------
    order : ndarray of int, shape (t,)
        The triangles, sorted such that neighbours are near each other.
    boxes : ndarray, shape (2 n, 6)
        Least and largest x, y, z of each box [m]. Box 1 holds all triangles; the halves of box k are 2 k and 2 k + 1;
        box n + j, with n a power of two, holds the triangles j `FEW` up to (j + 1) `FEW` of `order`.
    """

    order: Array
    boxes: Array


class Surface:
    """A triangle mesh: a sheet without thickness that is touched from both sides, or the skin of something solid.

    Parameters
    ----------
    vertices : array_like, shape (v, 3)
        Points [m]; coincident ones are merged.
    triangles : array_like of int, shape (t, 3)
        The three vertices of each triangle; triangles without an area are left out, and those that are listed again. Of
        a one-sided mesh they run anticlockwise seen from the free side.
    one_sided : bool or None
        Whether it is solid behind its triangles; None: if it is closed.

    Attributes
    ----------
    features : ndarray of int, shape (t, 7)
        Numbers of each triangle's corners, of its edges ab, bc and ca, and of its face.
    sharers : ndarray of int, shape (f,)
        Number of triangles that share each feature.
    rim : ndarray of bool, shape (f,)
        The edges that are not shared by two triangles in opposite directions, and their ends: they have no side.
    closed : bool
        Whether there is no rim.

    Raises
    ------
    InputError
        On wrong shapes, numbers that are not finite, or no triangle with an area.
    """

    smooth = False

    def __init__(self, vertices: Array, triangles: Array, one_sided: bool | None = False) -> None:
        points, corners = np.array(vertices, dtype=float), np.array(triangles)
        if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all() or not len(points):
            raise InputError(f"vertices has shape {points.shape}; finite numbers of shape (v, 3) are expected")
        if corners.ndim != 2 or corners.shape[1] != 3 or corners.dtype.kind not in "iu":
            raise InputError(f"triangles has shape {corners.shape}; integers of shape (t, 3) are expected")
        if corners.size and not 0 <= corners.min() <= corners.max() < len(points):
            raise InputError(f"triangles name vertices that are not there: there are {len(points)}")
        extent = float(np.ptp(points, axis=0).max())
        with parts(5, "mesh") as bar:
            # an STL file repeats a vertex for each of its triangles
            grid = np.round((points - points.min(axis=0)) / max(_SAME_VERTEX * extent, 1e-300)).astype(np.int64)
            first, welded = _first_of_each(grid)
            bar.update()
            points, corners = points[first], welded[corners]
            a, b, c = (points[corners[:, k]] for k in range(3))
            area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)
            kept = area > (_SAME_VERTEX * extent) ** 2
            if not kept.any():
                raise InputError("the mesh has no triangle with an area")
            self.vertices, self.triangles = points, _each_once(corners[kept].astype(np.int64), one_sided is False)
            bar.update()
            self.features, self.sharers = _features(self.triangles, len(points))
            bar.update(2)
            self.tree = tree_of(self.vertices, self.triangles)
            bar.update()
        self.one_sided = self.closed if one_sided is None else one_sided

    @classmethod
    def one_sided_of(cls, vertices: Array, faces: tuple[Array, Array, Array, Array], tree: Tree) -> Surface:
        """Return a one-sided mesh of which all is known; `faces` are triangles, features, sharers and rim."""
        new = object.__new__(cls)
        new.vertices, new.one_sided, new.tree = vertices, True, tree
        new.triangles, new.features, new.sharers, new.rim = faces
        return new

    def placed(self, rotation: Array, position: Array) -> Surface:
        """Return the mesh turned, then moved [m]."""
        new = copy.copy(self)
        new.__dict__.pop("bound", None)
        order, boxes = self.tree
        if np.array_equal(rotation, np.eye(3)):
            new.vertices = self.vertices + position
            new.tree = Tree(order, boxes + np.tile(position, 2))
        else:
            new.vertices = self.vertices @ rotation.T + position
            new.tree = Tree(order, boxes_about(*_extents(new.vertices, self.triangles[order])))
        return new

    @cached_property
    def rim(self) -> Array:
        """Which features have no side; see above."""
        first, edges = len(self.vertices), self.features[:, 3:6]
        forward = np.where(self.triangles < self.triangles[:, [1, 2, 0]], 1.0, -1.0)
        both = np.bincount(edges.ravel(), forward.ravel(), len(self.sharers)) == 0.0
        found = ~(both & (self.sharers == 2))
        found[first + self._edges :] = False
        found[:first] = False
        found[self.triangles[found[edges]]] = True
        found[self.triangles[:, [1, 2, 0]][found[edges]]] = True
        return found

    @property
    def _edges(self) -> int:
        return len(self.sharers) - len(self.vertices) - len(self.triangles)

    @property
    def closed(self) -> bool:
        """Whether each edge is shared by two triangles in opposite directions."""
        return not self.rim.any()

    @cached_property
    def bound(self) -> float:
        """Radius of a ball about the frame's origin that holds the mesh [m]."""
        return float(np.sqrt((self.vertices**2).sum(axis=1).max()))


def _each_once(triangles: Array, either_way: bool) -> Array:
    """Return the triangles, shape (t, 3), without those listed before; with the same corners either way round."""
    if either_way:
        a, b, c = np.sort(triangles, axis=1).T
    else:
        least, rows = triangles.argmin(axis=1), np.arange(len(triangles))
        a, b, c = (triangles[rows, (least + k) % 3] for k in range(3))
    count = int(triangles.max(initial=0)) + 1
    _, pair = np.unique(a * count + b, return_inverse=True)
    _, first = np.unique(pair * count + c, return_index=True)
    return triangles if len(first) == len(triangles) else triangles[np.sort(first)]


def _first_of_each(grid: Array) -> tuple[Array, Array]:
    """Return the first of each set of equal rows, in lexicographic order, and for each row the number of its set."""
    # two of three numbers, each below 2^31, in one: sorting by two keys takes less time than by three
    keys = grid[:, 0] << 31 | grid[:, 1]
    order = np.lexsort((grid[:, 2], keys))
    keys, last = keys[order], grid[order, 2]
    new = np.concatenate([[True], (keys[1:] != keys[:-1]) | (last[1:] != last[:-1])])
    number = np.empty(len(grid), np.int64)
    number[order] = np.cumsum(new) - 1
    return order[new], number


def _features(triangles: Array, vertices: int) -> tuple[Array, Array]:
    """Return `Surface.features` and `Surface.sharers` of triangles over a number of vertices."""
    ends = triangles[:, [0, 1, 2]], triangles[:, [1, 2, 0]]
    edges, which = np.unique(np.minimum(*ends) * vertices + np.maximum(*ends), return_inverse=True)
    faces = vertices + len(edges) + np.arange(len(triangles))
    features = np.column_stack([triangles, vertices + which.reshape(-1, 3), faces])
    return features, np.bincount(features.ravel(), minlength=faces[-1] + 1)


def tree_of(vertices: Array, triangles: Array) -> Tree:
    """Return the tree of triangles, halved along a Morton curve through the middles of their boxes."""
    lower, upper = _extents(vertices, triangles)
    middle = 0.5 * lower + 0.5 * upper
    low, high = middle.min(axis=0), middle.max(axis=0)
    # a mesh without extent along an axis has zeros there
    cells = ((middle - low) * ((2**_BITS - 1) / np.maximum(high - low, 1e-300))).astype(np.int64)
    order = curve_order(cells)
    return Tree(order, boxes_about(lower[order], upper[order]))


def _extents(vertices: Array, triangles: Array) -> tuple[Array, Array]:
    """Return the least and the largest coordinates of each triangle, shapes (t, 3)."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    return np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)


def curve_order(cells: Array) -> Array:
    """Return the order along a Morton curve of cells, integers below 2^21 of shape (n, 2) or (n, 3)."""
    curve = np.zeros(len(cells), np.int64)
    for axis in range(cells.shape[1]):
        x = cells[:, axis]
        # two zeros behind each bit
        for shift, mask in ((32, 0x1F00000000FFFF), (16, 0x1F0000FF0000FF), (8, 0x100F00F00F00F00F),
                            (4, 0x10C30C30C30C30C3), (2, 0x1249249249249249)):  # fmt: skip
            x = (x | x << shift) & mask
        curve |= x << axis
    return np.argsort(curve, kind="stable")


def boxes_about(lower: Array, upper: Array, few: int = FEW) -> Array:
    """Return the boxes of `Tree` about things with these extents, shape (n, 3), `few` of them in each of the last."""
    leaves = 1
    while leaves * few < len(lower):
        leaves *= 2
    boxes = np.empty((2 * leaves, 6))
    for side, corner, extreme, empty in (
        (slice(3), lower, np.minimum, np.inf),
        (slice(3, 6), upper, np.maximum, -np.inf),
    ):
        # an empty box holds no point
        part = np.full((leaves * few, 3), empty)
        part[: len(corner)] = corner
        while len(part) > leaves:
            part = extreme(part[::2], part[1::2])
        while len(part) > 1:
            boxes[len(part) : 2 * len(part), side] = part
            part = extreme(part[::2], part[1::2])
        boxes[1, side] = part
    boxes[0] = boxes[1]
    return boxes
