"""Rotations in the forms that users give: matrices, unit quaternions, roll-pitch-yaw angles, objects of libraries."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from ...arguments import array, shown
from ...errors import InputError
from ..rotations import matrices

Array = np.ndarray

# how far the columns of a rotation matrix may be from orthonormal, and the norm of a quaternion from 1
_ORTHONORMAL = 1e-6


class HasMatrix(Protocol):
    """A rotation of another library, such as `scipy.spatial.transform.Rotation`."""

    def as_matrix(self) -> Array:
        """Return its matrix, shape (3, 3)."""
        ...


# a matrix (3, 3), a unit quaternion (x, y, z, w), roll, pitch and yaw (3,) [rad], or an object with `as_matrix`
RotationLike = Array | Sequence[float] | Sequence[Sequence[float]] | HasMatrix


def rotation_matrix(value: RotationLike, name: str = "rotation") -> Array:
    """Return a rotation matrix, shape (3, 3), from any of the forms of `RotationLike`."""
    given = _as_matrices(value, name)
    if given.shape == (3,):
        given = _from_angles(given)
    if given.shape not in ((4,), (3, 3)):
        raise InputError(
            f"{name} has shape {given.shape}; it must be one rotation: a matrix (3, 3), a quaternion (x, y, z, w) or "
            "roll, pitch and yaw (3,) [rad]"
        )
    return rotation_matrices(given, name, 1)[0]


def rotation_matrices(value: RotationLike, name: str, count: int) -> Array:
    """Return rotation matrices, shape (count, 3, 3), from as many matrices or quaternions, or from one rotation."""
    given = _as_matrices(value, name)
    if given.shape == (3,):
        given = _from_angles(given)
    if given.shape in ((4,), (count, 4)):
        given = _from_quaternions(given, name)
    if given.shape not in ((3, 3), (count, 3, 3)):
        raise InputError(
            f"{name} has shape {given.shape}; it must be one rotation, or {count} matrices ({count}, 3, 3) or "
            f"quaternions ({count}, 4)"
        )
    each = np.broadcast_to(given, (count, 3, 3)).copy()
    off = np.abs(each.transpose(0, 2, 1) @ each - np.eye(3)).max(axis=(1, 2), initial=0.0)
    if not ((off < _ORTHONORMAL) & (np.linalg.det(each) > 0.0)).all():
        raise InputError(f"{name} holds no rotation matrix: columns must be orthonormal and right-handed")
    return each


def _as_matrices(value: RotationLike, name: str) -> Array:
    """Return the numbers of a rotation, those of its matrix where it is an object such as scipy's `Rotation`."""
    if hasattr(value, "as_matrix"):
        try:
            value = value.as_matrix()
        # the user may have passed a class, or an object whose method fails in any other way
        except Exception as error:
            raise InputError(f"{name} gives no matrix: {error}; got {shown(value)}") from error
    return array(value, name)


def _from_angles(angles: Array) -> Array:
    """Return the matrix of roll, pitch and yaw [rad] as a URDF has them: Rz(yaw) Ry(pitch) Rx(roll)."""
    (a, b, c), (i, j, k) = np.cos(angles), np.sin(angles)
    return np.array(
        [
            [c * b, c * j * i - k * a, c * j * a + k * i],
            [k * b, k * j * i + c * a, k * j * a - c * i],
            [-j, b * i, b * a],
        ]
    )


def _from_quaternions(given: Array, name: str) -> Array:
    """Return the matrices of quaternions (x, y, z, w), shape (..., 4), of unit length but for rounding."""
    length = np.linalg.norm(given, axis=-1, keepdims=True)
    wrong = length[np.abs(length - 1.0) > _ORTHONORMAL]
    if wrong.size:
        raise InputError(f"{name}: a quaternion (x, y, z, w) must have norm 1, divide it by its norm; got {wrong[0]:g}")
    return matrices(np.atleast_2d(given / length)).reshape(*given.shape[:-1], 3, 3)
