"""Tangents of contact rows, for Coulomb friction: coefficients, axes, gradients and rates."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from ..compiled import kernel, plain_array
from ..projection.row_speeds import times
from ..system.free.sparse_rows import stack_rows, take_rows
from ..system.mechanisms.separation import row
from ..system.system import Kinematics

Array = np.ndarray


class Tangents(NamedTuple):
    """Friction of some rows: two tangents each, and with torsional or rolling friction three axes of rotation.

    Attributes
    ----------
    friction : ndarray, shape (k,)
        Coefficient mu of each row; 0 where a row has no friction.
    axes : ndarray, shape (k, 2, 3)
        Unit tangents in the world, orthogonal to the normal and to each other; of constraints without a contact point
        (1, 0, 0) and (0, 1, 0).
    jacobian : ndarray or csr_array, shape (w k, nv)
        Rows r with r . v = the velocity of the second body relative to the first, along the tangent; zero where mu = 0.
        With `resistance` w is 5 and the angular velocities about the normal and both tangents follow, else w is 2.
    rate : ndarray, shape (w k,), or None
        The same at v = 0, due to walls with a prescribed motion [m/s, rad/s]; None if no row has any.
    resistance : ndarray, shape (k, 2), or None
        Of each row the lengths of torsional and rolling friction [m]; None where no constraint has any.
    bound : ndarray of int, shape (k,), or None
        Which row's normal percussion bounds the friction of each; see `coulomb_law`. None where each has its own.
    """

    friction: Array
    axes: Array
    jacobian: Array | csr_array
    rate: Array | None
    resistance: Array | None = None
    bound: Array | None = None

    @property
    def width(self) -> int:
        """How many rows of `jacobian` each contact has."""
        return 2 if self.resistance is None else 5

    def slip(self, v: Array) -> Array:
        """Return the tangential velocities, and angular ones, shape (k, w) [m/s, rad/s]."""
        speeds = times(self.jacobian, v)
        return (speeds if self.rate is None else speeds + self.rate).reshape(-1, self.width)

    def sliding(self) -> Tangents:
        """Return them without torsional and rolling friction."""
        if self.resistance is None:
            return self
        wide = (5 * np.arange(len(self.friction))[:, None] + np.arange(2)).ravel()
        rate = None if self.rate is None else self.rate[wide]
        return Tangents(self.friction, self.axes, take_rows(self.jacobian, wide), rate)

    def take(self, index: Array) -> Tangents:
        """Return those of some rows, by a mask or by their indices."""
        if index.dtype == bool:
            index = np.flatnonzero(index)
        wide = (self.width * index[:, None] + np.arange(self.width)).ravel()
        rate = None if self.rate is None else self.rate[wide]
        resistance = None if self.resistance is None else self.resistance[index]
        return Tangents(self.friction[index], self.axes[index], take_rows(self.jacobian, wide), rate, resistance)


def concatenate(parts: Sequence[Tangents]) -> Tangents:
    """Return those of all parts, all with `resistance` or none, one part after the other."""
    rate = None
    if any(part.rate is not None for part in parts):
        rate = np.concatenate([np.zeros(p.width * len(p.friction)) if p.rate is None else p.rate for p in parts])
    resistances = [part.resistance for part in parts if part.resistance is not None]
    return Tangents(
        np.concatenate([part.friction for part in parts]),
        np.concatenate([part.axes for part in parts]),
        stack_rows([part.jacobian for part in parts]),
        rate,
        np.concatenate(resistances) if resistances else None,
    )


def none_of(count: int, nv: int, sparse: bool) -> Tangents:
    """Return those of rows without friction."""
    jacobian = csr_array((2 * count, nv)) if sparse else np.zeros((2 * count, nv))
    return Tangents(np.zeros(count), np.tile(np.eye(3)[:2], (count, 1, 1)), jacobian, None)


@kernel("void(f8[::1], f8[:,::1])")
def write_tangents_of(normal: Array, axes: Array) -> None:
    """Write two tangents of a unit normal, shapes (3,) and (2, 3).

    T. Duff et al., Building an orthonormal basis, revisited (2017).
    """
    x, y, z = normal[0], normal[1], normal[2]
    sign = np.copysign(1.0, z)
    c = -1.0 / (sign + z)
    b = x * y * c
    axes[0, 0], axes[0, 1], axes[0, 2] = 1.0 + sign * x * x * c, sign * b, -sign * x
    axes[1, 0], axes[1, 1], axes[1, 2] = b, sign + y * y * c, -y


@kernel("void(f8[:,::1], f8[:,:,::1])")
def write_axes(normal: Array, axes: Array) -> None:
    """Write `write_tangents_of` each unit normal, shapes (k, 3) and (k, 2, 3)."""
    for a in range(len(normal)):
        write_tangents_of(normal[a], axes[a])


@kernel("void(f8[:,::1], f8[:,::1], i8[::1], i8[::1], f8[:,::1], f8[:,::1], f8[:,:,::1], f8[:,::1])")
def tangent_rows(
    columns: Array, support: Array, first: Array, second: Array, point: Array, normal: Array, axes: Array, rows: Array
) -> None:
    """Write axes and gradients of the tangents of one mechanism's contacts.

    Parameters
    ----------
    columns, support
        See `Kinematics`.
    first, second : ndarray of int, shape (k,)
        Bodies of each contact.
    point, normal : ndarray, shape (k, 3)
        Contact points and unit normals in the world.
    axes, rows : ndarray, shapes (k, 2, 3) and (2 k, nv)
        Receive the axes, as of `write_axes`, and the gradients along them.
    """
    write_axes(normal, axes)
    for a in range(len(first)):
        for c in range(2):
            row(columns, support[first[a]], support[second[a]], point[a], axes[a, c], rows[2 * a + c])


def tangents_of_mechanism(
    kinematics: Kinematics, bodies: tuple[Array, Array], point: Array, normal: Array, friction: Array
) -> Tangents:
    """Return the tangents of one mechanism's contacts, whose bodies are given as by `ConstraintFamily.bodies_of`."""
    _, columns, support = kinematics
    k = len(friction)
    axes, jacobian = np.empty((k, 2, 3)), np.empty((2 * k, len(columns)))
    tangent_rows(columns, support, *bodies, plain_array(point), plain_array(normal), axes, jacobian)
    return Tangents(friction, axes, jacobian, None)


def along_axes(values: Array, own: Array, axes: Array) -> Array:
    """Return vectors of k contacts, given by components along axes of their own, by those along other axes.

    Parameters
    ----------
    values : ndarray, shape (..., k, w)
        Two components within the tangent plane, and with w = 5 a rotation about the normal and two about tangents.
    own, axes : ndarray, shape (k, 2, 3)
        The axes of the contacts, and the others.
    """
    found = values.copy()
    for first in range(0, values.shape[-1], 3):
        world = np.einsum("...kc,kcd->...kd", values[..., first : first + 2], own)
        found[..., first : first + 2] = np.einsum("...kd,kcd->...kc", world, axes)
    return found


@kernel("void(f8[::1], f8[:,:,::1], f8[:,:,::1], i8[::1], f8[::1])")
def write_along_axes(values: Array, own: Array, axes: Array, order: Array, found: Array) -> None:
    """Write vectors of k contacts, four of each, by their components along other axes.

    Parameters
    ----------
    values : ndarray, shape (8 k,) or (12 k,)
        Two components along axes of their own, behind a rotation about the normal if there are three numbers.
    own, axes : ndarray, shapes (m, 2, 3) and (n, 2, 3)
        The axes of the contacts, and the others.
    order : ndarray of int, shape (k,)
        Which contact each one was.
    found : ndarray
        Receives the numbers; may have no size.
    """
    k = len(order)
    width = len(found) // (4 * k) if k > 0 else 0
    for c in range(4 if width > 0 else 0):
        for i in range(k):
            a = order[i]
            of, to = width * (c * k + a), width * (c * k + i)
            found[to] = values[of]
            for j in range(2):
                along = 0.0
                for d in range(3):
                    part = values[of + width - 2] * own[a, 0, d] + values[of + width - 1] * own[a, 1, d]
                    along += part * axes[i, j, d]
                found[to + width - 2 + j] = along


def axes_of(normal: Array) -> Array:
    """Return two tangents for each unit normal, shape (k, 2, 3)."""
    axes = np.empty((len(normal), 2, 3))
    write_axes(plain_array(normal), axes)
    return axes
