"""Kernels of accelerated projected Gauss-Seidel sweeps over sparse rows, island by island.

min |A u|^2 / 2 - d' u over u >= 0. A sweep makes each percussion optimal for the others, and keeps z = A u. The next
sweep does not start from its result, but from that plus a part of the change since the last result, with the parts of
Nesterov's method; where such a start turns out to lead uphill, the parts begin again from zero. Sweeps need neither the
Delassus matrix nor a factor, and their order matters little. To a residual of 1e-3 a few dozen suffice, whatever the
number of rows; to 1e-6 and below conjugate gradients are faster.

Notes
-----
B. O'Donoghue and E. Candes, Foundations of Computational Mathematics 15 (2015), 715-732, for the restart.
"""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ..metric import Array
from ..row_speeds import combine_rows
from .sparse_islands import _SMALL, sort_by_island

# sweeps over an island at most, and twice as many where the second half lowered the change of a sweep below this share
_SWEEPS, _FALLEN = 200, 0.3
# the residual after a sweep relative to the largest change in it, until it was computed once
_RATIO = 0.35
# a factor that differs less from one is rounding
_SCALED = 1e-12


@kernel("f8(f8[::1], u4[::1], u4[::1], f8[::1], f8[::1], f8[::1])")
def scaled_residual(data: Array, columns: Array, starts: Array, d: Array, z: Array, u: Array) -> float:
    """Scale u so that u' (A' A u - d) = 0, write z = A u and return max |min(u, A' z - d)|.

    The scaled u has the least energy of all multiples. Then |x + z|^2 = |x|^2 - |z|^2 + 2 u' c if d = c - A' x: where
    bounds c are not positive a projection never raises the kinetic energy, whatever the residual. The arguments are as
    of `accelerated_sweeps`.
    """
    combine_rows(data, columns, starts, u, z)
    gain, size, residual = 0.0, 0.0, 0.0
    for a in range(len(d)):
        gain += d[a] * u[a]
    for j in range(len(z)):
        size += z[j] * z[j]
    if abs(gain - size) > _SCALED * size:
        share = max(gain, 0.0) / size if size > 0.0 else 0.0
        for a in range(len(d)):
            u[a] *= share
        combine_rows(data, columns, starts, u, z)
    for a in range(len(d)):
        rate = -d[a]
        for k in range(starts[a], starts[a + 1]):
            rate += data[k] * z[columns[k]]
        residual = max(residual, abs(min(u[a], rate)))
    return residual


@kernel("UniTuple(f8, 2)(f8[::1], u4[::1], u4[::1], f8[::1], f8[::1], f8[::1], f8[::1])")
def sweep(data: Array, columns: Array, starts: Array, d: Array, last: Array, z: Array, u: Array) -> tuple[float, float]:
    """Make each u_a optimal for the others, one after the other; z = A u follows.

    Parameters
    ----------
    data, columns, starts, d, z, u
        See `accelerated_sweeps`; z = A u.
    last : ndarray, shape (m,)
        Percussions after the last sweep.

    Returns
    -------
    change : float
        The largest change of a percussion.
    uphill : float
        (before - after)' (after - last): positive where the extrapolation went too far.
    """
    change, uphill = 0.0, 0.0
    for a in range(len(d)):
        begin, end = starts[a], starts[a + 1]
        rate = -d[a]
        for k in range(begin, end):
            rate += data[k] * z[columns[k]]
        old = u[a]
        new = max(old - rate, 0.0)
        # rows that stay active nearly always step: the processor foresees this branch, but not whether a step is zero
        if old > 0.0 or new > 0.0:
            step = new - old
            for k in range(begin, end):
                z[columns[k]] += step * data[k]
            u[a] = new
            uphill -= step * (new - last[a])
            change = max(change, abs(step))
    return change, uphill


@kernel("void(f8[::1], u4[::1], u4[::1], f8, f8[::1], f8[::1], f8[::1], f8[::1])")
def extrapolate(
    data: Array, columns: Array, starts: Array, part: float, last_z: Array, last: Array, z: Array, u: Array
) -> None:
    """Move u by a part of its change since `last`, not below zero; z = A u follows, and `last` becomes u before."""
    for j in range(len(z)):
        now = z[j]
        z[j], last_z[j] = now + part * (now - last_z[j]), now
    for a in range(len(u)):
        now = u[a]
        moved, last[a] = now + part * (now - last[a]), now
        if moved < 0.0:
            for k in range(starts[a], starts[a + 1]):
                z[columns[k]] -= moved * data[k]
            moved = 0.0
        u[a] = moved


@kernel("f8(f8[::1], u4[::1], u4[::1], f8[::1], f8, i8, f8[::1], f8[::1])")
def accelerated_sweeps(
    data: Array, columns: Array, starts: Array, d: Array, target: float, most: int, z: Array, u: Array
) -> float:
    """Bring the natural residual max |min(u, A' A u - d)| down, starting at u; return what was reached.

    Parameters
    ----------
    data, columns, starts : ndarray, shapes (k,), (k,), (m + 1,)
        A', whose rows have unit length, row after row.
    d, u : ndarray, shape (m,)
        Violations; percussions to start from, which are written over.
    target : float
        The residual that is small enough.
    most : int
        How many sweeps at most; twice as many where the progress in the second half of them says that this suffices.
    z : ndarray, shape (n,)
        Receives A u.
    """
    residual, weight, ratio, part = scaled_residual(data, columns, starts, d, z, u), 1.0, _RATIO, 0.0
    last, last_z, limit, before = u.copy(), z.copy(), most, 0.0
    for number in range(2 * most):
        if residual <= target or number == limit:
            break
        if number > 0:
            extrapolate(data, columns, starts, part, last_z, last, z, u)
        change, uphill = sweep(data, columns, starts, d, last, z, u)
        part, following = 0.0, 0.5 * (1.0 + np.sqrt(1.0 + 4.0 * weight * weight))
        if uphill > 0.0:
            weight = 1.0
        else:
            part, weight = (weight - 1.0) / following, following
        if number == most // 2:
            before = change
        elif number == most - 1 and change < _FALLEN * before and ratio * change * (change / before) ** 2 <= target:
            limit = 2 * most
        # what the sweep changed tells roughly what the residual is, which costs another pass; it is computed from u,
        # for sums of changes drift
        if ratio * change <= target or number == limit - 1:
            residual = scaled_residual(data, columns, starts, d, z, u)
            if change == 0.0:
                break
            ratio = residual / change
    return residual


@kernel("void(f8[::1], u4[::1], u4[::1], i8, f8[::1], i8[::1], f8, b1[::1], f8[::1])")
def sweep_islands(
    data: Array, columns: Array, starts: Array, n: int, d: Array, label: Array, target: float, reached: Array, u: Array
) -> None:
    """Solve islands of more than `_SMALL` rows by accelerated sweeps, each for itself.

    Parameters
    ----------
    data, columns, starts, d, target, u
        See `accelerated_sweeps`.
    n : int
        Columns in all.
    label : ndarray of int, shape (m,)
        The island of each row.
    reached : ndarray of bool, shape (count,)
        Receives which islands were brought below the target.
    """
    m, count = len(d), len(reached)
    first, order, local = np.empty(count + 1, np.int64), np.empty(m, np.int64), np.empty(m, np.uint32)
    sort_by_island(label, first, order, local)
    own_starts, own_columns, own_data = np.empty(m + 1, np.uint32), np.empty(len(data), np.uint32), np.empty(len(data))
    place = np.full(n, -1, np.int64)
    for island in range(count):
        rows = order[first[island] : first[island + 1]]
        reached[island] = False
        if len(rows) <= _SMALL:
            continue
        size, entries = 0, 0
        own_starts[0] = 0
        for i in range(len(rows)):
            for k in range(starts[rows[i]], starts[rows[i] + 1]):
                if place[columns[k]] < 0:
                    place[columns[k]] = size
                    size += 1
                own_columns[entries], own_data[entries] = place[columns[k]], data[k]
                entries += 1
            own_starts[i + 1] = entries
        part = u[rows]
        residual = accelerated_sweeps(
            own_data[:entries], own_columns[:entries], own_starts[: len(rows) + 1], d[rows], target, _SWEEPS,
            np.empty(size), part,
        )  # fmt: skip
        reached[island] = residual <= target
        for i in range(len(rows)):
            u[rows[i]] = part[i]
