"""Plain numpy forms of the kernels in mbvi/projection/tree.py."""

from __future__ import annotations

import numpy as np

from mbvi.arguments import Array


def factor_plain(mass: Array, h: float, damping: Array, parent: Array, L: Array) -> int:
    """Write L with L'L = M + h D; return 0, or one plus a row where that turns out not to be positive definite."""
    lower = np.tril(mass)
    M = lower + np.tril(lower, -1).T + h * np.diag(damping)
    if not np.isfinite(M).all():
        return 1
    try:
        L[:] = np.linalg.cholesky(M[::-1, ::-1]).T[::-1, ::-1]
    except np.linalg.LinAlgError:
        return 1
    return 0


def _whiten_plain(L: Array, parent: Array, x: Array) -> None:
    """Overwrite x, shape (nv,), by L'^-1 x."""
    x[:] = np.linalg.solve(L.T, x)


def _unwhiten_plain(L: Array, parent: Array, x: Array) -> None:
    """Overwrite x, shape (nv,), by L^-1 x."""
    x[:] = np.linalg.solve(L, x)


def solve_plain(L: Array, parent: Array, rows: Array, whitened: Array, out: Array) -> None:
    """Write L'^-1 r and (L'L)^-1 r for every row r, shapes (m, nv)."""
    whitened[:] = np.linalg.solve(L.T, rows.T).T
    out[:] = np.linalg.solve(L, whitened.T).T


def advance_plain(
    mass: Array, damping: Array, parent: Array, v: Array, h: float, torque: Array, effects: Array, L: Array, out: Array
) -> int:
    """Write v + (M + h D)^-1 h (torque - effects - D v) and the factor of M + h D; return as `factor_plain`."""
    bad = factor_plain(mass, h, damping, parent, L)
    if not bad:
        out[:] = v + np.linalg.solve(L, np.linalg.solve(L.T, h * (torque - effects - damping * v)))
    return bad
