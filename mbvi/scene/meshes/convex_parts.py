"""Cuts meshes into convex parts by CoACD, an optional dependency."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pinocchio as pin

from ...errors import InputError
from ...geometry.meshes.triangles import Surface
from ...geometry.shapes.polyhedra import enclosed_volume
from ...geometry.shapes.shapes import Array, Hull


def convex_parts(mesh: Surface, concavity: float) -> tuple[tuple[Hull, ...], float | None]:
    """Return convex hulls that together cover a mesh, and by what part of its volume they are larger, if it is closed.

    Parameters
    ----------
    mesh : Surface
        The mesh.
    concavity : float
        CoACD's bound on how far the parts may lie outside of the mesh, relative to its size.

    Raises
    ------
    InputError
        If CoACD is not installed.

    Notes
    -----
    X. Wei, M. Liu, Z. Ling, H. Su, Approximate convex decomposition for 3D meshes with collision-aware concavity and
    tree search, ACM Transactions on Graphics 41 (2022).
    """
    parts = _cut(mesh.vertices.tobytes(), mesh.triangles.tobytes(), concavity)
    if not mesh.closed:
        return parts, None
    whole = abs(enclosed_volume(mesh.vertices, mesh.triangles))
    return parts, sum(part.volume for part in parts) / whole - 1.0


# CoACD takes seconds, and a scene may have many bodies of one mesh
@lru_cache(maxsize=32)
def _cut(points: bytes, corners: bytes, concavity: float) -> tuple[Hull, ...]:
    """Return the parts of a mesh of vertices, float64, and triangles, int64."""
    try:
        import coacd
    except ImportError as error:
        raise InputError("decompose needs CoACD: pip install 'mbvi[decompose]'") from error
    coacd.set_log_level("off")
    vertices, triangles = np.frombuffer(points).reshape(-1, 3), np.frombuffer(corners, np.int64).reshape(-1, 3)
    hulls = []
    for part, _ in coacd.run_coacd(coacd.Mesh(vertices, triangles), threshold=concavity, seed=0):
        try:
            hulls.append(Hull(np.array(part, dtype=float)))
        except InputError:
            # a part without a volume bears nothing that its neighbours do not
            continue
    return tuple(hulls)


def mass_properties(parts: tuple[Hull, ...], mass: float) -> tuple[Array, Array]:
    """Return centre of mass, shape (3,), and inertia about it, shape (3, 3), of parts of one density."""
    density, total = mass / sum(part.volume for part in parts), pin.Inertia.Zero()
    for part in parts:
        own = density * part.volume
        total += pin.Inertia(own, *part.mass_properties(own))
    return total.lever.copy(), total.inertia.copy()
