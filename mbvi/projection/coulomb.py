"""The kernel that solves Coulomb's law for up to 32 contacts: one answer, whatever the order of contacts and the axes.

Where rows depend on each other, the law may have several velocities. The one is taken that all contacts give when they
are equally compliant: of G + COMPLIANCE I in scaled rows. Its open, sticking and slipping contacts are kept, and the
equations of these cases are solved for G itself.
"""

from __future__ import annotations

import numpy as np

from ..compiled import kernel
from .coulomb_contact import contact_velocities
from .coulomb_newton import (
    SHIFT,
    find_cases,
    hold_cases,
    newton_coulomb,
    resume_newton,
    tangential_scale,
)
from .coulomb_rescue import improve_coulomb, proximal_newton, sweeps_and_newton
from .metric import Array

# contacts up to which the answer is one whatever their order; beyond, sweeps begin with the contacts as they come
MOST_CONTACTS = 32
# compliance of every contact, relative to its own G_nn
COMPLIANCE = 1e-4
# the compliant problem is solved to this residual, and polished
_CLOSE, _POLISHING_STEPS = 1e-12, 3
# Newton steps from nothing, from the last answer, and with the cases held
_STEPS, _RESUMED_STEPS, _HELD_STEPS = 15, 4, 30
# rows whose elimination leaves a lesser pivot count as dependent
REGULAR = 1e-9
# shift of dependent rows: less of the rounding gets into percussions that the velocity does not depend on
_HELD_SHIFT = 1e-7
# mu |G_nt| of a contact up to which an answer may be taken without a look at the compliant one; from 1 on, one contact
# alone has several answers (P. Painleve)
_WEAK = 0.5


@kernel("b1(f8[:,::1], f8[::1])")
def couples_weakly(G: Array, mu: Array) -> bool:
    """Return whether friction of each contact acts little on its own normal: mu |G_nt| <= G_nn / 2."""
    for a in range(len(mu)):
        i = 3 * a
        if mu[a] * np.sqrt(G[i, i + 1] ** 2 + G[i, i + 2] ** 2) > _WEAK * G[i, i]:
            return False
    return True


@kernel("void(f8[:,::1], f8[::1], f8[::1], b1, f8[::1], i8[::1])")
def solve_compliant(H: Array, b: Array, mu: Array, started: bool, p: Array, case: Array) -> None:
    """Write the percussions of compliant contacts and the case of each, shape (m,).

    Parameters
    ----------
    H : ndarray, shape (n, n)
        G + COMPLIANCE I.
    b, mu
        As of `solve_coulomb`.
    started : bool
        Whether p holds percussions to start from.
    p : ndarray, shape (n,)
        Receives the percussions.
    """
    n, u, scale = len(b), np.empty(len(b)), np.empty(len(mu))
    if not started or resume_newton(H, b, mu, _RESUMED_STEPS, _CLOSE, p)[0] > _CLOSE:
        for i in range(n):
            p[i] = 0.0
        if newton_coulomb(H, b, mu, _STEPS, _CLOSE, SHIFT, 1, p) > _CLOSE:
            for i in range(n):
                p[i] = 0.0
            # sweeps depend on the order of the contacts: they come last
            if proximal_newton(H, b, mu, _CLOSE, p) > _CLOSE:
                sweeps_and_newton(H, b, mu, _CLOSE, p)
    contact_velocities(H, b, p, u)
    tangential_scale(H, scale)
    find_cases(u, p, mu, scale, case)


@kernel("UniTuple(f8, 2)(f8[:,::1], f8[::1], f8[::1], f8, b1, f8[::1], f8[::1])")
def solve_coulomb(
    G: Array, b: Array, mu: Array, limit: float, started: bool, start: Array, p: Array
) -> tuple[float, float]:
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
    started : bool
        Whether `start` is one.
    start : ndarray, shape (n,)
        Percussions of compliant contacts in a problem like this; receives those of this one.
    p : ndarray, shape (n,)
        Receives the percussions.

    Returns
    -------
    residual : float
        `coulomb_defect` relative to the largest entry of b.
    least : float
        The least pivot of the rows that bear; below `REGULAR` they depend on each other. inf if none bears.
    """
    n, m = len(b), len(mu)
    case, H = np.empty(m, np.int64), G.copy()
    for i in range(n):
        H[i, i] += COMPLIANCE
    solve_compliant(H, b, mu, started, start, case)
    for i in range(n):
        p[i] = start[i]
    residual, least = hold_cases(G, b, mu, case, _HELD_STEPS, 0.1 * limit, 0.0, p)
    if least < REGULAR:
        hold_cases(H, b, mu, case, _POLISHING_STEPS, 0.0, SHIFT, start)
        for i in range(n):
            p[i] = start[i]
        residual, shift = np.inf, _HELD_SHIFT
        while residual > 0.1 * limit and shift > 1e-3 * SHIFT:
            residual = hold_cases(G, b, mu, case, _HELD_STEPS, 1e-3 * limit, shift, p)[0]
            shift *= 0.1
    if residual > limit:
        residual = improve_coulomb(G, b, mu, residual, limit, p)
    return residual, least
