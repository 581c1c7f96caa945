"""Cuts meshes into convex parts by CoACD, an optional dependency."""

from __future__ import annotations

import numpy as np

from ...errors import InputError
from ...geometry.meshes.triangles import Surface
from ...geometry.shapes.shapes import Array, Hull

# CoACD takes seconds, and a scene may have many bodies of one mesh
_known: dict[tuple[bytes, bytes, float], tuple[Hull, ...]] = {}


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
    key = mesh.vertices.tobytes(), mesh.triangles.tobytes(), concavity
    if key not in _known:
        _known[key] = _cut(mesh.vertices, mesh.triangles, concavity)
    parts, larger = _known[key], None
    if mesh.closed:
        a, b, c = np.moveaxis(mesh.vertices[mesh.triangles], 1, 0)
        larger = 6.0 * sum(part.volume for part in parts) / abs(float(np.vecdot(a, np.cross(b, c)).sum())) - 1.0
    return parts, larger


def _cut(points: Array, corners: Array, concavity: float) -> tuple[Hull, ...]:
    try:
        import coacd
    except ImportError as error:
        raise InputError("decompose needs CoACD: pip install 'mbvi[decompose]'") from error
    coacd.set_log_level("off")
    found = coacd.run_coacd(coacd.Mesh(points, corners), threshold=concavity, seed=0)
    hulls = []
    for part, _ in found:
        try:
            hulls.append(Hull(np.array(part, dtype=float)))
        except InputError:
            # a part without a volume bears nothing that its neighbours do not
            continue
    return tuple(hulls)


def mass_properties(parts: tuple[Hull, ...], mass: float) -> tuple[Array, Array]:
    """Return centre of mass, shape (3,), and inertia about it, shape (3, 3), of parts of one density."""
    masses = mass * np.array([part.volume for part in parts]) / sum(part.volume for part in parts)
    own = [part.mass_properties(m) for part, m in zip(parts, masses.tolist(), strict=True)]
    centre = sum(m * c for m, (c, _) in zip(masses, own, strict=True)) / mass
    inertia = np.zeros((3, 3))
    for m, (c, about) in zip(masses, own, strict=True):
        arm = c - centre
        inertia += about + m * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return np.asarray(centre), inertia
