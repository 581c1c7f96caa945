"""Kernels for the dual of a large projection: Gauss-Seidel sweeps, and conjugate gradients on the active rows.

min u' G u / 2 - d' u over u >= 0, with gradient g = G u - d. A round has three parts. Sweeps of projected Gauss-Seidel
find the face, the rows with u > 0. The equations of the face are solved by conjugate gradients with an incomplete
Cholesky factor. The step from u to that solution is cut off where percussions would turn negative. Where about as many
rows are active as there are velocities, such rounds stall: a shift of the diagonal, raised when a step is shortened and
lowered when it is not, keeps the steps short there.
"""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ..metric import Array
from .incomplete_cholesky import incomplete_cholesky, solve_factor

# steps of conjugate gradients a round, and the share of the residual that they leave
_STEPS, _LEFT = 200, 0.1
# sweeps a round; after so many rounds that did not halve the residual they wait for a step that is not shortened; after
# each of the third number of such rounds the shift is reset, for steps stay short where it was raised long ago; after
# the last, once, u is set to zero: percussions of dependent rows that balance each other may have grown from step to
# step, up to a thousand times what is needed
_SWEEPS, _PATIENCE, _RESET, _FROM_ZERO = 2, 2, 8, 64
# the least that is added to the diagonal of the factor where a pivot is lost, and where it is given up: no entry of a
# row of G is above 1, so that only a NaN gets there
_STIFFER, _STIFFEST = 1e-2, 1e12
# the shift at first, at least and at most, and its factors
_SHIFT, _LEAST_SHIFT, _MOST_SHIFT, _LOWER, _RAISE = 1e-4, 1e-10, 1e-3, 0.2, 2.0
# places of the state that one call leaves to the next: the shift, what is added to the diagonal of the factor, the
# least residual so far, rounds since then, the part of the last step up to the first percussion that turns negative,
# and whether u may hold percussions of the last time step
STATE_SIZE = 6
_AT_SHIFT, _AT_EXTRA, _AT_BEST, _AT_STALLED, _AT_WHOLE, _AT_CARRIED = range(6)


@kernel("f8(u4[::1], u4[::1], f8[::1], f8[::1], f8[::1], f8[::1])")
def dual_residual(starts: Array, columns: Array, G: Array, d: Array, g: Array, u: Array) -> float:
    """Write g = G u - d and return max |min(u, g)|; the arguments are those of `projected_pcg`."""
    residual = 0.0
    for a in range(len(d)):
        value = -d[a]
        for k in range(starts[a], starts[a + 1]):
            value += G[k] * u[columns[k]]
        g[a] = value
        off = abs(min(u[a], value))
        # written so that a NaN stays
        if not off <= residual and residual == residual:
            residual = off
    return residual


@kernel("void(u4[::1], u4[::1], f8[::1], i8, f8[::1], f8[::1])")
def gauss_seidel(starts: Array, columns: Array, G: Array, sweeps: int, g: Array, u: Array) -> None:
    """Sweep over the rows, forwards and backwards by turns: each u_a becomes optimal for the others; g follows."""
    m = len(u)
    for sweep in range(sweeps):
        for b in range(m):
            a = b if sweep % 2 == 0 else m - 1 - b
            step = max(-g[a], -u[a])
            if step != 0.0:
                u[a] += step
                for k in range(starts[a], starts[a + 1]):
                    g[columns[k]] += step * G[k]


@kernel("i8(u4[::1], u4[::1], f8[::1], f8[::1], u4[::1], u4[::1], u4[::1], f8[::1])")
def restrict_to_face(
    starts: Array, columns: Array, G: Array, u: Array,
    face: Array, face_starts: Array, face_columns: Array, face_G: Array,
) -> int:  # fmt: skip
    """Write the rows with u > 0 and the part of G between them; return how many they are.

    Parameters
    ----------
    face, face_starts, face_columns, face_G : ndarray, shapes (m,), (m + 1,), (k,), (k,)
        Receive numbers of rows, and their matrix as `starts`, `columns` and `G` have the whole.
    """
    n, count, local = 0, 0, np.empty(len(u), np.int32)
    for a in range(len(u)):
        local[a] = -1
        if u[a] > 0.0:
            local[a], face[n] = n, a
            n += 1
    face_starts[0] = 0
    for i in range(n):
        a = face[i]
        for k in range(starts[a], starts[a + 1]):
            j = local[columns[k]]
            if j >= 0:
                face_columns[count], face_G[count] = j, G[k]
                count += 1
        face_starts[i + 1] = count
    return n


@kernel("f8(u4[::1], u4[::1], f8[::1], f8, f8, f8, f8[::1], f8[::1])")
def pcg_on_face(
    starts: Array, columns: Array, G: Array, shift: float, extra: float, least: float, r: Array, x: Array
) -> float:
    """Solve (G + shift) x = r by conjugate gradients, preconditioned by an incomplete Cholesky factor.

    Parameters
    ----------
    starts, columns, G : ndarray, shapes (n + 1,), (k,), (k,)
        Matrix of the face.
    shift, extra : float
        Added to the diagonal; the factor is that of G plus the larger of both.
    least : float
        The largest entry of the residual that is small enough.
    r, x : ndarray, shape (n,)
        Right-hand side, which becomes the residual, and the solution.

    Returns
    -------
    float
        `extra`, raised until no pivot of the factor was lost.
    """
    n, room = len(r), (len(G) + len(r)) // 2
    rows, places, L = np.empty(n + 1, np.uint32), np.empty(room, np.uint32), np.empty(room)
    y, s, q = np.empty(n), np.empty(n), np.empty(n)
    more = max(shift, extra)
    while not incomplete_cholesky(starts, columns, G, more, rows, places, L) and more < _STIFFEST:
        more = extra = max(3.0 * more, _STIFFER)
    last = 1.0
    for i in range(n):
        x[i] = 0.0
    for step_number in range(_STEPS):
        solve_factor(rows, places, L, r, y)
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
            for k in range(starts[i], starts[i + 1]):
                value += G[k] * s[columns[k]]
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
    return extra


@kernel("UniTuple(f8, 2)(u4[::1], u4[::1], f8[::1], u4[::1], f8[::1], f8[::1], f8[::1])")
def line_search(
    starts: Array, columns: Array, G: Array, face: Array, g: Array, x: Array, u: Array
) -> tuple[float, float]:
    """Move u on its face by as much of the step x, cut off at u = 0, as lowers u' G u / 2 - d' u.

    Parameters
    ----------
    starts, columns, G : ndarray, shapes (n + 1,), (k,), (k,)
        Matrix of the face.
    face : ndarray of int, shape (n,)
        Its rows.
    g, u : ndarray, shape (m,)
        Gradient, and percussions, which are written over.
    x : ndarray, shape (n,)
        The step.

    Returns
    -------
    whole : float
        The part of x up to the first percussion that would turn negative, at most 1.
    share : float
        The part of x that was cut off at zero and taken.
    """
    n, step = len(x), np.empty(len(x))
    whole = 1.0
    for i in range(n):
        if x[i] < 0.0 and u[face[i]] + whole * x[i] < 0.0:
            whole = -u[face[i]] / x[i]
    share = 1.0
    while True:
        for i in range(n):
            step[i] = max(share * x[i], -u[face[i]])
        energy = 0.0
        for i in range(n):
            value = 0.0
            for k in range(starts[i], starts[i + 1]):
                value += G[k] * step[columns[k]]
            energy += (g[face[i]] + 0.5 * value) * step[i]
        if energy < 0.0 or share <= whole:
            break
        share = max(0.5 * share, whole)
    if energy < 0.0:
        for i in range(n):
            u[face[i]] = max(u[face[i]] + step[i], 0.0)
    return whole, share


@kernel("f8(u4[::1], u4[::1], f8[::1], f8[::1], f8, f8, i8, f8[::1], f8[::1], f8[::1])")
def projected_pcg(
    starts: Array, columns: Array, G: Array, d: Array, target: float, near: float, most: int, state: Array,
    g: Array, u: Array,
) -> float:  # fmt: skip
    """Bring the natural residual max |min(u, G u - d)| down, starting at u; return what was reached.

    Parameters
    ----------
    starts, columns, G : ndarray, shapes (m + 1,), (k,), (k,)
        Scaled Delassus matrix, row after row, columns ascending; its diagonal is 1.
    d, u : ndarray, shape (m,)
        Violations; percussions to start from, which are written over.
    target, near : float
        The residual that is small enough, and one that is small enough after a round.
    most : int
        How many rounds at most.
    state : ndarray, shape (STATE_SIZE,)
        Zeros at first; what the next call goes on from.
    g : ndarray, shape (m,)
        Receives G u - d.
    """
    m, room = len(d), len(G)
    face, face_starts = np.empty(m, np.uint32), np.empty(m + 1, np.uint32)
    face_columns, face_G, r, x = np.empty(room, np.uint32), np.empty(room), np.empty(m), np.empty(m)
    if state[_AT_SHIFT] == 0.0:
        state[_AT_SHIFT], state[_AT_BEST], state[_AT_WHOLE], state[_AT_CARRIED] = _SHIFT, np.inf, 1.0, 1.0
    for number in range(most + 1):
        # computed from u, for sums of changes drift
        residual = dual_residual(starts, columns, G, d, g, u)
        if not residual > target or number == most or (number > 0 and not residual > near):
            break
        state[_AT_STALLED] += 1.0
        if state[_AT_STALLED] % _RESET == 0.0:
            state[_AT_SHIFT], state[_AT_EXTRA] = _SHIFT, 0.0
        if state[_AT_CARRIED] > 0.0 and state[_AT_STALLED] >= _FROM_ZERO:
            residual = np.inf
            state[_AT_BEST], state[_AT_STALLED], state[_AT_WHOLE], state[_AT_CARRIED] = np.inf, 0.0, 1.0, 0.0
            for a in range(m):
                u[a], g[a] = 0.0, -d[a]
        if residual < 0.5 * state[_AT_BEST]:
            state[_AT_BEST], state[_AT_STALLED] = residual, 0.0
        # a row that was cut off and that a sweep makes active again may be cut off again: first the others settle
        if state[_AT_WHOLE] >= 1.0 or state[_AT_STALLED] < _PATIENCE:
            gauss_seidel(starts, columns, G, _SWEEPS, g, u)
        n = restrict_to_face(starts, columns, G, u, face, face_starts, face_columns, face_G)
        count, largest = face_starts[n], 0.0
        for i in range(n):
            r[i], x[i] = -g[face[i]], 0.0
            largest = max(largest, abs(r[i]))
        starts_n, columns_n, G_n = face_starts[: n + 1], face_columns[:count], face_G[:count]
        if n > 0 and largest > 0.3 * target:
            least = max(_LEFT * largest, 0.3 * target)
            state[_AT_EXTRA] = pcg_on_face(
                starts_n, columns_n, G_n, state[_AT_SHIFT], state[_AT_EXTRA], least, r[:n], x[:n]
            )
        state[_AT_WHOLE], share = line_search(starts_n, columns_n, G_n, face[:n], g, x[:n], u)
        if state[_AT_WHOLE] >= 1.0:
            state[_AT_SHIFT] = max(_LOWER * state[_AT_SHIFT], _LEAST_SHIFT)
        elif share < 1.0:
            state[_AT_SHIFT] = min(_RAISE * state[_AT_SHIFT], _MOST_SHIFT)
    return residual
