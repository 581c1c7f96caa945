"""M = L'L on the tree of a mechanism's joints: L has an entry only where one joint carries the other."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from ..compiled import kernel, plain_array
from ..errors import InputError
from .metric import Array, triangular, whiten_full


@kernel("i8(f8[:,::1], f8, f8[::1], i8[::1], f8[:,::1])")
def factor(mass: Array, h: float, damping: Array, parent: Array, L: Array) -> int:
    """Write L with L'L = M + h D; return 0, or one plus a row where that turns out not to be positive definite.

    Parameters
    ----------
    mass : ndarray, shape (nv, nv)
        M, of which the lower triangle is read.
    h, damping : float and ndarray, shape (nv,)
        h and the diagonal of D.
    parent : ndarray of int, shape (nv,)
        The velocity that carries each one, -1 where there is none; M couples a velocity to its ancestors only.
    L : ndarray, shape (nv, nv)
        Lower triangular; overwritten.

    Notes
    -----
    R. Featherstone, Rigid Body Dynamics Algorithms (2008), table 6.3.
    """
    n = len(parent)
    for i in range(n):
        for j in range(n):
            L[i, j] = mass[i, j] if j <= i else 0.0
        L[i, i] += h * damping[i]
    for k in range(n - 1, -1, -1):
        # written so that a NaN is refused too
        if not L[k, k] > 0.0:
            return k + 1
        L[k, k] = np.sqrt(L[k, k])
        i = parent[k]
        while i >= 0:
            L[k, i] /= L[k, k]
            i = parent[i]
        i = parent[k]
        while i >= 0:
            j = i
            while j >= 0:
                L[i, j] -= L[k, i] * L[k, j]
                j = parent[j]
            i = parent[i]
    return 0


@kernel("void(f8[:,::1], i8[::1], f8[::1])")
def _whiten(L: Array, parent: Array, x: Array) -> None:
    """Overwrite x, shape (nv,), by L'^-1 x."""
    for k in range(len(x) - 1, -1, -1):
        # a gradient touches the joints that carry its bodies only
        if x[k] != 0.0:
            x[k] /= L[k, k]
            i = parent[k]
            while i >= 0:
                x[i] -= L[k, i] * x[k]
                i = parent[i]


@kernel("void(f8[:,::1], i8[::1], f8[::1])")
def _unwhiten(L: Array, parent: Array, x: Array) -> None:
    """Overwrite x, shape (nv,), by L^-1 x."""
    for k in range(len(x)):
        y = x[k]
        i = parent[k]
        while i >= 0:
            y -= L[k, i] * x[i]
            i = parent[i]
        x[k] = y / L[k, k]


@kernel("void(f8[:,::1], i8[::1], f8[:,::1])")
def _unwhiten_four(L: Array, parent: Array, x: Array) -> None:
    """Overwrite each row of x, shape (4, nv), by L^-1 times it: four sums side by side wait less for each other."""
    for k in range(x.shape[1]):
        a, b, c, d = x[0, k], x[1, k], x[2, k], x[3, k]
        i = parent[k]
        while i >= 0:
            part = L[k, i]
            a, b, c, d = a - part * x[0, i], b - part * x[1, i], c - part * x[2, i], d - part * x[3, i]
            i = parent[i]
        part = L[k, k]
        x[0, k], x[1, k], x[2, k], x[3, k] = a / part, b / part, c / part, d / part


@kernel("void(f8[:,::1], i8[::1], f8[:,::1], f8[:,::1], f8[:,::1])")
def solve(L: Array, parent: Array, rows: Array, whitened: Array, out: Array) -> None:
    """Write L'^-1 r and (L'L)^-1 r for every row r, shapes (m, nv)."""
    m, n = rows.shape
    for a in range(m):
        for k in range(n):
            whitened[a, k] = rows[a, k]
        _whiten(L, parent, whitened[a])
        for k in range(n):
            out[a, k] = whitened[a, k]
    fours = m - m % 4
    for a in range(0, fours, 4):
        _unwhiten_four(L, parent, out[a : a + 4])
    for a in range(fours, m):
        _unwhiten(L, parent, out[a])


@kernel("i8(f8[:,::1], f8[::1], i8[::1], f8[::1], f8, f8[::1], f8[::1], f8[:,::1], f8[::1])")
def advance_by(
    mass: Array, damping: Array, parent: Array, v: Array, h: float, torque: Array, effects: Array, L: Array, out: Array
) -> int:
    """Write v + (M + h D)^-1 h (torque - effects - D v) and the factor of M + h D; return as `factor`.

    Parameters
    ----------
    mass, parent, L
        As of `factor`.
    damping, v, torque, effects, out : ndarray, shape (nv,)
        The diagonal of D, velocity, torques and nonlinear effects, and the result.
    h : float
        Time step [s].
    """
    n = len(v)
    bad = factor(mass, h, damping, parent, L)
    if bad:
        return bad
    for k in range(n):
        out[k] = h * (torque[k] - effects[k] - damping[k] * v[k])
    _whiten(L, parent, out)
    _unwhiten(L, parent, out)
    for k in range(n):
        out[k] += v[k]
    return 0


def advance(mass: Array, damping: Array, parent: Array, v: Array, h: float, torque: Array, effects: Array) -> Array:
    """Return v + (M + h D)^-1 h (torque - effects - D v), shape (nv,).

    Raises
    ------
    InputError
        If that is not positive definite.
    """
    out = np.empty(len(v))
    bad = advance_by(mass, damping, parent, v, h, torque, effects, np.empty(mass.shape), out)
    if bad:
        raise _indefinite(bad, len(mass))
    return out


def _indefinite(bad: int, size: int) -> InputError:
    return InputError(
        f"the mass matrix is not positive definite (row {bad - 1} of {size}): "
        "check masses, inertias and the coordinates' redundancy"
    )


class TreeFreeMotion:
    """Free motion of one mechanism within a step, computed when it is needed.

    Parameters
    ----------
    mass, damping, parent, v, h, torque, effects
        As of `advance_by`.
    """

    __slots__ = ("kernel_arguments",)

    def __init__(
        self, mass: Array, damping: Array, parent: Array, v: Array, h: float, torque: Array, effects: Array
    ) -> None:
        self.kernel_arguments = mass, damping, parent, v, h, torque, effects

    @property
    def free(self) -> Array:
        """V + (M + h D)^-1 h (torque - effects - D v), shape (nv,)."""
        return advance(*self.kernel_arguments)

    def of(self, v: Array, at: Array) -> TreeFreeMotion:
        """Return what the same forces do to the velocity v, if these are those at the velocity `at`."""
        mass, damping, parent, _, h, torque, effects = self.kernel_arguments
        return TreeFreeMotion(mass, damping, parent, plain_array(v), h, torque, effects)

    @property
    def metric(self) -> TreeMetric:
        """M."""
        mass, _, parent, *_ = self.kernel_arguments
        return TreeMetric(mass, parent)


class TreeMetric:
    """The mass matrix of one mechanism.

    Parameters
    ----------
    mass : ndarray, shape (nv, nv)
        M, of which the lower triangle is read.
    parent : ndarray of int, shape (nv,)
        The velocity that carries each one, -1 where there is none.

    Raises
    ------
    InputError
        If M is not positive definite.
    """

    def __init__(self, mass: Array, parent: Array) -> None:
        self.lower, self.parent = np.empty(mass.shape), parent
        bad = factor(mass, 0.0, np.zeros(len(mass)), parent, self.lower)
        if bad:
            raise _indefinite(bad, len(mass))

    def apply(self, w: Array) -> Array:
        return self.lower.T @ (self.lower @ w)

    def whiten(self, w: Array) -> Array:
        return triangular(self.lower.T, w, 0)

    def unwhiten(self, y: Array) -> Array:
        return triangular(self.lower.T, y, 1)

    def solve_rows(self, rows: Array) -> Array:
        out = np.empty(rows.shape)
        solve(self.lower, self.parent, plain_array(rows), np.empty(rows.shape), out)
        return out

    def whiten_rows(self, rows: csr_array) -> csr_array:
        return whiten_full(self, rows)

    def dense(self) -> Array:
        return self.lower.T @ self.lower
