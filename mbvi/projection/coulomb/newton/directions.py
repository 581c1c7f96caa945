"""Kernels of one step of Newton's method: the equations of given cases, in percussions or in velocities."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ....compiled import kernel, record
from ...metric import Array
from .cases import OPEN, SLIP

# multiplications for each pair of entries of a contact's rows, relative to those of eliminations
_ASSEMBLY = 9.0


@record("f8[:,::1], f8[:,::1], f8[:,::1], f8[::1], f8")
class Delassus(NamedTuple):
    """The matrix of a law, and what it is made of.

    Attributes
    ----------
    G : ndarray, shape (n, n), n = 3 m
        Positive semidefinite with unit normal entries, symmetric but for contacts that are bounded by others.
    J, A : ndarray, shape (n, nv) or (0, 0)
        Rows of the contacts, and M^-1 times each of them: G is J A' in the scales of contacts, and the compliance on
        its diagonal. Of no size where it is not of this form.
    scale : ndarray, shape (m,) or (0,)
        The scale of each contact.
    compliance : float
        That on the diagonal of G.
    """

    G: Array
    J: Array
    A: Array
    scale: Array
    compliance: float


@kernel("Delassus(f8[:,::1])")
def without_rows(G: Array) -> Delassus:
    """Return a matrix of which no rows are known."""
    return Delassus(G, np.empty((0, 0)), np.empty((0, 0)), np.empty(0), 0.0)


@kernel("Delassus(Delassus, f8)")
def soften(law: Delassus, compliance: float) -> Delassus:
    """Return the matrix of a law with the same compliance more at all contacts."""
    H = law.G.copy()
    for i in range(len(H)):
        H[i, i] += compliance
    return Delassus(H, law.J, law.A, law.scale, law.compliance + compliance)


@kernel("b1(f8[:,::1], f8[::1], i8)")
def solve_linear(A: Array, y: Array, n: int) -> bool:
    """Overwrite n entries of y by A^-1 y, and A by its factors; False if A is singular."""
    # behind the last entry of each row that is not zero: contacts of different bodies are not coupled
    end = np.empty(n, np.int64)
    for i in range(n):
        end[i] = n
        while end[i] > 0 and A[i, end[i] - 1] == 0.0:
            end[i] -= 1
    for k in range(n):
        pivot = k
        for i in range(k + 1, n):
            if abs(A[i, k]) > abs(A[pivot, k]):
                pivot = i
        # written so that a NaN is refused too
        if not abs(A[pivot, k]) > 1e-300:
            return False
        if pivot != k:
            y[k], y[pivot] = y[pivot], y[k]
            end[k], end[pivot] = end[pivot], end[k]
            for j in range(k, n):
                A[k, j], A[pivot, j] = A[pivot, j], A[k, j]
        # two rows at once: the row of the pivot is read half as often
        for i in range(k + 1, n - 1, 2):
            a, b = A[i, k] / A[k, k], A[i + 1, k] / A[k, k]
            if a != 0.0 or b != 0.0:
                y[i], y[i + 1] = y[i] - a * y[k], y[i + 1] - b * y[k]
                end[i], end[i + 1] = max(end[i], end[k]), max(end[i + 1], end[k])
                for j in range(k + 1, end[k]):
                    A[i, j], A[i + 1, j] = A[i, j] - a * A[k, j], A[i + 1, j] - b * A[k, j]
        if (n - k) % 2 == 0:
            a = A[n - 1, k] / A[k, k]
            y[n - 1] -= a * y[k]
            end[n - 1] = max(end[n - 1], end[k])
            for j in range(k + 1, end[k]):
                A[n - 1, j] -= a * A[k, j]
    for k in range(n - 1, -1, -1):
        for j in range(k + 1, end[k]):
            y[k] -= A[k, j] * y[j]
        y[k] /= A[k, k]
    return True


@kernel("UniTuple(f8, 8)(f8[::1], f8[::1], f8, f8, i8, i8)")
def tangential_rates(
    u: Array, p: Array, mu: float, scale: float, case: int, i: int
) -> tuple[float, float, float, float, float, float, float, float]:
    """Return how the error of the tangents of a closed contact, whose normal is row i, changes with its u and p.

    These are the entries 11, 12, 22 of the symmetric rates by u_t, and by p_t, and both rates by u_n, of which those by
    p_n are the negatives; `mu`, `scale` and `case` are those of the contact.
    """
    if case != SLIP:
        return scale, 0.0, scale, 0.0, 0.0, 0.0, 0.0, 0.0
    x, z = p[i + 1] - scale * u[i + 1], p[i + 2] - scale * u[i + 2]
    length = max(np.sqrt(x * x + z * z), 1e-300)
    x, z = x / length, z / length
    f = mu * (p[i] - u[i]) / length
    t11, t12, t22 = scale * f * (1.0 - x * x), -scale * f * x * z, scale * f * (1.0 - z * z)
    return t11, t12, t22, 1.0 - f * (1.0 - x * x), f * x * z, 1.0 - f * (1.0 - z * z), mu * x, mu * z


@kernel("void(f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], i8[::1], f8, i8, f8[:,::1], f8[::1])")
def eliminate_contact(
    u: Array, p: Array, mu: Array, scale: Array, error: Array, case: Array, soft: float, a: int, block: Array,
    step: Array,
) -> None:  # fmt: skip
    """Solve the equations of a contact for its own percussion, whose step is `step[3 a : 3 a + 3]` - block du.

    Parameters
    ----------
    u, p, mu, scale, error, case
        See `newton_direction`.
    soft : float
        Compliance and shift: its velocity changes by du and this times the step of its percussion.
    a : int
        The contact. The percussions of one that is open, and others that are known, have steps already.
    block : ndarray, shape (3, 3)
        Receives the above.
    step : ndarray, shape (n,)
        Receives the steps at du = 0.
    """
    i = 3 * a
    for r in range(3):
        for c in range(3):
            block[r, c] = 0.0
    if case[a] == OPEN:
        return
    if mu[a] < 0.0:
        # the friction of a joint: its velocity vanishes, or its percussion is known
        slips = case[a] == SLIP
        block[1, 1] = 0.0 if slips else 1.0 / soft
        step[i + 1] = -error[i + 1] if slips else -error[i + 1] / (scale[a] * soft)
        return
    block[0, 0], step[i] = 1.0 / soft, -error[i] / soft
    if mu[a] == 0.0:
        return
    t11, t12, t22, s11, s12, s22, d1, d2 = tangential_rates(u, p, mu[a], scale[a], case[a], i)
    k11, k12, k22 = soft * t11 + s11, soft * t12 + s12, soft * t22 + s22
    det = k11 * k22 - k12 * k12
    k11, k12, k22 = k22 / det, -k12 / det, k11 / det
    y, z = -error[i + 1] - (soft - 1.0) * d1 * step[i], -error[i + 2] - (soft - 1.0) * d2 * step[i]
    step[i + 1], step[i + 2] = k11 * y + k12 * z, k12 * y + k22 * z
    block[1, 0], block[2, 0] = (k11 * d1 + k12 * d2) / soft, (k12 * d1 + k22 * d2) / soft
    block[1, 1], block[1, 2] = k11 * t11 + k12 * t12, k11 * t12 + k12 * t22
    block[2, 1], block[2, 2] = k12 * t11 + k22 * t12, k12 * t12 + k22 * t22


@kernel("i8(f8[:,::1], f8[:,::1], i8, f8, f8[:,::1], i8[:,::1], f8[:,::1], f8[:,::1])")
def add_contact(J: Array, A: Array, i: int, scale: float, block: Array, runs: Array, product: Array, N: Array) -> int:
    """Add A' block J of one contact in its scale to N, shape (nv, nv); its normal is row i.

    `runs`, shape (nv, 2), receives where runs of columns begin and end in which its rows are not zero, and how many
    there are is returned. `product`, shape (3, nv), is overwritten.
    """
    nv, count, inside = J.shape[1], 0, False
    # a contact moves few of many bodies
    for k in range(nv):
        acts = J[i, k] != 0.0 or J[i + 1, k] != 0.0 or J[i + 2, k] != 0.0
        if acts and not inside:
            runs[count, 0] = k
            count += 1
        if acts:
            runs[count - 1, 1] = k + 1
            for r in range(3):
                sum_of_three = block[r, 0] * J[i, k] + block[r, 1] * J[i + 1, k] + block[r, 2] * J[i + 2, k]
                product[r, k] = scale * scale * sum_of_three
        inside = acts
    for j in range(nv):
        x, y, z = A[i, j], A[i + 1, j], A[i + 2, j]
        if x != 0.0 or y != 0.0 or z != 0.0:
            for n in range(count):
                for k in range(runs[n, 0], runs[n, 1]):
                    N[j, k] += x * product[0, k] + y * product[1, k] + z * product[2, k]
    return count


@kernel("b1(Delassus, i8[::1], i8)")
def takes_fewer_velocities(law: Delassus, case: Array, unknowns: int) -> bool:
    """Return whether it takes less time to solve for velocities than for so many percussions."""
    nv, pairs = law.J.shape[1], 0
    if unknowns <= nv:
        return False
    for a in range(len(case)):
        acts = moves = 0
        for k in range(nv if case[a] != OPEN else 0):
            acts += law.J[3 * a, k] != 0.0
            moves += law.A[3 * a, k] != 0.0
        pairs += acts * moves
    return unknowns**3 > nv**3 + _ASSEMBLY * pairs


@kernel("b1(Delassus, f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], i8[::1], f8, f8[::1])")
def direction_by_velocities(
    law: Delassus, u: Array, p: Array, mu: Array, scale: Array, error: Array, case: Array, soft: float, step: Array
) -> bool:
    """Write the Newton step by the change z = A' step of the velocities, of which there are fewer than percussions.

    With the step of each contact for a given z, (I + A' D J) z = A' step_0 is left, where D has the blocks of
    `eliminate_contact`. The arguments are those of `newton_direction`; `step` holds the steps of percussions that are
    known, and zeros.
    """
    J, A, m = law.J, law.A, len(mu)
    nv = J.shape[1]
    N, z, blocks = np.zeros((nv, nv)), np.zeros(nv), np.empty((m, 3, 3))
    runs, counts, product = np.empty((m, nv, 2), np.int64), np.zeros(m, np.int64), np.empty((3, nv))
    for k in range(nv):
        N[k, k] = 1.0
    for a in range(m):
        i, s = 3 * a, law.scale[a]
        eliminate_contact(u, p, mu, scale, error, case, soft, a, blocks[a], step)
        x, y, w = s * step[i], s * step[i + 1], s * step[i + 2]
        if x != 0.0 or y != 0.0 or w != 0.0:
            for k in range(nv):
                z[k] += x * A[i, k] + y * A[i + 1, k] + w * A[i + 2, k]
        if case[a] != OPEN:
            counts[a] = add_contact(J, A, i, s, blocks[a], runs[a], product, N)
    if not solve_linear(N, z, nv):
        return False
    for a in range(m):
        if case[a] == OPEN:
            continue
        i, s, block = 3 * a, law.scale[a], blocks[a]
        x = y = w = 0.0
        for n in range(counts[a]):
            for k in range(runs[a, n, 0], runs[a, n, 1]):
                x, y, w = x + J[i, k] * z[k], y + J[i + 1, k] * z[k], w + J[i + 2, k] * z[k]
        for r in range(3):
            step[i + r] -= s * (block[r, 0] * x + block[r, 1] * y + block[r, 2] * w)
    return True


@kernel("b1(Delassus, f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], i8[::1], f8, f8[:,::1], f8[::1], i8[::1], f8[::1])")
def newton_direction(
    law: Delassus, u: Array, p: Array, mu: Array, scale: Array, error: Array, case: Array, shift: float, K: Array,
    y: Array, place: Array, step: Array,
) -> bool:  # fmt: skip
    """Write the Newton step of the equations of given cases; False if their matrix is singular.

    The percussions of open contacts and, without friction, those of tangents are no unknowns: they become 0.

    Parameters
    ----------
    law, u, p, mu, scale, error, case
        See `newton_coulomb`.
    shift : float
        Added to the diagonal of G in the derivative only.
    K, y, place : ndarray, shapes (n, n), (n,) and (n,)
        Overwritten.
    step : ndarray, shape (n,)
        Receives the step of p.
    """
    G, m, n, k = law.G, len(mu), len(p), 0
    for a in range(m):
        for j in range(3 * a, 3 * a + 3):
            if case[a] != OPEN and (mu[a] > 0.0 or j == (3 * a if mu[a] == 0.0 else 3 * a + 1)):
                place[k], step[j] = j, 0.0
                k += 1
            elif mu[a] < 0.0 and j == 3 * a:
                step[j] = -u[j] / G[j, j]
            else:
                step[j] = -p[j]
    soft = law.compliance + shift
    if soft > 0.0 and len(law.J) > 0 and takes_fewer_velocities(law, case, k):
        return direction_by_velocities(law, u, p, mu, scale, error, case, soft, step)
    r = 0
    while r < k:
        i = place[r]
        a = i // 3
        if mu[a] < 0.0:
            # the friction of a joint: its velocity vanishes, or its percussion is known
            slips, known = case[a] == SLIP, 0.0
            for j in range(n):
                known += G[i, j] * step[j]
            y[r] = -error[i] - (0.0 if slips else scale[a] * known)
            for c in range(k):
                K[r, c] = 0.0 if slips else scale[a] * G[i, place[c]]
            K[r, r] += 1.0 if slips else scale[a] * shift
            r += 1
            continue
        # what the known steps change
        o0 = o1 = o2 = 0.0
        for j in range(n):
            if step[j] != 0.0:
                o0, o1, o2 = o0 + G[i, j] * step[j], o1 + G[i + 1, j] * step[j], o2 + G[i + 2, j] * step[j]
        y[r] = -error[i] - o0
        if mu[a] == 0.0:
            for c in range(k):
                K[r, c] = G[i, place[c]]
            K[r, r] += shift
            r += 1
            continue
        t11, t12, t22, s11, s12, s22, d1, d2 = tangential_rates(u, p, mu[a], scale[a], case[a], i)
        y[r + 1] = -error[i + 1] - t11 * o1 - t12 * o2 - d1 * o0
        y[r + 2] = -error[i + 2] - t12 * o1 - t22 * o2 - d2 * o0
        for c in range(k):
            j = place[c]
            g0, g1, g2 = G[i, j], G[i + 1, j], G[i + 2, j]
            if c == r:
                g0 += shift
            elif c == r + 1:
                g1 += shift
            elif c == r + 2:
                g2 += shift
            K[r, c] = g0
            K[r + 1, c] = t11 * g1 + t12 * g2 + d1 * g0
            K[r + 2, c] = t12 * g1 + t22 * g2 + d2 * g0
        K[r + 1, r], K[r + 2, r] = K[r + 1, r] - d1, K[r + 2, r] - d2
        K[r + 1, r + 1], K[r + 1, r + 2] = K[r + 1, r + 1] + s11, K[r + 1, r + 2] + s12
        K[r + 2, r + 1], K[r + 2, r + 2] = K[r + 2, r + 1] + s12, K[r + 2, r + 2] + s22
        r += 3
    if not solve_linear(K, y, k):
        return False
    for c in range(k):
        step[place[c]] = y[c]
    return True
