"""Checks of what a user gives: each returns it in the form the library computes with, or says what was wrong."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TypedDict

import numpy as np

from ..errors import InputError
from ..motion import Motion

Array = np.ndarray


class BodyArguments(TypedDict, total=False):
    """What every rigid body may be given by name.

    Attributes
    ----------
    position, rotation : array_like, shapes (3,) and (3, 3)
        Pose of its frame [m]; at the origin, upright by default.
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
    rotation: Array | Sequence[Sequence[float]]
    velocity: Sequence[float] | Array
    angular_velocity: Sequence[float] | Array
    name: str | None
    fixed: bool
    motion: Motion | None


def vector(values: Sequence[float] | Array, name: str) -> Array:
    """Return three finite numbers as an array, shape (3,)."""
    try:
        vector = np.array(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} is no array of three numbers: {values!r}") from error
    if vector.shape != (3,):
        raise InputError(f"{name} has shape {vector.shape}; (3,) is asked for")
    if not np.isfinite(vector).all():
        raise InputError(f"{name} must be finite; got {vector.tolist()}")
    return vector


def rotation_matrix(values: Array | Sequence[Sequence[float]]) -> Array:
    """Return a rotation matrix, shape (3, 3)."""
    matrix = np.array(values, dtype=float)
    if matrix.shape != (3, 3):
        raise InputError(f"rotation has shape {matrix.shape}; (3, 3) is asked for")
    # written so that a NaN is refused too
    if not (np.abs(matrix.T @ matrix - np.eye(3)).max() < 1e-6 and np.linalg.det(matrix) > 0.0):
        raise InputError("rotation is no rotation matrix: its columns must be orthonormal and right-handed")
    return matrix


def positive(value: float, name: str) -> float:
    """Return a positive, finite number."""
    # written so that a NaN is refused too
    if not (value > 0.0 and np.isfinite(value)):
        raise InputError(f"{name} must be positive and finite; got {value}")
    return float(value)


def optional_positive(value: float | None, name: str) -> float | None:
    """Return None, or a positive, finite number."""
    return None if value is None else positive(value, name)


def many_vectors(values: Array | Sequence[Sequence[float]], name: str, count: int | None = None) -> Array:
    """Return an array of vectors, shape (n, 3), of which there is one at least, or `count`."""
    try:
        vectors = np.array(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} is no array of numbers") from error
    if vectors.ndim != 2 or vectors.shape[1] != 3 or not len(vectors) or (count and len(vectors) != count):
        raise InputError(f"{name} has shape {vectors.shape}; ({count or 'n'}, 3) is asked for")
    if not np.isfinite(vectors).all():
        raise InputError(f"{name} must be finite")
    return vectors


def many_positive(values: float | Sequence[float] | Array, name: str, count: int) -> Array:
    """Return a positive number each, shape (count,), from as many or one."""
    try:
        each = np.broadcast_to(np.asarray(values, dtype=float), (count,)).copy()
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} has shape {np.shape(values)}; one or {count} are asked for") from error
    # written so that a NaN is refused too
    if not ((each > 0.0) & np.isfinite(each)).all():
        raise InputError(f"every {name} must be positive")
    return each


def many_masses(
    mass: float | Sequence[float] | Array | None, density: float | Sequence[float] | Array | None, volumes: Array
) -> Array:
    """Return masses, shape (n,) [kg], as they are given or from a density [kg/m^3]."""
    if (mass is None) == (density is None):
        raise InputError("give either mass or density")
    if mass is not None:
        return many_positive(mass, "mass", len(volumes))
    return volumes * many_positive(density, "density", len(volumes))  # type: ignore[arg-type]


def many_rotations(values: Array | Sequence[Sequence[float]] | None, count: int) -> Array:
    """Return rotation matrices, shape (count, 3, 3), from as many, one, or none for upright."""
    matrices = np.array(np.eye(3) if values is None else values, dtype=float)
    if matrices.shape not in ((3, 3), (count, 3, 3)):
        raise InputError(f"rotations has shape {matrices.shape}; (3, 3) or ({count}, 3, 3) is asked for")
    each = np.broadcast_to(matrices, (count, 3, 3)).copy()
    # written so that a NaN is refused too
    off = np.abs(each.transpose(0, 2, 1) @ each - np.eye(3)).max(axis=(1, 2))
    if not ((off < 1e-6) & (np.linalg.det(each) > 0.0)).all():
        raise InputError("rotations: not all are rotation matrices; columns must be orthonormal and right-handed")
    return each


def mesh_of(path: Path) -> tuple[Array, Array]:
    """Return vertices, shape (v, 3), and triangles, shape (t, 3), of a mesh file."""
    import coal

    if not path.is_file():
        raise InputError(f"no such file: {path}")
    try:
        mesh = coal.MeshLoader().load(str(path), np.ones(3))
        triangles = map(mesh.tri_indices, range(mesh.num_tris))
        return np.array(mesh.vertices()), np.array([[t[0], t[1], t[2]] for t in triangles])
    except (ValueError, RuntimeError) as error:
        raise InputError(f"{path} cannot be read as a mesh: {str(error).strip().splitlines()[0]}") from error
