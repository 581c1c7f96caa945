"""Visual meshes: vertices, triangles, and the colours of the file."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from ...errors import InputError
from ..inputs import mesh_of
from .collada import collada_mesh
from .wavefront import wavefront_mesh

Array = np.ndarray

# the squares of larger numbers overflow single precision [m]
LARGEST_LENGTH = 1e18


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles in a link's frame.

    Attributes
    ----------
    vertices : ndarray, shape (v, 3)
        Places [m].
    triangles : ndarray, shape (t, 3)
        Which vertices each has.
    colors : ndarray, shape (v, 3), or None
        Red, green, blue in [0, 1] of each vertex, NaN of those that the file gives none.
    """

    vertices: Array
    triangles: Array
    colors: Array | None = None

    @cached_property
    def bound(self) -> float:
        """Radius of a ball about the frame's origin that holds the mesh [m]."""
        return float(np.sqrt(np.square(self.vertices).sum(axis=1).max(initial=0.0)))


def visual_mesh(path: Path, scale: Array) -> Mesh:
    """Read a mesh file, with its own colours if it is a DAE or an OBJ file.

    Parameters
    ----------
    path : path
        STL, OBJ, DAE, or what else Coal reads.
    scale : ndarray, shape (3,)
        Metres per unit of the file.

    Raises
    ------
    InputError
        If the file cannot be read or has no triangle.
    """
    points, corners, colors = triangles_of(path)
    if not len(corners):
        raise InputError(f"{path} has no triangles")
    places = points * scale
    # written so that a NaN is refused too
    if not (np.abs(places) <= LARGEST_LENGTH).all():
        raise InputError(f"{path} has vertices that are not finite")
    return _merged(places, corners, colors)


def triangles_of(path: Path) -> tuple[Array, Array, Array | None]:
    """Return vertices (v, 3), triangles (t, 3), and colours (v, 3) as `Mesh` has them, of a mesh file.

    Of files with several meshes Coal's loader numbers the vertices of the triangles wrongly: what can be read without
    it is.

    Raises
    ------
    InputError
        If the file cannot be read.
    """
    read = {".dae": collada_mesh, ".obj": wavefront_mesh}.get(path.suffix.lower())
    return (read and read(path)) or (*mesh_of(path), None)


def _merged(points: Array, corners: Array, colors: Array | None) -> Mesh:
    """Return a mesh in single precision without duplicate vertices."""
    rows = points.astype(np.float32) + np.float32(0.0)
    if colors is not None:
        rows = np.concatenate([rows, colors.astype(np.float32)], axis=1)
    # as text of bytes rows are compared at once
    keys = np.ascontiguousarray(rows).view(f"V{4 * rows.shape[1]}").ravel()
    _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
    # in the order of the file, so that nearby triangles stay near
    order = np.argsort(first)
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    kept, triangles = rows[first[order]], place[inverse.ravel()][corners].astype(np.uint32)
    return Mesh(kept[:, :3], triangles, kept[:, 3:] if colors is not None else None)
