"""The kernel that solves Coulomb's law for up to 32 contacts: one answer, whatever the order of contacts and the axes.

Where rows depend on each other, the law may have several velocities. The one is taken that all contacts give when they
are equally compliant: of G + COMPLIANCE I in scaled rows. Its open, sticking and slipping contacts are kept, and the
equations of these cases are solved for G itself.
"""

from __future__ import annotations

import numpy as np

from ..compiled import kernel
from .coulomb_contact import contact_velocities, coulomb_defect, sweep_contacts
from .coulomb_newton import find_cases, hold_cases, newton_coulomb, tangential_scale
from .metric import Array

# compliance of every contact, relative to its own G_nn
COMPLIANCE = 1e-4
# added to the diagonal in derivatives only: rows may depend on each other
_SHIFT = 1e-10
# the same where the cases are held: less of the rounding gets into percussions that the velocity does not depend on
_HELD_SHIFT = 1e-7
# the compliant problem is solved to this residual, and polished
_CLOSE, _POLISHING_STEPS = 1e-12, 3
_NEWTON_STEPS, _HELD_STEPS = 15, 30
# rounds of sweeps, and how many
_ROUNDS, _FIRST_SWEEPS, _MOST_SWEEPS = 8, 3, 2000
# proximal point iteration: first weight, its factor, least weight, most iterations
_WEIGHT, _LESS, _LEAST, _MOST_PROXIMAL = 1.0, 0.3, 1e-9, 40
# from compliant to rigid contacts: first and last compliance, and the factor between
_SOFT, _RIGID, _STIFFER = 0.1, 1e-13, 0.7


@kernel("f8(f8[:,::1], f8[::1], f8[::1], f8, f8[::1])")
def proximal_newton(G: Array, b: Array, mu: Array, limit: float, p: Array) -> float:
    """Improve percussions by proximal point iterations with Newton's method inside; return the residual.

    The arguments are those of `solve_coulomb`; p is the start and receives the best found. Each iteration solves the
    law with G + weight I and b - weight p. A large weight decouples the contacts.
    """
    n = len(b)
    H, c, u, point, trial = G.copy(), np.empty(n), np.empty(n), p.copy(), np.empty(n)
    best, weight = np.inf, _WEIGHT
    for _ in range(_MOST_PROXIMAL):
        for i in range(n):
            H[i, i], c[i], trial[i] = G[i, i] + weight, b[i] - weight * point[i], point[i]
        newton_coulomb(H, c, mu, _NEWTON_STEPS, 1e-3 * limit if weight < 1e-5 else 1e-6, _SHIFT, 3, trial)
        for i in range(n):
            point[i] = trial[i]
        largest = contact_velocities(G, b, point, u)
        residual = coulomb_defect(u, point, mu) / largest
        if residual < best:
            best = residual
            for i in range(n):
                p[i] = point[i]
        if best <= limit:
            break
        weight = max(_LESS * weight, _LEAST)
    return best


@kernel("f8(f8[:,::1], f8[::1], f8[::1], f8, f8[::1])")
def sweeps_and_newton(G: Array, b: Array, mu: Array, limit: float, p: Array) -> float:
    """Improve percussions by ever more sweeps, each time with Newton's method after them; return the residual.

    The arguments are those of `solve_coulomb`; p is the start and receives the best found.
    """
    n = len(b)
    trial, swept = np.empty(n), p.copy()
    best, sweeps = np.inf, _FIRST_SWEEPS
    for attempt in range(_ROUNDS):
        residual = sweep_contacts(G, b, mu, sweeps, limit, swept)
        if residual < best:
            best = residual
            for i in range(n):
                p[i] = swept[i]
        if best <= limit:
            break
        for i in range(n):
            trial[i] = swept[i]
        shift, remembered = _SHIFT if attempt % 2 == 0 else 1e3 * _SHIFT, 1 if attempt < 2 else 5
        residual = newton_coulomb(G, b, mu, 10 + 10 * attempt, limit, shift, remembered, trial)
        if residual < best:
            best = residual
            for i in range(n):
                p[i] = trial[i]
        if best <= limit:
            break
        sweeps = min(3 * sweeps, _MOST_SWEEPS)
    return best


@kernel("f8(f8[:,::1], f8[::1], f8[::1], f8, f8[::1])")
def stiffen(G: Array, b: Array, mu: Array, limit: float, p: Array) -> float:
    """Follow the answer from compliant contacts to rigid ones; write it to p and return the residual.

    The arguments are those of `solve_coulomb`.
    """
    n, m = len(b), len(mu)
    H, u, scale, case = G.copy(), np.empty(n), np.empty(m), np.empty(m, np.int64)
    for i in range(n):
        p[i] = 0.0
    compliance = _SOFT
    while compliance > _RIGID:
        for i in range(n):
            H[i, i] = G[i, i] + compliance
        if newton_coulomb(H, b, mu, 40, _CLOSE, 1e-2 * _SHIFT, 3, p) > 1e-8:
            proximal_newton(H, b, mu, _CLOSE, p)
        compliance *= _STIFFER
    contact_velocities(G, b, p, u)
    tangential_scale(G, scale)
    find_cases(u, p, mu, scale, case)
    return hold_cases(G, b, mu, case, _HELD_STEPS, limit, _SHIFT, p)


@kernel("f8(f8[:,::1], f8[::1], f8[::1], f8, f8, f8[::1])")
def improve_coulomb(G: Array, b: Array, mu: Array, residual: float, limit: float, p: Array) -> float:
    """Improve percussions of a given residual by one method after the other; return the residual reached.

    The other arguments are those of `solve_coulomb`; p is the start and receives the best found.
    """
    n = len(b)
    trial = np.empty(n)
    for attempt in range(5):
        if residual <= limit:
            break
        for i in range(n):
            trial[i] = p[i]
        if attempt < 2:
            found = newton_coulomb(G, b, mu, _NEWTON_STEPS, limit, _HELD_SHIFT if attempt == 0 else _SHIFT, 3, trial)
        elif attempt == 2:
            found = proximal_newton(G, b, mu, limit, trial)
        elif attempt == 3:
            found = stiffen(G, b, mu, limit, trial)
        else:
            found = sweeps_and_newton(G, b, mu, limit, trial)
        if found < residual:
            residual = found
            for i in range(n):
                p[i] = trial[i]
    return residual


@kernel("f8(f8[:,::1], f8[::1], f8[::1], f8, f8[::1])")
def solve_coulomb(G: Array, b: Array, mu: Array, limit: float, p: Array) -> float:
    """Write percussions that satisfy Coulomb's law with u = G p + b.

    Parameters
    ----------
    G : ndarray, shape (n, n), n = 3 m
        Symmetric positive semidefinite, with unit normal entries; see `coulomb_contact`.
    b : ndarray, shape (n,)
        Velocities of the contacts without percussions.
    mu : ndarray, shape (m,)
        Coefficients of friction.
    limit : float
        The residual that ends the iterations.
    p : ndarray, shape (n,)
        Receives the percussions.

    Returns
    -------
    float
        `coulomb_defect` relative to the largest entry of b.
    """
    n, m = len(b), len(mu)
    u, scale, case, H = np.empty(n), np.empty(m), np.empty(m, np.int64), G.copy()
    for i in range(n):
        p[i] = 0.0
        H[i, i] += COMPLIANCE
    if newton_coulomb(H, b, mu, _NEWTON_STEPS, _CLOSE, _SHIFT, 1, p) > _CLOSE:
        for i in range(n):
            p[i] = 0.0
        # sweeps depend on the order of the contacts: they come last
        if proximal_newton(H, b, mu, _CLOSE, p) > _CLOSE:
            sweeps_and_newton(H, b, mu, _CLOSE, p)
    contact_velocities(H, b, p, u)
    tangential_scale(H, scale)
    find_cases(u, p, mu, scale, case)
    hold_cases(H, b, mu, case, _POLISHING_STEPS, 0.0, _SHIFT, p)
    residual, shift = np.inf, _HELD_SHIFT
    while residual > 0.1 * limit and shift > 1e-3 * _SHIFT:
        residual = hold_cases(G, b, mu, case, _HELD_STEPS, 1e-3 * limit, shift, p)
        shift *= 0.1
    if residual > limit:
        residual = improve_coulomb(G, b, mu, residual, limit, p)
    return residual
