"""The kernel that solves Coulomb's law for up to 64 contacts: one answer, whatever the order of contacts and the axes.

Where rows depend on each other, the law may have several velocities. The one is taken that all contacts give when they
are equally compliant: of G + COMPLIANCE I in scaled rows. Its open, sticking and slipping contacts are kept, and the
equations of these cases are solved for G itself.
"""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ..metric import Array
from .newton.cases import find_cases, tangential_scale
from .newton.directions import Delassus, soften
from .newton.iterations import SHIFT, hold_cases, newton_coulomb
from .one_contact import contact_velocities
from .rescue import COMPLIANCE, hold_rigid, improve_coulomb, proximal_newton, sweeps_and_newton

# contacts up to which the answer is one whatever their order; beyond, sweeps begin with the contacts as they come
MOST_CONTACTS = 64
# the compliant problem is solved to this residual, and polished
_CLOSE, _POLISHING_STEPS = 1e-12, 3
# Newton steps from nothing, and from the last answer; errors that the line search remembers
_STEPS, _RESUMED_STEPS, _REMEMBERED = 15, 25, 3
# rows whose elimination leaves a lesser part of their G_nn count as dependent
_REGULAR = 1e-9
# up to this mu, and this mu |G_nt|, an answer may be taken from a start near it: see docs/theory/mathematics.md
_NARROW, _WEAK = 0.8, 0.75


@kernel("b1(f8[:,::1], f8[::1])")
def couples_weakly(G: Array, mu: Array) -> bool:
    """Return whether friction is low, and acts little on the normal of its own contact.

    Above both, compliant contacts may have several answers too; of one contact from mu |G_nt| = G_nn on (P. Painlevé).
    """
    for a in range(len(mu)):
        i = 3 * a
        if mu[a] < 0.0:
            continue
        if mu[a] > _NARROW or mu[a] * np.sqrt(G[i, i + 1] ** 2 + G[i, i + 2] ** 2) > _WEAK * G[i, i]:
            return False
    return True


@kernel("b1(f8[::1], i8[::1], i8)")
def acts(mu: Array, bound: Array, i: int) -> bool:
    """Return whether a row of the contacts may have a percussion that is neither known nor that of another contact."""
    coefficient = mu[i // 3]
    if i % 3 == 0 and bound[i // 3] >= 0:
        return False
    return coefficient > 0.0 or i % 3 == (0 if coefficient == 0.0 else 1)


@kernel("b1(f8[:,::1], f8[::1], i8[::1])")
def independent_rows(G: Array, mu: Array, bound: Array) -> bool:
    """Return whether the rows of all contacts are independent, without the tangents of frictionless ones.

    `bound`, shape (m,), is that of `coulomb_law`.
    """
    L, k = np.empty(G.shape), 0
    for i in range(len(G)):
        if not acts(mu, bound, i):
            continue
        c = 0
        for j in range(i):
            if acts(mu, bound, j):
                value = G[i, j]
                for r in range(c):
                    value -= L[k, r] * L[c, r]
                L[k, c] = value / L[c, c]
                c += 1
        rest = G[i, i]
        for r in range(k):
            rest -= L[k, r] * L[k, r]
        if not rest > _REGULAR:
            return False
        L[k, k] = np.sqrt(rest)
        k += 1
    return True


@kernel("void(Delassus, f8[::1], f8[::1], b1, f8[::1], i8[::1])")
def solve_compliant(compliant: Delassus, b: Array, mu: Array, started: bool, p: Array, case: Array) -> None:
    """Write the percussions of compliant contacts and the case of each, shape (m,).

    Parameters
    ----------
    compliant : Delassus
        With the same compliance at all contacts.
    b, mu
        See `solve_coulomb`.
    started : bool
        Whether p holds percussions to start from.
    p : ndarray, shape (n,)
        Receives the percussions.
    """
    n, u, scale = len(b), np.empty(len(b)), np.empty(len(mu))
    if not started or newton_coulomb(compliant, b, mu, _RESUMED_STEPS, _CLOSE, SHIFT, _REMEMBERED, p) > _CLOSE:
        for i in range(n):
            p[i] = 0.0
        if newton_coulomb(compliant, b, mu, _STEPS, _CLOSE, SHIFT, _REMEMBERED, p) > _CLOSE:
            for i in range(n):
                p[i] = 0.0
            if sweeps_and_newton(compliant, b, mu, _CLOSE, p) > _CLOSE:
                proximal_newton(compliant, b, mu, _CLOSE, p)
    contact_velocities(compliant.G, b, p, u)
    tangential_scale(compliant.G, scale)
    find_cases(u, p, mu, scale, case)


@kernel("f8(Delassus, f8[::1], Delassus, f8[::1], f8[::1], f8, b1, b1, f8[::1], f8[::1])")
def solve_softened(
    law: Delassus, b: Array, compliant: Delassus, c: Array, mu: Array, limit: float, independent: bool, started: bool,
    start: Array, p: Array,
) -> float:  # fmt: skip
    """Write percussions of rigid contacts in the cases of compliant ones; return `coulomb_defect`, which may be large.

    Parameters
    ----------
    law, b, mu, limit, independent, started, start, p
        See `solve_coulomb`.
    compliant, c : Delassus and ndarray, shape (n,)
        Those of compliant contacts.
    """
    case = np.empty(len(mu), np.int64)
    solve_compliant(compliant, c, mu, started, start, case)
    if not independent:
        # percussions that do not change the velocity of rigid contacts are known to the residual over the compliance
        hold_cases(compliant, c, mu, case, _POLISHING_STEPS, 1e-3 * _CLOSE, SHIFT, start)
    for i in range(len(b)):
        p[i] = start[i]
    return hold_rigid(law, b, mu, case, independent, 0.1 * limit, p)


@kernel("f8(Delassus, f8[::1], f8[::1], f8, b1, b1, f8[::1], f8[::1])")
def solve_coulomb(
    law: Delassus, b: Array, mu: Array, limit: float, independent: bool, started: bool, start: Array, p: Array
) -> float:
    """Write percussions that satisfy Coulomb's law with u = G p + b; return `coulomb_defect` relative to the largest b.

    Parameters
    ----------
    law : Delassus
        Of n = 3 m rows.
    b : ndarray, shape (n,)
        Velocities of the contacts without percussions.
    mu : ndarray, shape (m,)
        Coefficients of friction.
    limit : float
        The residual that ends the iterations.
    independent, started : bool
        Whether rows are independent (`independent_rows`), and whether `start` is one.
    start : ndarray, shape (n,)
        Percussions of compliant contacts in a problem like this; receives those of this one.
    p : ndarray, shape (n,)
        Receives the percussions.
    """
    residual = solve_softened(law, b, soften(law, COMPLIANCE), b, mu, limit, independent, started, start, p)
    if residual > limit:
        residual = improve_coulomb(law, b, mu, independent, residual, limit, start, p)
    return residual
