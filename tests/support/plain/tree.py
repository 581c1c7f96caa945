"""Plain numpy forms of the kernels in mbvi/projection/tree.py."""

from __future__ import annotations

import numpy as np

from mbvi.arguments import Array


def factor_mass_plain(mass: Array, h: float, damping: Array, parent: Array, L: Array) -> int:
    """Write L with L'L = M + h D; return 0, or one plus a row where that turns out not to be positive definite."""
    n = len(parent)
    lower = np.tril(mass[:n])
    M = lower + np.tril(lower, -1).T + h * np.diag(damping)
    if not np.isfinite(M).all():
        return 1
    try:
        dense = np.linalg.cholesky(M[::-1, ::-1]).T[::-1, ::-1]
    except np.linalg.LinAlgError:
        return 1
    for k in range(n):
        i = k
        while i >= 0:
            L[k, i] = dense[k, i]
            i = parent[i]
    return 0


def _whole(L: Array, n: int) -> Array:
    """Return the factor with zeros in the entries that are not written."""
    return np.nan_to_num(L[:n])


def factor_plain(mass: Array, h: float, damping: Array, parent: Array, L: Array) -> int:
    """Write the same, and behind it an orthonormal basis of the whitened rows of equalities."""
    bad, n = factor_mass_plain(mass, h, damping, parent, L), len(parent)
    if not bad and len(mass) > n:
        _, sizes, axes = np.linalg.svd(np.linalg.solve(_whole(L, n).T, mass[n:].T).T, full_matrices=False)
        L[n:] = 0.0
        L[n : n + len(axes)] = np.where(sizes[:, None] > 1e-9 * sizes[0], axes, 0.0)
    return bad


def _held(L: Array, rows: Array) -> Array:
    """Return whitened rows without their parts along equalities."""
    basis = L[rows.shape[-1] :]
    return rows - rows @ basis.T @ basis


def _whiten_plain(L: Array, parent: Array, x: Array) -> None:
    """Overwrite x, shape (nv,), by L'^-1 x."""
    x[:] = np.linalg.solve(L[: len(x)].T, x)


def _unwhiten_plain(L: Array, parent: Array, x: Array) -> None:
    """Overwrite x, shape (nv,), by L^-1 x."""
    x[:] = np.linalg.solve(L[: len(x)], x)


def solve_plain(L: Array, parent: Array, rows: Array, whitened: Array, out: Array) -> None:
    """Write L'^-1 r and (L'L)^-1 r for every row r, shapes (m, nv); without their parts along equalities."""
    n = rows.shape[1]
    whitened[:] = _held(L, np.linalg.solve(L[:n].T, rows.T).T)
    out[:] = np.linalg.solve(L[:n], whitened.T).T


def advance_plain(
    mass: Array, damping: Array, parent: Array, v: Array, h: float, torque: Array, effects: Array, twice: bool,
    known: Array, L: Array, changes: Array, out: Array,
) -> int:  # fmt: skip
    """Write the velocity after implicit steps: one of h, or 2 E^3(v) - E^4(v) of steps E of h / 2; see `advance_by`."""
    time = 0.5 * h if twice and damping.any() else h
    bad, n = factor_plain(mass, time, damping, parent, L), len(v)
    if not bad:
        ends = [v]
        for _ in range(4):
            w = ends[-1]
            ends.append(w + np.linalg.solve(_whole(L, n).T @ _whole(L, n), time * (torque - effects - damping * w)))
        out[:] = ends[1]
        if time != h:
            before, last = 2.0 * (ends[3] - ends[2]), 2.0 * (ends[4] - ends[3])
            out[:], changes[0], changes[1] = 2.0 * ends[3] - ends[4], last, before - last
            bad = factor_plain(mass, 0.0, damping, parent, L) if len(L) > n else 0
        if len(L) > n:
            # of a centred step the mean velocity keeps the equalities
            start = v if twice else np.zeros(n)
            out[:] = np.linalg.solve(_whole(L, n), _held(L, _whole(L, n) @ (out + start))) - start
    return bad
