"""Plain numpy forms of the kernels in mbvi/projection/robot_step.py."""

from __future__ import annotations

import numpy as np

from mbvi.arguments import Array
from mbvi.projection.nonnegative import ROUNDING
from mbvi.projection.robot_step import _LAST_DIGITS, _REFINEMENTS, _TOUCHING
from support.plain.nonnegative import dual_active_set_plain, solve_equalities_plain
from support.plain.tree import advance_plain, factor_plain, solve_plain


def solve_active_set_plain(J: Array, A: Array, x: Array, lower: Array, last: Array, w: Array, table: Array) -> float:
    """Write argmin |w - x|_M with J w >= lower, if the rows that press are found."""
    p, speed, reached = table
    speed[:] = J @ x
    w[:], p[:], reached[:] = x, 0.0, speed
    missing, terms = lower - speed, np.abs(J) @ np.abs(x) + np.abs(lower)
    if (missing <= ROUNDING * terms).all():
        return 0.0
    G = J @ A.T
    lengths = np.sqrt(np.maximum(G.diagonal(), 0.0))
    if not (lengths > 0.0).all():
        return np.inf
    largest = ((np.abs(speed) + np.abs(lower)) / lengths).max()
    enough = max(ROUNDING, _LAST_DIGITS * (terms / lengths).max() / largest)
    G, d = G / np.outer(lengths, lengths), missing / lengths
    nothing, u = np.zeros(len(d)), np.empty(len(d))
    for attempt in range(3):
        chosen, base = d > 0.0, nothing
        if attempt == 1:
            if len(last) != len(d):
                continue
            chosen, base = last > 0.0, last * lengths
        if attempt == 2 and not dual_active_set_plain(G, d, chosen):
            break
        if not solve_equalities_plain(G, d, chosen, base, u):
            continue
        for _ in range(1 + _REFINEMENTS):
            p[:] = u / lengths
            w[:] = x + p @ A
            reached[:] = J @ w
            slack = (reached - lower) / lengths
            residual = np.abs(np.minimum(u, slack)).max() / largest
            if residual <= enough:
                np.maximum(p, 0.0, out=p)
                # rows that touch without pressing may share the percussion: that is settled elsewhere
                alone = attempt < 2 or (slack[~chosen] > _TOUCHING * largest).all()
                return float(residual) if alone else np.inf
            correction = np.empty(len(d))
            solve_equalities_plain(G, -slack, chosen, nothing, correction)
            u += correction
    return np.inf


def newton_law_plain(J: Array, v: Array, e: Array, lower: Array, rates: Array) -> None:
    """Write the least rates after an impact, -e J v, and the rates before; see `newton_law`."""
    rates[3] = J @ v
    lower[:] = -e * rates[3]


def _tree_law_plain(
    mass: Array, damping: Array, parent: Array, v: Array, h: float, torque: Array, effects: Array, J: Array, e: Array,
    last: Array, w: Array, rates: Array,
) -> float:  # fmt: skip
    """Write argmin |w - x|_M with J w >= -e J v, where x is the free motion of one mechanism; see `tree_law`."""
    L, x, A = np.empty(mass.shape), np.empty(len(v)), np.empty(J.shape)
    if advance_plain(mass, damping, parent, v, h, torque, effects, L, x):
        return np.inf
    if factor_plain(mass, 0.0, damping, parent, L):
        return np.inf
    solve_plain(L, parent, J, A)
    lower = np.empty(len(e))
    newton_law_plain(J, v, e, lower, rates)
    return solve_active_set_plain(J, A, x, lower, last, w, rates[:3])
