"""The dual of a large projection, min u' G u / 2 - d' u over u >= 0: sweeps, and conjugate gradients on what presses.

A sweep of Gauss-Seidel finds which rows press; on these the equations are solved by conjugate gradients with an
incomplete Cholesky factor; the way there is cut where percussions would pull. That alone stalls where about as many
rows press as there are velocities: a shift of the diagonal, raised when a way is cut and lowered when it is not, keeps
the steps short there. `mending` has what goes on where few rows are left.
"""

from __future__ import annotations

import numpy as np

from ..compiled import kernel
from .incomplete_cholesky import incomplete_cholesky, solve_factor
from .metric import Array

# steps of conjugate gradients a round, how much of the residual they leave
_STEPS, _LEFT = 200, 0.1
# sweeps a round; after so many rounds that did not halve the residual they wait until a way is not cut; after the third
# number of such rounds the shift starts anew, for where it was raised long ago the steps stay short for good; and after
# the last, once, all of it from nothing: percussions that are carried along may stress what depends on each other more
# and more, up to a thousand times what is needed
_SWEEPS, _PATIENCE, _ANEW, _FROM_NOTHING = 2, 2, 8, 64
# the least that is added to the diagonal of the factor where a pivot is lost
_STIFFER = 1e-2
# the shift at first, at least and at most, and how it changes
_SHIFT, _LEAST_SHIFT, _MOST_SHIFT, _LOWER, _RAISE = 1e-4, 1e-10, 1e-3, 0.2, 2.0


@kernel("f8(u4[::1], u4[::1], f8[::1], f8[::1], f8, f8, i8, f8[::1], f8[::1], f8[::1])")
def rounds(
    starts: Array,
    columns: Array,
    G: Array,
    d: Array,
    target: float,
    near: float,
    most: int,
    state: Array,
    g: Array,
    u: Array,
) -> float:
    """Bring the natural residual max |min(u, G u - d)| down, from where u is; return what was reached.

    Parameters
    ----------
    starts, columns, G : ndarray, shapes (m + 1,), (k,), (k,)
        Scaled Delassus matrix, row after row, columns ascending; its diagonal is 1.
    d, u : ndarray, shape (m,)
        Missing rates; percussions to start from, which are written over.
    target, near : float
        The residual that is enough, and one that is enough after a round.
    most : int
        How many rounds at most.
    state : ndarray, shape (6,)
        Zeros at first; receives what the next call goes on from: shift, what is added to the factor, least residual so
        far, rounds in vain since, the last share of a way, and whether percussions were carried along.
    g : ndarray, shape (m,)
        Receives G u - d.

    Notes
    -----
    This form is the accelerated projected gradient with restarts, whatever is near and however many rounds there may
    be: slow, and enough to compare with.
    """
    m = len(d)
    way = np.empty(m)
    face, local = np.empty(m, np.uint32), np.empty(m, np.int32)
    # the matrix of the face, and its factor
    room = len(G)
    inner_starts, inner_columns, inner = np.empty(m + 1, np.uint32), np.empty(room, np.uint32), np.empty(room)
    rows, places, L = np.empty(m + 1, np.uint32), np.empty((room + m) // 2, np.uint32), np.empty((room + m) // 2)
    r, y, s, q, x = np.empty(m), np.empty(m), np.empty(m), np.empty(m), np.empty(m)
    if state[0] == 0.0:
        state[0], state[2], state[4], state[5] = _SHIFT, np.inf, 1.0, 1.0
    shift, stiffer, best, vain, whole, carried = state[0], state[1], state[2], int(state[3]), state[4], state[5] > 0.0
    for number in range(most + 1):
        # the gradient anew, for sums of changes drift
        residual = 0.0
        for a in range(m):
            value = -d[a]
            for k in range(starts[a], starts[a + 1]):
                value += G[k] * u[columns[k]]
            g[a] = value
            off = abs(min(u[a], value))
            # written so that a NaN stays
            if not off <= residual and residual == residual:
                residual = off
        if not residual > target or number == most or (number > 0 and not residual > near):
            break
        vain += 1
        if vain % _ANEW == 0:
            shift, stiffer = _SHIFT, 0.0
        if carried and vain >= _FROM_NOTHING:
            carried, residual, best, vain, whole = False, np.inf, np.inf, 0, 1.0
            for a in range(m):
                u[a], g[a] = 0.0, -d[a]
        if residual < 0.5 * best:
            best, vain = residual, 0
        # what a sweep lets press again may have been cut off for good reason: first the rest is to settle
        for sweep in range(_SWEEPS if whole >= 1.0 or vain < _PATIENCE else 0):
            for b in range(m):
                a = b if sweep % 2 == 0 else m - 1 - b
                step = max(-g[a], -u[a])
                if step != 0.0:
                    u[a] += step
                    for k in range(starts[a], starts[a + 1]):
                        g[columns[k]] += step * G[k]
        n, count = 0, 0
        for a in range(m):
            local[a] = -1
            if u[a] > 0.0:
                local[a], face[n] = n, a
                n += 1
        inner_starts[0] = 0
        largest = 0.0
        for i in range(n):
            a = face[i]
            for k in range(starts[a], starts[a + 1]):
                j = local[columns[k]]
                if j >= 0:
                    inner_columns[count], inner[count] = j, G[k]
                    count += 1
            inner_starts[i + 1] = count
            r[i], x[i] = -g[a], 0.0
            largest = max(largest, abs(r[i]))
        least = max(_LEFT * largest, 0.3 * target)
        if n > 0 and largest > 0.3 * target:
            more = max(shift, stiffer)
            while not incomplete_cholesky(
                inner_starts[: n + 1], inner_columns[:count], inner[:count], more, rows[: n + 1], places, L
            ):
                more = stiffer = max(3.0 * more, _STIFFER)
            last = 1.0
            for step_number in range(_STEPS):
                solve_factor(rows[: n + 1], places, L, r[:n], y[:n])
                product = 0.0
                for i in range(n):
                    product += r[i] * y[i]
                turned = product / last if step_number > 0 else 0.0
                last = product
                for i in range(n):
                    s[i] = y[i] + (turned * s[i] if step_number > 0 else 0.0)
                curvature = 0.0
                for i in range(n):
                    value = shift * s[i]
                    for k in range(inner_starts[i], inner_starts[i + 1]):
                        value += inner[k] * s[inner_columns[k]]
                    q[i] = value
                    curvature += value * s[i]
                if not curvature > 0.0:
                    break
                length, left = product / curvature, 0.0
                for i in range(n):
                    x[i] += length * s[i]
                    r[i] -= length * q[i]
                    left = max(left, abs(r[i]))
                if left <= least:
                    break
        # the whole way, or as much of it as lowers the energy: down to where the first percussion would pull, it does
        whole = 1.0
        for i in range(n):
            if x[i] < 0.0 and u[face[i]] + whole * x[i] < 0.0:
                whole = -u[face[i]] / x[i]
        share = 1.0
        while True:
            for i in range(n):
                way[i] = max(share * x[i], -u[face[i]])
            energy = 0.0
            for i in range(n):
                value = 0.0
                for k in range(inner_starts[i], inner_starts[i + 1]):
                    value += inner[k] * way[inner_columns[k]]
                energy += (g[face[i]] + 0.5 * value) * way[i]
            if energy < 0.0 or share <= whole:
                break
            share = max(0.5 * share, whole)
        if energy < 0.0:
            for i in range(n):
                u[face[i]] = max(u[face[i]] + way[i], 0.0)
        if whole >= 1.0:
            shift = max(_LOWER * shift, _LEAST_SHIFT)
        elif share < 1.0:
            shift = min(_RAISE * shift, _MOST_SHIFT)
    state[0], state[1], state[2], state[3], state[4], state[5] = shift, stiffer, best, vain, whole, carried
    return residual
