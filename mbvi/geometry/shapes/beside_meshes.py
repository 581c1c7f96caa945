"""What of one-sided meshes is solid beside fixed polyhedra: prisms behind the triangles at the rims of the meshes.

A box whose top is level with a field beside it would stop what slides from the field onto it by its side. Where a
prism is beside it, that side is none of the surface of their union; see `seams`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...arguments import Array
from ..meshes.triangles import Surface
from ..same_motions import same
from .polyhedra import Polyhedron
from .seams import TOUCHING
from .shapes import PlacedShape

# how far behind a triangle is solid, relative to the bounding radius of the shape beside it
_DEPTH = 0.1


def beside_meshes(shapes: Sequence[PlacedShape], meshes: Iterable[Any]) -> list[PlacedShape]:
    """Return the shapes, fixed polyhedra among them with the prisms of meshes that touch them.

    Parameters
    ----------
    shapes : sequence of PlacedShape
        All shapes.
    meshes : iterable
        Meshes of the world, with `motion` and what returns the mesh in the world, `placed()`.
    """
    found = list(shapes)
    solid: dict[int, Any] = {k: s.shape for k, s in enumerate(shapes) if not s.body and isinstance(s.shape, Polyhedron)}
    for item in meshes if solid else ():
        mesh = item.placed()
        if not mesh.one_sided:
            continue
        corners = _at_rims(mesh)
        low, high = corners.min(axis=1), corners.max(axis=1)
        for k in solid:
            one, shape = found[k], solid[k]
            if not same(one.motion, item.motion):
                continue
            vertices, reach = shape.vertices @ one.rotation.T + one.position, TOUCHING * shape.bound
            near = (low <= vertices.max(axis=0) + reach) & (high >= vertices.min(axis=0) - reach)
            parts = tuple(_prism(triangle, _DEPTH * shape.bound) for triangle in corners[near.all(axis=1)])
            found[k] = replace(one, beside=one.beside + parts)
    return found


def _at_rims(mesh: Surface) -> Array:
    """Return the corners of the triangles with an edge at a rim, shape (t, 3, 3)."""
    edges = mesh.features[:, 3:6]
    return mesh.vertices[mesh.triangles[(mesh.rim[edges] & (mesh.sharers[edges] == 1)).any(axis=1)]]


def _prism(corners: Array, depth: float) -> tuple[Array, Array]:
    """Return the vertices, shape (6, 3), and the planes, shape (5, 4), of a prism behind a triangle."""
    edges = np.roll(corners, -1, axis=0) - corners
    normal = np.cross(edges[0], edges[1])
    normal /= np.linalg.norm(normal)
    sides = np.cross(edges, normal)
    sides /= np.linalg.norm(sides, axis=1)[:, None]
    normals = np.vstack([sides, normal, -normal])
    offsets = np.append((sides * corners).sum(axis=1), [normal @ corners[0], depth - normal @ corners[0]])
    return np.vstack([corners, corners - depth * normal]), np.column_stack([normals, offsets])
