"""Triangle meshes: faces, edges and vertices, and a tree of boxes about the triangles."""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
from tqdm import tqdm

from ...arguments import Array
from ...errors import InputError

# vertices nearer than this part of the mesh's extent are merged; triangles of less than its square have no area
_SAME_VERTEX = 1e-9
# triangles in a box of the tree that is not divided further
FEW = 4
# bits of each coordinate along the curve on which triangles are sorted: three times 21 fit into an integer
_BITS = 21
# seconds after which a mesh that is being prepared shows a bar
_PATIENCE = 1.0


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
    """A triangle mesh: a sheet without thickness that spheres touch from both sides.

    Parameters
    ----------
    vertices : array_like, shape (v, 3)
        Points [m]; coincident ones are merged.
    triangles : array_like of int, shape (t, 3)
        The three vertices of each triangle; triangles without an area are left out.

    Attributes
    ----------
    features : ndarray of int, shape (t, 7)
        Numbers of each triangle's corners, of its edges ab, bc and ca, and of its face.
    sharers : ndarray of int, shape (f,)
        Number of triangles that share each feature.

    Raises
    ------
    InputError
        On wrong shapes, numbers that are not finite, or no triangle with an area.
    """

    smooth = False

    def __init__(self, vertices: Array, triangles: Array) -> None:
        points, corners = np.array(vertices, dtype=float), np.array(triangles)
        if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all() or not len(points):
            raise InputError(f"vertices has shape {points.shape}; finite numbers of shape (v, 3) are expected")
        if corners.ndim != 2 or corners.shape[1] != 3 or corners.dtype.kind not in "iu":
            raise InputError(f"triangles has shape {corners.shape}; integers of shape (t, 3) are expected")
        if corners.size and not 0 <= corners.min() <= corners.max() < len(points):
            raise InputError(f"triangles name vertices that are not there: there are {len(points)}")
        extent = float(np.ptp(points, axis=0).max())
        # nothing is shown where no terminal is, nor for a mesh that takes less than `_PATIENCE`
        with tqdm(total=5, desc="mesh", unit="part", delay=_PATIENCE, disable=None, leave=False) as bar:
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
            self.vertices, self.triangles = points, corners[kept].astype(np.int64)
            bar.update()
            self.features, self.sharers = _features(self.triangles, len(points))
            bar.update(2)
            # made here so that the bar shows its time too
            self.tree  # noqa: B018
            bar.update()

    def placed(self, rotation: Array, position: Array) -> Surface:
        """Return the mesh turned, then moved [m]."""
        new = object.__new__(Surface)
        new.vertices, new.triangles = self.vertices @ rotation.T + position, self.triangles
        new.features, new.sharers = self.features, self.sharers
        if np.array_equal(new.vertices, self.vertices):
            new.tree = self.tree
        return new

    @cached_property
    def bound(self) -> float:
        """Radius of a ball about the frame's origin that holds the mesh [m]."""
        return float(np.sqrt((self.vertices**2).sum(axis=1).max()))

    @cached_property
    def tree(self) -> Tree:
        """The tree of the triangles."""
        return _tree_of(self.vertices, self.triangles)


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


def _tree_of(vertices: Array, triangles: Array) -> Tree:
    """Return the tree of triangles, halved along a Morton curve through the middles of their boxes."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    lower, upper = np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)
    middle = 0.5 * lower + 0.5 * upper
    low, high = middle.min(axis=0), middle.max(axis=0)
    # a mesh without extent along an axis has zeros there
    cells = ((middle - low) * ((2**_BITS - 1) / np.maximum(high - low, 1e-300))).astype(np.int64)
    curve = np.zeros(len(triangles), np.int64)
    for axis in range(3):
        x = cells[:, axis]
        # two zeros behind each bit
        for shift, mask in ((32, 0x1F00000000FFFF), (16, 0x1F0000FF0000FF), (8, 0x100F00F00F00F00F),
                            (4, 0x10C30C30C30C30C3), (2, 0x1249249249249249)):  # fmt: skip
            x = (x | x << shift) & mask
        curve |= x << axis
    order = np.argsort(curve, kind="stable")
    leaves = 1
    while leaves * FEW < len(order):
        leaves *= 2
    boxes = np.empty((2 * leaves, 6))
    for side, corner, extreme, empty in (
        (slice(3), lower, np.minimum, np.inf),
        (slice(3, 6), upper, np.maximum, -np.inf),
    ):
        # an empty box holds no point
        part = np.full((leaves * FEW, 3), empty)
        part[: len(order)] = corner[order]
        while len(part) > leaves:
            part = extreme(part[::2], part[1::2])
        while len(part) > 1:
            boxes[len(part) : 2 * len(part), side] = part
            part = extreme(part[::2], part[1::2])
        boxes[1, side] = part
    boxes[0] = boxes[1]
    return Tree(order, boxes)
