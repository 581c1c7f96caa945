"""Kernels that solve one large island: projected conjugate gradients, then refinement of the few rows that are off.

Where rows depend on each other, a round that moves all of them undoes in one place what it solves in another. The few
rows that are still off are solved together with those that share a body with them, while the others stay. That lowers
the same energy.
"""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ..metric import Array
from .projected_pcg import STATE_SIZE, projected_pcg

# calls of `projected_pcg` at most, and rounds of each
_CALLS, _ROUNDS = 2000, 10
# in multiples of the target: the residual below which subsets are refined, that of a row that is off, and the target of
# the subset
_NEAR, _OFF, _LEFT = 100.0, 0.5, 0.3
# subsets refined in a row, and rows and rounds of a subset at most
_TRIES, _MOST_ROWS, _MOST_ROUNDS = 3, 1000, 60


@kernel("b1(u4[::1], u4[::1], f8[::1], f8, f8[::1], f8[::1])")
def refine_subset(starts: Array, columns: Array, G: Array, target: float, g: Array, u: Array) -> bool:
    """Solve the rows that are off and those that share a body with them; return False where they are too many.

    Parameters
    ----------
    starts, columns, G, target, u
        As `projected_pcg`; u is written over.
    g : ndarray, shape (m,)
        G u - d.
    """
    m, n, room = len(u), 0, 0
    local = np.full(m, -1, np.int64)
    for a in range(m):
        if abs(min(u[a], g[a])) > _OFF * target:
            for k in range(starts[a], starts[a + 1]):
                local[columns[k]] = 0
    for a in range(m):
        if local[a] == 0:
            local[a] = n
            n += 1
            room += starts[a + 1] - starts[a]
    if n == 0 or n > _MOST_ROWS:
        return False
    own_starts, own_columns, own = np.empty(n + 1, np.uint32), np.empty(room, np.uint32), np.empty(room)
    d, part, rates, count = np.empty(n), np.empty(n), np.empty(n), 0
    own_starts[0] = 0
    for a in range(m):
        i = local[a]
        if i >= 0:
            part[i], value = u[a], -g[a]
            for k in range(starts[a], starts[a + 1]):
                j = local[columns[k]]
                if j >= 0:
                    own_columns[count], own[count] = j, G[k]
                    value += G[k] * u[columns[k]]
                    count += 1
            d[i], own_starts[i + 1] = value, count
    projected_pcg(
        own_starts,
        own_columns[:count],
        own[:count],
        d,
        _LEFT * target,
        0.0,
        _MOST_ROUNDS,
        np.zeros(STATE_SIZE),
        rates,
        part,
    )
    for a in range(m):
        if local[a] >= 0:
            u[a] = part[local[a]]
    return True


@kernel("f8(u4[::1], u4[::1], f8[::1], f8[::1], f8, f8[::1])")
def solve_island(starts: Array, columns: Array, G: Array, d: Array, target: float, u: Array) -> float:
    """Bring the natural residual max |min(u, G u - d)| below a target, starting at u; return what was reached.

    Parameters
    ----------
    starts, columns, G, d, target, u
        As `projected_pcg`.
    """
    g, state, residual, near = np.empty(len(d)), np.zeros(STATE_SIZE), np.inf, _NEAR * target
    for _ in range(_CALLS):
        residual = projected_pcg(starts, columns, G, d, target, near, _ROUNDS, state, g, u)
        for _ in range(_TRIES):
            if not target < residual <= near or not refine_subset(starts, columns, G, target, g, u):
                break
            residual = projected_pcg(starts, columns, G, d, target, near, 0, state, g, u)
        if not residual > target:
            break
    return residual
