"""Kernels of Coulomb's law: its residual, one contact solved exactly, and sweeps over all contacts.

Three rows belong to a contact: its normal and two tangents. G = J M^-1 J' and b are scaled so that each normal entry of
G is 1; p and u = G p + b are then both speeds. The law is K_mu ∋ p ⊥ (u_n + mu |u_t|, u_t) ∈ K_mu*, where
K_mu = {p : |p_t| <= mu p_n} and K_mu* is its dual cone. It has three cases: open (p = 0), stick (u = 0), and slip
(u_n = 0, p_t opposite to u_t and of the length mu p_n).

Dry friction of a joint is a contact with mu < 0: its normal is a velocity of its own that nothing else moves, with
G_nn = 1 and b_n < 0, so that p_n = -b_n is known and |p_t| <= -mu p_n; its second tangent is zero.

Torsional and rolling friction of a contact are contacts of their own, bounded by that one: their tangents are the
relative angular velocities, and their normal velocity is the difference of their normal percussion and that of the
contact which bounds them. Both are equal then, and |p_t| <= mu p_n. G is not symmetric in these normal rows.

V. Acary, B. Brogliato, Numerical Methods for Nonsmooth Dynamical Systems (2008), chapter 13.
"""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ..metric import Array

# relative to the larger eigenvalue: a tangential block with a smaller one counts as of rank one
_RANK = 1e-14
# relative accuracy of the length of the tangential percussion of a slipping contact
_ACCURACY = 4e-16
_MOST_STEPS = 60


@kernel("f8(f8[::1], f8[::1], f8[::1])")
def coulomb_defect(u: Array, p: Array, mu: Array) -> float:
    """Return the largest distance of a p_a from the projection of p_a - (u_n + mu |u_t|, u_t) onto its cone.

    Parameters
    ----------
    u, p : ndarray, shape (3 m,)
        Velocities and percussions of the contacts, both scaled to speeds.
    mu : ndarray, shape (m,)
        Coefficients of friction.
    """
    worst = 0.0
    for a in range(len(mu)):
        i = 3 * a
        if mu[a] < 0.0:
            bound = -mu[a] * (p[i] - u[i])
            off = np.sqrt(u[i] ** 2 + (p[i + 1] - min(max(p[i + 1] - u[i + 1], -bound), bound)) ** 2)
            if not off <= worst:
                worst = off
            continue
        slip = np.sqrt(u[i + 1] ** 2 + u[i + 2] ** 2)
        n, t, s = p[i] - u[i] - mu[a] * slip, p[i + 1] - u[i + 1], p[i + 2] - u[i + 2]
        across = np.sqrt(t * t + s * s)
        if n < 0.0 or across > mu[a] * n:
            if mu[a] * across <= -n:
                n = t = s = 0.0
            else:
                n = (n + mu[a] * across) / (1.0 + mu[a] * mu[a])
                t, s = mu[a] * n * t / across, mu[a] * n * s / across
            off = np.sqrt((p[i] - n) ** 2 + (p[i + 1] - t) ** 2 + (p[i + 2] - s) ** 2)
        else:
            # what is subtracted, also where rounding of a large percussion would hide it
            off = np.sqrt((u[i] + mu[a] * slip) ** 2 + slip * slip)
        # written so that a NaN stays
        if not off <= worst:
            worst = off
    return worst


@kernel("f8(f8[:,::1], f8[::1], f8[::1], f8[::1])")
def contact_velocities(G: Array, b: Array, p: Array, u: Array) -> float:
    """Write u = G p + b, all of shape (n,), and return the largest magnitude of an entry of b."""
    n, largest, even = len(b), 0.0, len(b) - len(b) % 6
    for i in range(n):
        largest = max(largest, abs(b[i]))
    # sums side by side wait less for each other
    for i in range(0, even, 6):
        x, y, z, r, s, t = b[i], b[i + 1], b[i + 2], b[i + 3], b[i + 4], b[i + 5]
        for j in range(n):
            q = p[j]
            if q != 0.0:
                x, y, z = x + G[i, j] * q, y + G[i + 1, j] * q, z + G[i + 2, j] * q
                r, s, t = r + G[i + 3, j] * q, s + G[i + 4, j] * q, t + G[i + 5, j] * q
        u[i], u[i + 1], u[i + 2], u[i + 3], u[i + 4], u[i + 5] = x, y, z, r, s, t
    for i in range(even, n, 3):
        x, y, z = b[i], b[i + 1], b[i + 2]
        for j in range(n):
            q = p[j]
            if q != 0.0:
                x, y, z = x + G[i, j] * q, y + G[i + 1, j] * q, z + G[i + 2, j] * q
        u[i], u[i + 1], u[i + 2] = x, y, z
    return largest


@kernel("void(f8, f8, f8, f8, f8[:,::1])")
def find_slip(first: float, second: float, bn: float, mu: float, table: Array) -> None:
    """Solve (A + s) p_t = -d with |p_t| = -mu (bn + k p_t) for s >= 0, in the axes of A.

    A safeguarded Newton iteration on the reciprocals of both sides, which are nearly linear in s.

    Parameters
    ----------
    first, second : float
        Eigenvalues of A; the first is the larger.
    bn, mu : float
        See above; bn < 0 < mu.
    table : ndarray, shape (3, 2)
        d and k; the last row receives p_t.
    """
    d1, d2, k1, k2 = table[0, 0], table[0, 1], table[1, 0], table[1, 1]
    tiny = _RANK * first
    low, s = 0.0, 0.0
    high = np.sqrt(d1 * d1 + d2 * d2) * (1.0 + mu * np.sqrt(k1 * k1 + k2 * k2)) / (-mu * bn)
    p1 = p2 = 0.0
    for _ in range(_MOST_STEPS):
        r1, r2 = 1.0 / (first + s), 1.0 / max(second + s, tiny)
        p1, p2 = -d1 * r1, -d2 * r2
        length, bound = np.sqrt(p1 * p1 + p2 * p2), -mu * (bn + k1 * p1 + k2 * p2)
        off = length - bound
        if off > 0.0:
            low = s
        else:
            high = s
        if abs(off) <= _ACCURACY * (length + abs(mu * bn)):
            break
        # derivatives by s
        shorter, less = -(p1 * p1 * r1 + p2 * p2 * r2) / length, mu * (k1 * p1 * r1 + k2 * p2 * r2)
        new = -1.0
        if bound > 0.0:
            slope = less / (bound * bound) - shorter / (length * length)
            if slope > 0.0:
                new = s - (1.0 / length - 1.0 / bound) / slope
        elif shorter < less:
            new = s - off / (shorter - less)
        if not low < new < high:
            new = 0.5 * (low + high) if low > 0.0 or high < 1e-3 * first else min(0.1 * high, first)
        if abs(new - s) <= 1e-16 * (first + s):
            break
        s = new
    table[2, 0], table[2, 1] = p1, p2


@kernel("void(f8[:,::1], i8, f8, f8, f8, f8, f8[::1])")
def solve_contact(G: Array, a: int, c0: float, c1: float, c2: float, mu: float, p: Array) -> None:
    """Write the percussion of one contact, shape (3,), which satisfies the law with u = G_aa p + c.

    The diagonal block G_aa is positive semidefinite. Where c0 < 0 there is a solution; where c0 >= 0 it is 0.
    """
    p[0] = p[1] = p[2] = 0.0
    if c0 >= 0.0:
        return
    i = 3 * a
    gn, g1, g2 = G[i, i], G[i, i + 1], G[i, i + 2]
    bn = c0 / gn
    if mu == 0.0:
        p[0] = -bn
        return
    if mu < 0.0:
        p[0], p[1] = -bn, min(max(-c1 / G[i + 1, i + 1], mu * -bn), mu * bn)
        return
    # u_n = 0 eliminates p_n = -(bn + (g1, g2) p_t / gn); what is left of the tangents is A p_t + d
    k1, k2 = g1 / gn, g2 / gn
    a11, a12, a22 = G[i + 1, i + 1] - g1 * k1, G[i + 1, i + 2] - g1 * k2, G[i + 2, i + 2] - g2 * k2
    e1, e2 = c1 - g1 * bn, c2 - g2 * bn
    mean, half = 0.5 * (a11 + a22), 0.5 * (a11 - a22)
    spread, x, y = np.sqrt(half * half + a12 * a12), 1.0, 0.0
    if spread > _RANK * mean:
        x, y = (half + spread, a12) if half >= 0.0 else (a12, spread - half)
        length = np.sqrt(x * x + y * y)
        x, y = x / length, y / length
    first, second = mean + spread, max(mean - spread, 0.0)
    d1, d2, q1, q2 = x * e1 + y * e2, x * e2 - y * e1, x * k1 + y * k2, x * k2 - y * k1
    # sticks if the percussion that stops it lies in the cone
    t1, t2 = -d1 / first, -d2 / max(second, _RANK * first)
    if np.sqrt(t1 * t1 + t2 * t2) > -mu * (bn + q1 * t1 + q2 * t2):
        table = np.empty((3, 2))
        table[0, 0], table[0, 1], table[1, 0], table[1, 1] = d1, d2, q1, q2
        find_slip(first, second, bn, mu, table)
        t1, t2 = table[2, 0], table[2, 1]
    p[1], p[2] = x * t1 - y * t2, y * t1 + x * t2
    p[0] = max(-(bn + k1 * p[1] + k2 * p[2]), 0.0)


@kernel("void(f8[::1], i8[::1])")
def closing_order(b: Array, order: Array) -> None:
    """Write the contacts, shape (m,), sorted by their normal velocities without percussions, the fastest closing first.

    Sweeps in this order do not depend on the order in which contacts are given, nor on their tangents.
    """
    for a in range(len(order)):
        place = a
        while place > 0 and b[3 * order[place - 1]] > b[3 * a]:
            order[place] = order[place - 1]
            place -= 1
        order[place] = a


@kernel("f8(f8[:,::1], f8[::1], f8[::1], i8[::1], i8, f8, f8[::1])")
def sweep_contacts(G: Array, b: Array, mu: Array, order: Array, most: int, limit: float, p: Array) -> float:
    """Improve percussions by block Gauss-Seidel sweeps with exact solutions of each contact; return the residual.

    Parameters
    ----------
    G, b, mu, p
        See `solve_coulomb`; p is the start and receives the result.
    order : ndarray of int, shape (m,)
        The contacts in the order of a sweep.
    most : int
        Most sweeps.
    limit : float
        Relative residual that ends them.
    """
    n, columns = len(b), G.T.copy()
    u, q = np.empty(n), np.empty(3)
    largest, residual = contact_velocities(G, b, p, u), np.inf
    if largest == 0.0:
        return 0.0
    for _ in range(most):
        for a in order:
            i = 3 * a
            c0 = u[i] - G[i, i] * p[i] - G[i, i + 1] * p[i + 1] - G[i, i + 2] * p[i + 2]
            c1 = u[i + 1] - G[i + 1, i] * p[i] - G[i + 1, i + 1] * p[i + 1] - G[i + 1, i + 2] * p[i + 2]
            c2 = u[i + 2] - G[i + 2, i] * p[i] - G[i + 2, i + 1] * p[i + 1] - G[i + 2, i + 2] * p[i + 2]
            solve_contact(G, a, c0, c1, c2, mu[a], q)
            for j in range(3):
                change = q[j] - p[i + j]
                p[i + j] = q[j]
                if change != 0.0:
                    for k in range(n):
                        u[k] += columns[i + j, k] * change
        residual = coulomb_defect(u, p, mu) / largest
        if residual <= limit:
            break
    return residual
