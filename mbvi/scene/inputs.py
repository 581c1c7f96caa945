"""Arguments of bodies in a scene: their types, masses from densities, points of mesh files."""

from __future__ import annotations

import os
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import TypedDict

import numpy as np

from ..arguments import all_positive, array, not_found, positive
from ..errors import InputError
from ..geometry.motion import Motion
from ..geometry.shapes.orientation import RotationLike
from .meshes.collada import metres_per_unit

Array = np.ndarray


class BodyArguments(TypedDict, total=False):
    """Keyword arguments of every rigid body.

    Attributes
    ----------
    position : array_like, shape (3,)
        Origin of its frame [m]; that of the world by default.
    rotation : array_like, or an object with `as_matrix`
        From its frame to the world: a matrix (3, 3), a unit quaternion (x, y, z, w), shape (4,), roll, pitch and yaw,
        shape (3,) [rad], as a URDF has them, Rz(yaw) Ry(pitch) Rx(roll), or scipy's `Rotation`; upright by default.
    velocity, angular_velocity : array_like, shape (3,)
        Of its centre of mass, both in the world [m/s, rad/s]; at rest by default.
    name : str or None
        "box", "capsule", ... then numbered, by default.
    fixed : bool
        Whether it is part of the world.
    motion : Motion or None
        How it moves, whatever pushes on it; such a body is part of the world.
    """

    position: Sequence[float] | Array
    rotation: RotationLike
    velocity: Sequence[float] | Array
    angular_velocity: Sequence[float] | Array
    name: str | None
    fixed: bool
    motion: Motion | None


def many_masses(
    mass: float | Sequence[float] | Array | None, density: float | Sequence[float] | Array | None, volumes: Array
) -> Array:
    """Return masses, shape (n,) [kg], as given or from a density [kg/m^3]."""
    if (mass is None) == (density is None):
        raise InputError("give either mass or density")
    if mass is not None:
        return all_positive(mass, "mass", len(volumes))
    each = volumes * all_positive(density, "density", len(volumes))  # type: ignore[arg-type]
    return all_positive(each, "mass by its density", len(volumes))


def scaled(points: Array, scale: float) -> Array:
    """Return the points of a mesh in metres, shape (v, 3)."""
    return array(positive(scale, "scale") * points, "mesh times scale", ("v", 3))


def mesh_of(path: Path) -> tuple[Array, Array]:
    """Return vertices, shape (v, 3), and triangles, shape (t, 3), of a mesh file; of a DAE file in metres."""
    import coal

    if not os.path.isfile(path):
        raise InputError(not_found(path))
    try:
        mesh = coal.MeshLoader().load(str(path), np.ones(3))
        triangles = map(mesh.tri_indices, range(mesh.num_tris))
        corners = np.array([[t[0], t[1], t[2]] for t in triangles])
        points = array(np.array(mesh.vertices()), f"the vertices of {path}", ("v", 3))
        return metres_per_unit(path) * points, corners
    except (ValueError, RuntimeError) as error:
        raise InputError(f"{path} cannot be read as a mesh: {(str(error).strip() or '?').splitlines()[0]}") from error


def check_known(given: Collection[str], more: Sequence[str] = ()) -> None:
    """Raise `InputError` if an argument of a body is unknown."""
    unknown = set(given) - {*BodyArguments.__annotations__, *more}
    if unknown:
        raise InputError(f"unknown argument {sorted(unknown)}; known are {', '.join(BodyArguments.__annotations__)}")
