"""Kernels of block Gauss-Seidel sweeps for Coulomb's law over many contacts, each solved exactly for the others.

A contact has a block of its three whitened rows (`contact_blocks.pack_contacts`). A sweep goes from contact to contact
and keeps z = A p, the change of the velocity; the Delassus matrix is not formed.
"""

from __future__ import annotations

import numpy as np

from ..compiled import kernel
from .coulomb_contact import coulomb_defect, find_slip
from .metric import Array

# extrapolation begins again where a sweep changes percussions by more than so many times the least change since
_GROWTH = 2.0
# the residual after a sweep relative to the largest change in it, until it was computed once
_RATIO = 0.35
# sweeps after which it is computed at the latest
_PASSES = 50


@kernel("void(f8[::1], u4[::1], u4[::1], f8[::1], f8[::1])")
def combine_contacts(blocks: Array, columns: Array, starts: Array, p: Array, z: Array) -> None:
    """Write z = A p, shape (n,); the other arguments are as of `sweep_blocks`."""
    for j in range(len(z)):
        z[j] = 0.0
    for a in range(len(starts) - 1):
        p0, p1, p2 = p[3 * a], p[3 * a + 1], p[3 * a + 2]
        if p0 != 0.0 or p1 != 0.0 or p2 != 0.0:
            for k in range(starts[a], starts[a + 1]):
                z[columns[k]] += blocks[3 * k] * p0 + blocks[3 * k + 1] * p1 + blocks[3 * k + 2] * p2


@kernel("f8(f8[::1], u4[::1], u4[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1])")
def contacts_residual(
    blocks: Array, columns: Array, starts: Array, b: Array, mu: Array, p: Array, z: Array, u: Array
) -> float:
    """Write z = A p and u = A' z + b, and return `coulomb_defect`; the arguments are as of `sweep_blocks`."""
    combine_contacts(blocks, columns, starts, p, z)
    for a in range(len(mu)):
        u0, u1, u2 = b[3 * a], b[3 * a + 1], b[3 * a + 2]
        for k in range(starts[a], starts[a + 1]):
            rate = z[columns[k]]
            u0, u1, u2 = u0 + blocks[3 * k] * rate, u1 + blocks[3 * k + 1] * rate, u2 + blocks[3 * k + 2] * rate
        u[3 * a], u[3 * a + 1], u[3 * a + 2] = u0, u1, u2
    return coulomb_defect(u, p, mu)


@kernel("UniTuple(f8, 2)(f8[::1], u4[::1], u4[::1], f8[:,::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1])")
def sweep_blocks(
    blocks: Array, columns: Array, starts: Array, local: Array, b: Array, mu: Array, last: Array, z: Array, p: Array
) -> tuple[float, float]:
    """Make the percussion of each contact satisfy its law for the others, one after the other; z = A p follows.

    Parameters
    ----------
    blocks, columns, starts, local
        As of `pack_contacts`.
    b : ndarray, shape (3 m,)
        Velocities of the contacts without percussions, in the scaled and turned rows.
    mu : ndarray, shape (m,)
        Coefficients of friction.
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
    change, uphill, table = 0.0, 0.0, np.empty((3, 2))
    for a in range(len(mu)):
        begin, end, i = starts[a], starts[a + 1], 3 * a
        c0, c1, c2 = b[i], b[i + 1], b[i + 2]
        for k in range(begin, end):
            rate = z[columns[k]]
            c0, c1, c2 = c0 + blocks[3 * k] * rate, c1 + blocks[3 * k + 1] * rate, c2 + blocks[3 * k + 2] * rate
        old0, old1, old2 = p[i], p[i + 1], p[i + 2]
        k1, k2, first, second = local[a, 0], local[a, 1], local[a, 2], local[a, 3]
        # without the contact's own percussion; u_n = 0 eliminates p_n, and A p_t + d with a diagonal A is left
        own = old0 + k1 * old1 + k2 * old2
        bn = c0 - own
        p0 = p1 = p2 = 0.0
        if bn < 0.0:
            if mu[a] == 0.0:
                p0 = -bn
            else:
                d1, d2 = c1 - k1 * c0 - first * old1, c2 - k2 * c0 - second * old2
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


@kernel("f8(f8[::1], u4[::1], u4[::1], f8[:,::1], f8[::1], f8[::1], f8, i8, f8[::1], f8[::1])")
def accelerated_contacts(
    blocks: Array, columns: Array, starts: Array, local: Array, b: Array, mu: Array, target: float, most: int,
    z: Array, p: Array,
) -> float:  # fmt: skip
    """Bring `coulomb_defect` down by sweeps, each from an extrapolation of the last two; return what was reached.

    Coulomb's law is no minimum, and extrapolated sweeps may diverge: extrapolation begins again where a sweep changes
    percussions by more than `_GROWTH` times its least change, and where it leads back.

    Parameters
    ----------
    blocks, columns, starts, local, b, mu
        As of `sweep_blocks`.
    target : float
        The residual that is small enough.
    most : int
        How many sweeps at most.
    z, p : ndarray, shapes (n,) and (3 m,)
        Receives A p; percussions to start from, which are written over.
    """
    u, last = np.empty(len(p)), p.copy()
    residual = contacts_residual(blocks, columns, starts, b, mu, p, z, u)
    last_z, weight, part, least, ratio = z.copy(), 1.0, 0.0, np.inf, _RATIO
    for number in range(most):
        # written so that a NaN goes on to fail
        if residual <= target:
            break
        extrapolate_from(part, last, p)
        extrapolate_from(part, last_z, z)
        change, uphill = sweep_blocks(blocks, columns, starts, local, b, mu, last, z, p)
        part, following = 0.0, 0.5 * (1.0 + np.sqrt(1.0 + 4.0 * weight * weight))
        if uphill > 0.0 or change > _GROWTH * least:
            weight, least = 1.0, change
        else:
            part, weight, least = (weight - 1.0) / following, following, min(least, change)
        # what the sweep changed tells roughly what the residual is, which costs another pass; it is computed from p,
        # for sums of changes drift
        if ratio * change <= target or number % _PASSES == _PASSES - 1 or number == most - 1:
            residual = contacts_residual(blocks, columns, starts, b, mu, p, z, u)
            if change == 0.0:
                break
            ratio = min(residual / change, 1.0)
    return residual
