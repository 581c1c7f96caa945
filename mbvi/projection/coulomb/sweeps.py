"""Kernels of block Gauss-Seidel sweeps for Coulomb's law over many contacts, each solved exactly for the others.

A contact has a block of its three whitened rows (`contact_blocks.pack_contacts`). A sweep goes from contact to contact
and keeps z = A p, the change of the velocity; the Delassus matrix is not formed. Sweeps start from an extrapolation of
the last two. Coulomb's law is no minimum, and extrapolated sweeps may diverge: extrapolation begins again where a sweep
changes percussions by more than three times the least change, and where it leads back. Where even single sweeps run in
circles, as with large coefficients of friction, the proximal point method holds percussions back.
"""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ..metric import Array
from .one_contact import coulomb_defect, find_slip

# extrapolation begins again where a sweep changes percussions by more than so many times the least change since
_GROWTH = 3.0
# the residual after a sweep relative to the largest change in it, until it was computed once
_RATIO = 0.35
# sweeps after which it is computed at the latest
_PASSES = 50
# proximal point iterations: first weight, its factors after an iteration that settles and one that does not, and
# the largest
_WEIGHT, _LESS, _MORE, _MOST_WEIGHT = 1.0, 0.7, 3.0, 10.0
# the least weight is twice one that did not settle, and falls by this factor with each iteration
_FORGOTTEN, _LEAST = 1.03, 1e-5
# sweeps of an iteration; it is settled where a sweep changes percussions by less than this share of what the iteration
# changed, times the weight
_MOST_INNER, _SHARE = 60, 0.3


@kernel("void(f8[::1], u4[::1], u4[::1], f8[::1], f8[::1])")
def combine_contacts(blocks: Array, columns: Array, starts: Array, p: Array, z: Array) -> None:
    """Write z = A p, shape (n,); the other arguments are those of `sweep_blocks`."""
    for j in range(len(z)):
        z[j] = 0.0
    for a in range(len(starts) - 1):
        p0, p1, p2 = p[3 * a], p[3 * a + 1], p[3 * a + 2]
        if p0 != 0.0 or p1 != 0.0 or p2 != 0.0:
            for k in range(starts[a], starts[a + 1]):
                z[columns[k]] += blocks[3 * k] * p0 + blocks[3 * k + 1] * p1 + blocks[3 * k + 2] * p2


@kernel("f8(f8[::1], u4[::1], u4[::1], f8[::1], f8[::1], i8[::1], f8[::1], f8[::1], f8[::1])")
def contacts_residual(
    blocks: Array, columns: Array, starts: Array, b: Array, mu: Array, bound: Array, p: Array, z: Array, u: Array
) -> float:
    """Write z = A p and u = A' z + b, and return `coulomb_defect`; the arguments are those of `sweep_blocks`."""
    combine_contacts(blocks, columns, starts, p, z)
    for a in range(len(mu)):
        u0, u1, u2 = b[3 * a], b[3 * a + 1], b[3 * a + 2]
        for k in range(starts[a], starts[a + 1]):
            rate = z[columns[k]]
            u0, u1, u2 = u0 + blocks[3 * k] * rate, u1 + blocks[3 * k + 1] * rate, u2 + blocks[3 * k + 2] * rate
        if bound[a] >= 0:
            u0 = p[3 * a] - p[3 * bound[a]]
        u[3 * a], u[3 * a + 1], u[3 * a + 2] = u0, u1, u2
    return coulomb_defect(u, p, mu)


@kernel(
    "UniTuple(f8, 2)(f8[::1], u4[::1], u4[::1], f8[:,::1], f8[::1], f8[::1], i8[::1], f8, f8[::1], f8[::1], f8[::1], "
    "f8[::1])"
)
def sweep_blocks(
    blocks: Array, columns: Array, starts: Array, local: Array, b: Array, mu: Array, bound: Array, weight: float,
    point: Array, last: Array, z: Array, p: Array,
) -> tuple[float, float]:  # fmt: skip
    """Make the percussion of each contact satisfy its law for the others, one after the other; z = A p follows.

    Parameters
    ----------
    blocks, columns, starts, local
        See `pack_contacts`.
    b : ndarray, shape (3 m,)
        Velocities of the contacts without percussions, in the scaled and turned rows.
    mu : ndarray, shape (m,)
        Coefficients of friction.
    bound : ndarray of int, shape (m,)
        See `coulomb_law`.
    weight, point : float and ndarray of shape (3 m,)
        weight G_aa (p - point) is added to the velocity of contact a; the weight may be zero.
    last : ndarray, shape (3 m,)
        Percussions after the last sweep.
    z, p : ndarray, shapes (n,) and (3 m,)
        z = A p, and percussions.

    Returns
    -------
    change : float
        The largest change of an entry of p.
    uphill : float
        (before - after)' (after - last): positive where the extrapolation went too far.
    """
    change, uphill, table, share = 0.0, 0.0, np.empty((3, 2)), 1.0 / (1.0 + weight)
    for a in range(len(mu)):
        begin, end, i = starts[a], starts[a + 1], 3 * a
        c0, c1, c2 = b[i], b[i + 1], b[i + 2]
        for k in range(begin, end):
            rate = z[columns[k]]
            c0, c1, c2 = c0 + blocks[3 * k] * rate, c1 + blocks[3 * k + 1] * rate, c2 + blocks[3 * k + 2] * rate
        old0, old1, old2 = p[i], p[i + 1], p[i + 2]
        k1, k2, first, second = local[a, 0], local[a, 1], local[a, 2], local[a, 3]
        # the law does not change if velocities are divided by 1 + weight
        c0, c1, c2 = share * c0, share * c1, share * c2
        m1, m2 = share * (old1 + weight * point[i + 1]), share * (old2 + weight * point[i + 2])
        if second < 0.0:
            # no percussion along a tangent that moves nothing
            second, m2 = first, 0.0
        # without the contact's own percussion; u_n = 0 eliminates p_n, and A p_t + d with a diagonal A is left
        bn = c0 - share * (old0 + weight * point[i]) - k1 * m1 - k2 * m2
        if bound[a] >= 0:
            bn = -p[3 * bound[a]]
        p0 = p1 = p2 = 0.0
        if bn < 0.0:
            if mu[a] == 0.0:
                p0 = -bn
            else:
                d1, d2 = c1 - k1 * c0 - first * m1, c2 - k2 * c0 - second * m2
                p1, p2 = -d1 / first, -d2 / second
                p0 = -bn - k1 * p1 - k2 * p2
                across, most = p1 * p1 + p2 * p2, mu[a] * p0
                if most < 0.0 or across > most * most:
                    if first == second and k1 == 0.0 and k2 == 0.0:
                        factor = most / np.sqrt(across)
                        p1, p2 = factor * p1, factor * p2
                    else:
                        table[0, 0], table[0, 1], table[1, 0], table[1, 1] = d1, d2, k1, k2
                        find_slip(first, second, bn, mu[a], table)
                        p1, p2 = table[2, 0], table[2, 1]
                        p0 = max(-(bn + k1 * p1 + k2 * p2), 0.0)
        elif old0 == 0.0 and old1 == 0.0 and old2 == 0.0:
            continue
        s0, s1, s2 = p0 - old0, p1 - old1, p2 - old2
        for k in range(begin, end):
            z[columns[k]] += blocks[3 * k] * s0 + blocks[3 * k + 1] * s1 + blocks[3 * k + 2] * s2
        p[i], p[i + 1], p[i + 2] = p0, p1, p2
        uphill -= s0 * (p0 - last[i]) + s1 * (p1 - last[i + 1]) + s2 * (p2 - last[i + 2])
        change = max(change, abs(s0), abs(s1), abs(s2))
    return change, uphill


@kernel("void(f8, f8[::1], f8[::1])")
def extrapolate_from(part: float, last: Array, values: Array) -> None:
    """Move values by a part of their change since `last`, which becomes the values before; all have shape (n,)."""
    for i in range(len(values)):
        now = values[i]
        values[i], last[i] = now + part * (now - last[i]), now


@kernel("void(f8, f8, f8[::1])")
def choose_part(change: float, uphill: float, state: Array) -> None:
    """Write which part of the change of a sweep the next one is extrapolated by.

    Parameters
    ----------
    change, uphill
        What `sweep_blocks` returned.
    state : ndarray, shape (3,)
        Receives the part, the least change since extrapolation began, and Nesterov's number; (0, inf, 1) at first.
    """
    if uphill > 0.0 or change > _GROWTH * state[1]:
        state[0], state[1], state[2] = 0.0, change, 1.0
    else:
        following = 0.5 * (1.0 + np.sqrt(1.0 + 4.0 * state[2] * state[2]))
        state[0], state[1], state[2] = (state[2] - 1.0) / following, min(state[1], change), following


@kernel("f8(f8[::1], u4[::1], u4[::1], f8[:,::1], f8[::1], f8[::1], i8[::1], f8, i8, f8[::1], f8[::1])")
def accelerated_contacts(
    blocks: Array, columns: Array, starts: Array, local: Array, b: Array, mu: Array, bound: Array, target: float,
    most: int, z: Array, p: Array,
) -> float:  # fmt: skip
    """Bring `coulomb_defect` down by sweeps, each from an extrapolation of the last two; return what was reached.

    Parameters
    ----------
    blocks, columns, starts, local, b, mu, bound
        See `sweep_blocks`.
    target : float
        The residual that is small enough.
    most : int
        How many sweeps at most.
    z, p : ndarray, shapes (n,) and (3 m,)
        Receives A p; percussions to start from, which are written over.
    """
    u, last = np.empty(len(p)), p.copy()
    residual = contacts_residual(blocks, columns, starts, b, mu, bound, p, z, u)
    last_z, state, ratio = z.copy(), np.empty(3), _RATIO
    state[0], state[1], state[2] = 0.0, np.inf, 1.0
    for number in range(most):
        if residual <= target:
            break
        extrapolate_from(state[0], last, p)
        extrapolate_from(state[0], last_z, z)
        change, uphill = sweep_blocks(blocks, columns, starts, local, b, mu, bound, 0.0, last, last, z, p)
        choose_part(change, uphill, state)
        # what the sweep changed tells roughly what the residual is, which costs another pass; it is computed from p,
        # for sums of changes drift
        if ratio * change <= target or number % _PASSES == _PASSES - 1 or number == most - 1:
            residual = contacts_residual(blocks, columns, starts, b, mu, bound, p, z, u)
            if change == 0.0:
                break
            ratio = min(residual / change, 1.0)
    return residual


@kernel("f8(f8[::1], u4[::1], u4[::1], f8[:,::1], f8[::1], f8[::1], i8[::1], f8, i8, f8[::1], f8[::1])")
def proximal_contacts(
    blocks: Array, columns: Array, starts: Array, local: Array, b: Array, mu: Array, bound: Array, target: float,
    most: int, z: Array, p: Array,
) -> float:  # fmt: skip
    """Bring `coulomb_defect` down by the proximal point method; return what was reached.

    An iteration solves the law of contacts that resist to leave their percussions p, with the velocities
    u + weight G_aa (p - point) and the point from which the iteration starts, by accelerated sweeps. The arguments are
    those of `accelerated_contacts`. An iteration whose sweeps do not settle is taken back, and the weight grows.
    """
    u, point, point_z = np.empty(len(p)), np.empty(len(p)), np.empty(len(z))
    last, last_z, state = np.empty(len(p)), np.empty(len(z)), np.empty(3)
    residual = contacts_residual(blocks, columns, starts, b, mu, bound, p, z, u)
    weight, lowest, sweeps = _WEIGHT, _LEAST, 0
    while sweeps < most and residual > target:
        for i in range(len(p)):
            point[i] = last[i] = p[i]
        for j in range(len(z)):
            point_z[j] = last_z[j] = z[j]
        state[0], state[1], state[2], settled = 0.0, np.inf, 1.0, False
        for _ in range(_MOST_INNER):
            extrapolate_from(state[0], last, p)
            extrapolate_from(state[0], last_z, z)
            change, uphill = sweep_blocks(blocks, columns, starts, local, b, mu, bound, weight, point, last, z, p)
            choose_part(change, uphill, state)
            sweeps, moved = sweeps + 1, 0.0
            for i in range(len(p)):
                moved = max(moved, abs(p[i] - point[i]))
            settled = change <= max(_SHARE * weight * moved, 0.1 * target)
            if settled:
                break
        if settled:
            residual = contacts_residual(blocks, columns, starts, b, mu, bound, p, z, u)
            weight, lowest = max(_LESS * weight, lowest), max(lowest / _FORGOTTEN, _LEAST)
        else:
            for i in range(len(p)):
                p[i] = point[i]
            for j in range(len(z)):
                z[j] = point_z[j]
            weight, lowest = min(_MORE * weight, _MOST_WEIGHT), 2.0 * weight
    return residual
