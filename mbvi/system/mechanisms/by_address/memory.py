"""Pinocchio's results as arrays: by its getters, and in its own memory, where kernels read them.

The expected memory layout is verified by the addresses of the getters' arrays, without reading memory.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from ....compiled import address

Array = np.ndarray

# numbers of one pose: 9 of the rotation by columns, then 3 of the translation
_POSE, _DOUBLE = 12, 8


class Window:
    """Memory with a shape; an array made from it keeps alive the owner, in whose memory it lies."""

    def __init__(self, owner: object, address: int, shape: tuple[int, ...], kind: str = "<f8") -> None:
        self._owner = owner
        self.__array_interface__: dict[str, Any] = {
            "data": (address, False), "shape": shape, "typestr": kind, "version": 3,
        }  # fmt: skip


def read_results(model: pin.Model, data: pin.Data) -> tuple[Array, Array, Array]:
    """Return copies of what crba computed in the world convention.

    Returns
    -------
    poses : ndarray, shape (njoints, 4, 3)
        Of each joint's frame in the world the three columns of the rotation, then the origin [m].
    columns : ndarray, shape (nv, 6)
        Row k is the Jacobian column of velocity k: velocity of the world's origin, then angular velocity.
    mass : ndarray, shape (nv, nv)
        M in its lower triangle.
    """
    poses = np.array([np.vstack([pose.rotation.T, pose.translation]) for pose in data.oMi])
    # with one degree of freedom the getter returns a vector
    columns, mass = data.J.reshape(6, -1).T.reshape(model.nv, 6), data.M.T.reshape(model.nv, model.nv)
    return poses, columns.copy(), mass.copy()


def results_in_place(model: pin.Model, data: pin.Data) -> tuple[Array, Array, Array, Array] | None:
    """Return arrays in which Pinocchio updates its results, or None if these lie otherwise than expected.

    They are those of `read_results`, and the nonlinear effects, shape (nv,).
    """
    addresses, effects = _addresses(model, data), data.nle
    if addresses is None or not _is_view(effects, data.nle) or effects.strides != (_DOUBLE,):
        return None
    shapes = (model.njoints, 4, 3), (model.nv, 6), (model.nv, model.nv), effects.shape
    windows = (Window(data, *both) for both in zip((*addresses, address(effects)), shapes, strict=True))
    poses, columns, mass, effects = map(np.asarray, windows)
    # bit by bit, because results that were never computed may be NaN
    for here, read in zip((poses, columns, mass), read_results(model, data), strict=True):
        if here.tobytes() != np.ascontiguousarray(read).tobytes():
            return None
    return poses, columns, mass, effects


def _addresses(model: pin.Model, data: pin.Data) -> tuple[int, int, int] | None:
    """Return the addresses of poses, columns and mass matrix, or None if the layout is not the expected one."""
    first = address(data.oMi[0].rotation)
    for k, pose in enumerate(data.oMi):
        here = first + k * _POSE * _DOUBLE
        if _layout(pose.rotation) != (here, (_DOUBLE, 3 * _DOUBLE)):
            return None
        if _layout(pose.translation) != (here + 9 * _DOUBLE, (_DOUBLE,)):
            return None
    J, M, nv = data.J, data.M, model.nv
    if nv > 1 and (J.strides != (_DOUBLE, 6 * _DOUBLE) or M.strides != (_DOUBLE, nv * _DOUBLE)):
        return None
    if J.size != 6 * nv or M.size != nv * nv or not (_is_view(J, data.J) and _is_view(M, data.M)):
        return None
    return first, address(J), address(M)


def _layout(array: Array) -> tuple[int, tuple[int, ...]]:
    return address(array), array.strides


def _is_view(array: Array, again: Array) -> bool:
    """Return whether a getter returns a view: two calls then return the same address."""
    return address(array) == address(again)
