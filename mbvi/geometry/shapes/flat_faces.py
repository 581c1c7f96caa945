"""The flat faces of hulls that have many corners: the round ends of a cylinder in a mesh have hundreds."""

from __future__ import annotations

import numpy as np

from ..narrow.spread import FEW_POINTS, ONE_FACE
from .polyhedra import Array, Hull
from .shapes import PlacedShape

# numbers compared at a time: more do not stay in the processor's cache
_AT_ONCE = 1_000_000


def flat_faces(hull: Hull) -> tuple[list[Array], Array]:
    """Return the flat faces of a hull with more than `FEW_POINTS` corners, those of most corners first.

    Returns
    -------
    corners : list of ndarray of int
        Of each face its vertices, ascending: those within `ONE_FACE` of its plane, relative to the hull's radius.
    normals : ndarray, shape (f, 3)
        Outward unit normals.
    """
    points, (normals, offsets) = hull.vertices, hull.faces
    depth, count = ONE_FACE * hull.bound, np.zeros(len(offsets), np.int64)
    part = max(_AT_ONCE // len(points), 1)
    for start in range(0, len(offsets), part):
        some = slice(start, start + part)
        count[some] = np.count_nonzero(normals[some] @ points.T >= offsets[some, None] - depth, axis=1)
    faces, chosen, left = [], [], count > FEW_POINTS
    while left.any():
        first = int(np.where(left, count, 0).argmax())
        near = points @ normals[first] >= offsets[first] - depth
        faces.append(np.flatnonzero(near))
        chosen.append(first)
        left &= ~near[hull.triangles].all(axis=1)
        left[first] = False
    return faces, normals[chosen]


def half_width(hull: Hull) -> float:
    """Return the radius of a hull about its longest axis, that of its vertices [m]."""
    apart = hull.vertices - hull.vertices.mean(axis=0)
    axis = np.linalg.svd(apart, full_matrices=False)[2][0]
    return float(np.linalg.norm(apart - np.outer(apart @ axis, axis), axis=1).max())


class ManyCorners:
    """Widths and flat faces of the hulls of many pairs, as `Points` holds them."""

    def __init__(self) -> None:
        self._width: list[float] = []
        self._faces, self._face = [0], [0]
        self._corner, self._facing = [np.zeros(0, np.int64)], [np.zeros((0, 3))]

    def add(self, placed: PlacedShape, begin: int, graph: bool) -> None:
        """Add the shape of the next pair, whose points begin at `begin`; without a graph it has no faces."""
        hull, width, normals = placed.shape, 1.0, np.zeros((0, 3))
        faces: list[Array] = []
        if graph and isinstance(hull, Hull):
            width, (faces, normals) = hull.kept(half_width), hull.kept(flat_faces)
        self._width.append(width)
        self._faces.append(self._faces[-1] + len(faces))
        for corners in faces:
            self._corner.append(corners + begin)
            self._face.append(self._face[-1] + len(corners))
        self._facing.append(normals @ placed.rotation.T)

    def stacked(self) -> tuple[Array, Array, Array, Array, Array]:
        """Return the arrays `width`, `faces`, `face`, `corner` and `facing` of `Points`."""
        return (
            np.array(self._width),
            np.array(self._faces),
            np.array(self._face),
            np.concatenate(self._corner),
            np.concatenate(self._facing),
        )
