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


def _damp_plain(L: Array, damping: Array, parent: Array, time: float, x: Array) -> None:
    """Overwrite a velocity, shape (nv,), by (L'L)^-1 time D x."""
    x[:] = np.linalg.solve(L.T @ L, time * damping * x)


def advance_plain(
    mass: Array, damping: Array, parent: Array, v: Array, h: float, torque: Array, effects: Array, twice: bool,
    L: Array, changes: Array, out: Array,
) -> int:  # fmt: skip
    """Write the velocity after implicit steps: one of h, or 2 E^3(v) - E^4(v) of steps E of h / 2; see `advance_by`."""
    time = 0.5 * h if twice and damping.any() else h
    bad = factor_plain(mass, time, damping, parent, L)
    if not bad:
        ends = [v]
        for _ in range(4):
            w = ends[-1]
            ends.append(w + np.linalg.solve(L.T @ L, time * (torque - effects - damping * w)))
        out[:] = ends[1]
        if time != h:
            before, last = 2.0 * (ends[3] - ends[2]), 2.0 * (ends[4] - ends[3])
            out[:], changes[0], changes[1] = 2.0 * ends[3] - ends[4], last, before - last
    return bad
