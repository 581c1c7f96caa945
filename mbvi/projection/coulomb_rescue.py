"""Kernels for the problems of Coulomb's law that Newton's method does not solve at once; the best found is kept."""

from __future__ import annotations

import numpy as np

from ..compiled import kernel
from .coulomb_contact import contact_velocities, coulomb_defect, sweep_contacts
from .coulomb_newton import SHIFT, find_cases, hold_cases, newton_coulomb, tangential_scale
from .metric import Array

# residual of the problems within an iteration
_CLOSE = 1e-12
# proximal point iteration: first weight, its factor, least weight, most iterations
_WEIGHT, _LESS, _LEAST, _MOST_PROXIMAL = 1.0, 0.3, 1e-9, 40
# rounds of sweeps, and how many
_ROUNDS, _FIRST_SWEEPS, _MOST_SWEEPS = 8, 3, 2000
# from compliant to rigid contacts: first and last compliance, and the factor between
_SOFT, _RIGID, _STIFFER = 0.1, 1e-13, 0.7
_HELD_STEPS = 30


@kernel("f8(f8[::1], f8, f8, f8[::1])")
def keep_better(trial: Array, residual: float, best: float, p: Array) -> float:
    """Copy a trial to p if its residual is less than the best so far; return the lesser of both."""
    # written so that a NaN is not kept
    if residual < best:
        best = residual
        for i in range(len(p)):
            p[i] = trial[i]
    return best


@kernel("f8(f8[:,::1], f8[::1], f8[::1], f8, f8[::1])")
def proximal_newton(G: Array, b: Array, mu: Array, limit: float, p: Array) -> float:
    """Improve percussions by proximal point iterations with Newton's method inside; return the residual.

    The arguments are those of `newton_coulomb`; p is the start and receives the best found. Each iteration solves the
    law with G + weight I and b - weight p. A large weight decouples the contacts.
    """
    n = len(b)
    H, c, u, point = G.copy(), np.empty(n), np.empty(n), p.copy()
    best, weight = np.inf, _WEIGHT
    for _ in range(_MOST_PROXIMAL):
        for i in range(n):
            H[i, i], c[i] = G[i, i] + weight, b[i] - weight * point[i]
        newton_coulomb(H, c, mu, 15, 1e-3 * limit if weight < 1e-5 else 1e-6, SHIFT, 3, point)
        largest = contact_velocities(G, b, point, u)
        best = keep_better(point, coulomb_defect(u, point, mu) / largest, best, p)
        if best <= limit:
            break
        weight = max(_LESS * weight, _LEAST)
    return best


@kernel("f8(f8[:,::1], f8[::1], f8[::1], f8, f8[::1])")
def sweeps_and_newton(G: Array, b: Array, mu: Array, limit: float, p: Array) -> float:
    """Improve percussions by ever more sweeps, each time with Newton's method after them; return the residual.

    The arguments are those of `newton_coulomb`; p is the start and receives the best found.
    """
    trial, swept = np.empty(len(b)), p.copy()
    best, sweeps = np.inf, _FIRST_SWEEPS
    for attempt in range(_ROUNDS):
        best = keep_better(swept, sweep_contacts(G, b, mu, sweeps, limit, swept), best, p)
        if best <= limit:
            break
        keep_better(swept, 0.0, 1.0, trial)
        shift, remembered = SHIFT if attempt % 2 == 0 else 1e3 * SHIFT, 1 if attempt < 2 else 5
        residual = newton_coulomb(G, b, mu, 10 + 10 * attempt, limit, shift, remembered, trial)
        best = keep_better(trial, residual, best, p)
        if best <= limit:
            break
        sweeps = min(3 * sweeps, _MOST_SWEEPS)
    return best


@kernel("f8(f8[:,::1], f8[::1], f8[::1], f8, f8[::1])")
def stiffen(G: Array, b: Array, mu: Array, limit: float, p: Array) -> float:
    """Follow the answer from compliant contacts to rigid ones; write it to p and return the residual.

    The arguments are those of `newton_coulomb`.
    """
    n, m = len(b), len(mu)
    H, u, scale, case = G.copy(), np.empty(n), np.empty(m), np.empty(m, np.int64)
    for i in range(n):
        p[i] = 0.0
    compliance = _SOFT
    while compliance > _RIGID:
        for i in range(n):
            H[i, i] = G[i, i] + compliance
        if newton_coulomb(H, b, mu, 40, _CLOSE, 1e-2 * SHIFT, 3, p) > 1e-8:
            proximal_newton(H, b, mu, _CLOSE, p)
        compliance *= _STIFFER
    contact_velocities(G, b, p, u)
    tangential_scale(G, scale)
    find_cases(u, p, mu, scale, case)
    return hold_cases(G, b, mu, case, _HELD_STEPS, limit, SHIFT, p)


@kernel("f8(f8[:,::1], f8[::1], f8[::1], f8, f8, f8[::1])")
def improve_coulomb(G: Array, b: Array, mu: Array, residual: float, limit: float, p: Array) -> float:
    """Improve percussions of a given residual by one method after the other; return the residual reached.

    The other arguments are those of `newton_coulomb`; p is the start and receives the best found.
    """
    trial = np.empty(len(b))
    for attempt in range(5):
        if residual <= limit:
            break
        keep_better(p, 0.0, 1.0, trial)
        if attempt < 2:
            found = newton_coulomb(G, b, mu, 15, limit, 1e3 * SHIFT if attempt == 0 else SHIFT, 3, trial)
        elif attempt == 2:
            found = proximal_newton(G, b, mu, limit, trial)
        elif attempt == 3:
            found = stiffen(G, b, mu, limit, trial)
        else:
            # sweeps depend on the order of the contacts: they come last
            found = sweeps_and_newton(G, b, mu, limit, trial)
        residual = keep_better(trial, found, residual, p)
    return residual
