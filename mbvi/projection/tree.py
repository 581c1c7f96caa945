"""M = L'L on the tree of a mechanism's joints: L has an entry only where one joint carries the other."""

from __future__ import annotations

import numpy as np

from ..compiled import kernel, plain_array
from ..errors import InputError
from .metric import Array, triangular


def _factor_plain(mass: Array, parent: Array, L: Array) -> int:
    """Write L with L'L = M; return 0, or one plus a row where M turns out not to be positive definite.

    Parameters
    ----------
    mass : ndarray, shape (nv, nv)
        M, of which the lower triangle is read.
    parent : ndarray of int, shape (nv,)
        The velocity that carries each one, -1 where there is none; M couples a velocity to its ancestors only.
    L : ndarray, shape (nv, nv)
        Lower triangular; overwritten.

    Notes
    -----
    R. Featherstone, Rigid Body Dynamics Algorithms (2008), table 6.3.
    """
    lower = np.tril(mass)
    M = lower + np.tril(lower, -1).T
    try:
        L[:] = np.linalg.cholesky(M[::-1, ::-1]).T[::-1, ::-1]
    except np.linalg.LinAlgError:
        return 1
    return 0


@kernel("i8(f8[:,::1], i8[::1], f8[:,::1])", plain=_factor_plain)
def _factor(mass: Array, parent: Array, L: Array) -> int:
    n = len(parent)
    for i in range(n):
        for j in range(n):
            L[i, j] = mass[i, j] if j <= i else 0.0
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


def solve_plain(L: Array, parent: Array, rows: Array, out: Array) -> None:
    """Write M^-1 r for every row r, shapes (m, nv)."""
    out[:] = np.linalg.solve(L, np.linalg.solve(L.T, rows.T)).T


@kernel("void(f8[:,::1], i8[::1], f8[:,::1], f8[:,::1])", plain=solve_plain)
def solve(L: Array, parent: Array, rows: Array, out: Array) -> None:
    """Loops of `solve_plain`."""
    m, n = rows.shape
    for a in range(m):
        for k in range(n):
            out[a, k] = rows[a, k]
        for k in range(n - 1, -1, -1):
            # a row touches the joints that carry its bodies only
            if out[a, k] != 0.0:
                out[a, k] /= L[k, k]
                i = parent[k]
                while i >= 0:
                    out[a, i] -= L[k, i] * out[a, k]
                    i = parent[i]
        for k in range(n):
            x = out[a, k]
            i = parent[k]
            while i >= 0:
                x -= L[k, i] * out[a, i]
                i = parent[i]
            out[a, k] = x / L[k, k]


def _advance_plain(L: Array, parent: Array, v: Array, h: float, torque: Array, effects: Array, out: Array) -> None:
    """Write v + h M^-1 (torque - effects), all of shape (nv,)."""
    out[:] = v + np.linalg.solve(L, np.linalg.solve(L.T, h * (torque - effects)))


@kernel("void(f8[:,::1], i8[::1], f8[::1], f8, f8[::1], f8[::1], f8[::1])", plain=_advance_plain)
def _advance(L: Array, parent: Array, v: Array, h: float, torque: Array, effects: Array, out: Array) -> None:
    n = len(v)
    for k in range(n):
        out[k] = h * (torque[k] - effects[k])
    for k in range(n - 1, -1, -1):
        out[k] /= L[k, k]
        i = parent[k]
        while i >= 0:
            out[i] -= L[k, i] * out[k]
            i = parent[i]
    for k in range(n):
        x = out[k]
        i = parent[k]
        while i >= 0:
            x -= L[k, i] * out[i]
            i = parent[i]
        out[k] = x / L[k, k]
    for k in range(n):
        out[k] += v[k]


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
        self.parent = parent
        self.lower = np.empty(mass.shape)
        bad = _factor(mass, parent, self.lower)
        if bad:
            raise InputError(
                f"the mass matrix is not positive definite (row {bad - 1} of {len(mass)}): "
                "check masses, inertias and the coordinates' redundancy"
            )

    def apply(self, w: Array) -> Array:
        return self.lower.T @ (self.lower @ w)

    def whiten(self, w: Array) -> Array:
        return triangular(self.lower.T, w, 0)

    def unwhiten(self, y: Array) -> Array:
        return triangular(self.lower.T, y, 1)

    def solve_rows(self, rows: Array) -> Array:
        out = np.empty(rows.shape)
        solve(self.lower, self.parent, rows, out)
        return out

    def advance(self, v: Array, h: float, torque: Array, effects: Array) -> Array:
        """Return v + h M^-1 (torque - effects), shape (nv,)."""
        out = np.empty(len(v))
        if not v.flags.carray:
            v = plain_array(v)
        _advance(self.lower, self.parent, v, h, torque, effects, out)
        return out

    def dense(self) -> Array:
        return self.lower.T @ self.lower
