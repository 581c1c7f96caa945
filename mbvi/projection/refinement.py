"""The dual of a large projection to the end: rounds of `free_face`, and what few rows then miss.

Where rows depend on each other, a round that moves all of them spoils in one place what it settles in another. What
few rows still miss is settled among themselves and those that share a body with them, while the others stay: that
lowers the same energy.
"""

from __future__ import annotations

import numpy as np

from ..compiled import kernel
from .metric import Array
from .projected_pcg import rounds

# how often rounds are begun at most, and how many at once
_ROUNDS, _AT_ONCE = 2000, 10
# of the residual that is enough: from which multiple on rows are mended, from which share on a row is off, and what is
# left of that
_NEAR, _OFF, _LEFT = 100.0, 0.5, 0.3
# how often in a row, rows at most, rounds at most
_TRIES, _MOST, _MOST_ROUNDS = 3, 1000, 60


@kernel("b1(u4[::1], u4[::1], f8[::1], f8, f8[::1], f8[::1])")
def mend(starts: Array, columns: Array, G: Array, target: float, g: Array, u: Array) -> bool:
    """Settle the rows that are off, and those by them, while the others stay; return False where they are too many.

    Parameters
    ----------
    starts, columns, G, target, u
        As `rounds`; u is written over.
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
    if n == 0 or n > _MOST:
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
    rounds(own_starts, own_columns[:count], own[:count], d, _LEFT * target, 0.0, _MOST_ROUNDS, np.zeros(6), rates, part)
    for a in range(m):
        if local[a] >= 0:
            u[a] = part[local[a]]
    return True


@kernel("f8(u4[::1], u4[::1], f8[::1], f8[::1], f8, f8[::1])")
def relax(starts: Array, columns: Array, G: Array, d: Array, target: float, u: Array) -> float:
    """Bring the natural residual max |min(u, G u - d)| below a target, from where u is; return what was reached.

    Parameters
    ----------
    starts, columns, G, d, target, u
        As `rounds`.
    """
    g, state, near, residual = np.empty(len(d)), np.zeros(6), 0.0, np.inf
    for _ in range(_ROUNDS):
        residual = rounds(starts, columns, G, d, target, near, _AT_ONCE, state, g, u)
        near = _NEAR * target
        for _ in range(_TRIES):
            if not target < residual <= near or not mend(starts, columns, G, target, g, u):
                break
            residual = rounds(starts, columns, G, d, target, near, 0, state, g, u)
        if not residual > target:
            break
    return residual
