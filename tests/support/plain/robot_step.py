"""Plain numpy forms of the kernels in mbvi/projection/dense/robot_step.py."""

from __future__ import annotations

import numpy as np

from mbvi.arguments import Array
from mbvi.projection.dense.goldfarb_idnani import LAST_DIGITS
from mbvi.projection.dense.robot_step import _MARGIN, ROUNDING
from mbvi.projection.dense.scaled_qp import FAR
from support.plain.goldfarb_idnani import goldfarb_idnani_plain
from support.plain.shared_percussions import least_norm_plain
from support.plain.tree import advance_plain, factor_plain, solve_plain


def solve_active_set_plain(
    J: Array, A: Array, W: Array, x: Array, lower: Array, last: Array, limit: float, w: Array, table: Array
) -> float:
    """Write argmin |w - x|_M with J w >= lower; see `solve_active_set`."""
    p, speed, reached = table
    speed[:] = J @ x
    w[:], p[:], reached[:] = x, 0.0, speed
    violation, terms = lower - speed, np.abs(J) @ np.abs(x) + np.abs(lower)
    if (violation <= ROUNDING * terms).all():
        return 0.0
    lengths = np.sqrt(np.maximum((J * A).sum(axis=1), 0.0))
    if not (lengths > 0.0).all():
        return np.inf
    W /= lengths[:, None]
    (m, n), d = W.shape, violation / lengths
    speeds = (np.abs(speed) + np.abs(lower)) / lengths
    near = -d <= FAR * speeds[d > 0.0].max()
    largest = speeds[near].max()
    enough = max(ROUNDING, LAST_DIGITS * (terms / lengths)[near].max() / largest)
    most, z, slack, u = min(m, n) + 1, np.zeros(n), np.zeros(m), np.zeros(m)
    S, part, L, Q = np.zeros(most, int), np.zeros(most), np.zeros((most, most)), np.zeros((most, n))
    size, contradiction = goldfarb_idnani_plain(W, d, _MARGIN * enough * largest, 0, S, L, Q, part, z, slack)
    if size < 0:
        return -contradiction / largest
    tight = np.union1d(S[:size], np.flatnonzero(slack <= _MARGIN * enough * largest))
    basis, values, _ = np.linalg.svd(W[tight].T, full_matrices=False)
    basis = basis[:, values > 1e-8]
    if len(tight) == size or not least_norm_plain(W[tight] @ basis, len(tight), basis.shape[1], basis.T @ z, u):
        u[:size], tight = part[:size], S[:size]
    p[tight] = u[: len(tight)] / lengths[tight]
    w[:] = x + p @ A
    reached[:] = J @ w
    residual = np.abs(np.minimum(p * lengths, (reached - lower) / lengths)).max() / largest
    return float(residual) if residual <= max(enough, limit, 1e-12) else np.inf


def newton_law_plain(J: Array, v: Array, e: Array, opened: Array, lower: Array, rates: Array) -> None:
    """Write the least rates after an impact, -e J v, and the rates before; see `newton_law`."""
    rates[3] = J @ v
    lower[:] = -e * rates[3]
    if len(opened):
        stays = (opened > 0.0) & (rates[3] > -opened)
        lower[stays] = np.minimum(lower, -opened)[stays]


def _law_of_rows_plain(
    L: Array, parent: Array, x: Array, v: Array, J: Array, e: Array, opened: Array, last: Array, limit: float,
    w: Array, rates: Array,
) -> float:  # fmt: skip
    """Write argmin |w - x|_M with J w >= -e J v; see `law_of_rows`."""
    A, W, lower = np.empty(J.shape), np.empty(J.shape), np.empty(len(e))
    solve_plain(L, parent, J, W, A)
    newton_law_plain(J, v, e, opened, lower, rates)
    return solve_active_set_plain(J, A, W, x, lower, last, limit, w, rates[:3])


def _tree_law_plain(
    mass: Array, damping: Array, parent: Array, v: Array, h: float, torque: Array, effects: Array, twice: bool,
    J: Array, e: Array, opened: Array, last: Array, limit: float, w: Array, rates: Array,
) -> float:  # fmt: skip
    """Write argmin |w - x|_M with J w >= -e J v, where x is the free motion of one mechanism; see `tree_law`."""
    L, x = np.zeros(mass.shape), np.empty(len(v))
    if advance_plain(mass, damping, parent, v, h, torque, effects, twice, L[:0], L, np.empty((2, len(v))), x):
        return np.inf
    if factor_plain(mass, 0.0, damping, parent, L):
        return np.inf
    return _law_of_rows_plain(L, parent, x, v, J, e, opened, last, limit, w, rates)
