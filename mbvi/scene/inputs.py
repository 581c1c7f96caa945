"""Checks of what a user gives: each returns it in the form the library computes with, or says what was wrong."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TypedDict

import numpy as np

from ..errors import InputError

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
    """

    position: Sequence[float] | Array
    rotation: Array | Sequence[Sequence[float]]
    velocity: Sequence[float] | Array
    angular_velocity: Sequence[float] | Array
    name: str | None
    fixed: bool


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


def mesh_vertices(path: Path) -> Array:
    """Return the vertices of a mesh file, shape (n, 3)."""
    import coal

    if not path.is_file():
        raise InputError(f"no such file: {path}")
    try:
        mesh = coal.MeshLoader().load(str(path), np.ones(3))
        return np.array(mesh.vertices())
    except (ValueError, RuntimeError) as error:
        raise InputError(f"{path} cannot be read as a mesh: {str(error).strip().splitlines()[0]}") from error
