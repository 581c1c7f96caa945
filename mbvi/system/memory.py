"""Views of Pinocchio's results in their own memory: poses, Jacobian columns and mass matrix of one Data as arrays.

The ordinary getters cost more than the kernels that use their results. The expected memory layout is verified by the
addresses of the getters' arrays, without reading memory. Where the layout differs, the getters fill arrays of the same
shape.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pinocchio as pin

Array = np.ndarray

# numbers of one pose: 9 of the rotation by columns, then 3 of the translation; of a spatial velocity
_POSE, _MOTION = 12, 6
_DOUBLE = 8


class Window:
    """Memory with a shape; an array made from it keeps alive the owner, in whose memory it lies."""

    def __init__(self, owner: object, address: int, shape: tuple[int, ...], kind: str = "<f8") -> None:
        self._owner = owner
        self.__array_interface__: dict[str, Any] = {
            "data": (address, False), "shape": shape, "typestr": kind, "version": 3,
        }  # fmt: skip


class Memory:
    """The results of crba in the world convention.

    Parameters
    ----------
    model : pinocchio.Model
        The mechanism.
    data : pinocchio.Data
        Holds the results.

    Attributes
    ----------
    poses : ndarray, shape (njoints, 4, 3)
        Of each joint's frame in the world the three columns of the rotation, then the origin [m].
    columns : ndarray, shape (nv, 6)
        Row k is the Jacobian column of velocity k: velocity of the world's origin, then angular velocity.
    mass : ndarray, shape (nv, nv)
        M in its lower triangle.
    in_place : bool
        Whether the arrays are views that Pinocchio updates.
    """

    def __init__(self, model: pin.Model, data: pin.Data) -> None:
        self._data, nv = data, model.nv
        self._shapes = (model.njoints, 4, 3), (nv, 6), (nv, nv)
        self.check()

    def check(self) -> None:
        """Verify the memory layout; make views if it is the expected one, and copies otherwise."""
        addresses = self._addresses()
        self.in_place = addresses is not None
        if addresses is not None:
            windows = (Window(self._data, *both) for both in zip(addresses, self._shapes, strict=True))
            self.poses, self.columns, self.mass = map(np.asarray, windows)
            self.in_place = self._agrees()
        if not self.in_place:
            self.poses, self.columns, self.mass = map(np.zeros, self._shapes)
            self.refresh()

    def refresh(self) -> None:
        """Update the arrays where they are copies."""
        if not self.in_place:
            for array, read in zip((self.poses, self.columns, self.mass), self._read(), strict=True):
                array[:] = read

    def _read(self) -> tuple[Array, Array, Array]:
        """Return the same results through the ordinary getters."""
        poses = [np.vstack([pose.rotation.T, pose.translation]) for pose in self._data.oMi]
        _, columns, mass = self._shapes
        # with one degree of freedom the getter returns a vector
        return np.array(poses), self._data.J.reshape(6, -1).T.reshape(columns), self._data.M.T.reshape(mass)

    def _agrees(self) -> bool:
        read = self._read()
        # bit by bit, because results that were never computed may be NaN
        return all(
            a.tobytes() == np.ascontiguousarray(b).tobytes()
            for a, b in zip((self.poses, self.columns, self.mass), read, strict=True)
        )

    def _addresses(self) -> tuple[int, int, int] | None:
        """Return the addresses of poses, columns and mass matrix, or None if the layout is not the expected one."""
        first = address(self._data.oMi[0].rotation)
        for k, pose in enumerate(self._data.oMi):
            here = first + k * _POSE * _DOUBLE
            if _layout(pose.rotation) != (here, (_DOUBLE, 3 * _DOUBLE)):
                return None
            if _layout(pose.translation) != (here + 9 * _DOUBLE, (_DOUBLE,)):
                return None
        J, M, nv = self._data.J, self._data.M, self._shapes[1][0]
        if nv > 1 and (J.strides != (_DOUBLE, 6 * _DOUBLE) or M.strides != (_DOUBLE, nv * _DOUBLE)):
            return None
        if J.size != 6 * nv or M.size != nv * nv or not (_is_view(J, self._data.J) and _is_view(M, self._data.M)):
            return None
        return first, address(J), address(M)


def vector_view(data: pin.Data, read: Callable[[], Array]) -> Array | None:
    """Return the vector of a getter in its own memory, or None if the getter returns copies."""
    array = read()
    if not _is_view(array, read()) or array.strides != (_DOUBLE,):
        return None
    return np.asarray(Window(data, address(array), array.shape))


def motions_view(data: pin.Data, motions: Any) -> Array | None:
    """Return spatial velocities in their own memory, shape (njoints, 6), or None if they lie otherwise."""
    first = address(motions[0].linear)
    for k, motion in enumerate(motions):
        here = first + k * _MOTION * _DOUBLE
        if _layout(motion.linear) != (here, (_DOUBLE,)) or _layout(motion.angular) != (here + 3 * _DOUBLE, (_DOUBLE,)):
            return None
    return np.asarray(Window(data, first, (len(motions), _MOTION)))


def address(array: Array) -> int:
    """Return the address of an array's first number."""
    return int(array.__array_interface__["data"][0])


def _layout(array: Array) -> tuple[int, tuple[int, ...]]:
    return address(array), array.strides


def _is_view(array: Array, again: Array) -> bool:
    """Return whether a getter returns a view: two calls then return the same address."""
    return address(array) == address(again)
