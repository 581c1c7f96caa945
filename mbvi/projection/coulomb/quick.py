"""Kernel that solves Coulomb's law for more contacts exactly where Newton's method does it in a bounded time."""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ..metric import Array
from .few_contacts import couples_weakly
from .newton.directions import Delassus, soften
from .newton.iterations import SHIFT, newton_coulomb, resume_newton
from .rescue import COMPLIANCE, RIGID, hold_as_compliant, keep_better

# contacts up to which it is tried, and up to which it begins anew where it fails from the last percussions
MOST_NEWTON, _MOST_RESTARTED = 128, 64
# residual of compliant problems
_CLOSE = 1e-12
# Newton steps from nothing, from the answer with more compliance, and from the last answer
_STEPS, _STIFFER_STEPS, _RESUMED_STEPS = 30, 40, 5


@kernel("void(f8[::1], f8[::1])")
def clip_to_cones(mu: Array, p: Array) -> None:
    """Shorten percussions, shape (3 m,), that lie outside of their cones by rounding; shape (m,) is that of mu."""
    for a in range(len(mu)):
        i = 3 * a
        if p[i] <= 0.0:
            p[i] = p[i + 1] = p[i + 2] = 0.0
        across = np.sqrt(p[i + 1] ** 2 + p[i + 2] ** 2)
        bound = abs(mu[a]) * p[i]
        if across > bound:
            p[i + 1], p[i + 2] = p[i + 1] * (bound / across), p[i + 2] * (bound / across)


@kernel("f8(Delassus, f8[::1], f8[::1], f8, f8[::1])")
def quick_coulomb(law: Delassus, b: Array, mu: Array, limit: float, p: Array) -> float:
    """Write percussions that satisfy Coulomb's law with u = G p + b; return the residual, inf where they are not found.

    As `solve_coulomb`, but by Newton's method alone. Compliance falls by decades where the cases of compliant contacts
    are not those of rigid ones.

    Parameters
    ----------
    law, b, mu, limit
        See `solve_coulomb`.
    p : ndarray, shape (n,)
        Percussions of the last problem like this, or zeros; receives those of this one, if they are found.
    """
    n, m = len(b), len(mu)
    soft, trial, found, started = p.copy(), np.empty(n), np.inf, False
    for i in range(n):
        started = started or p[i] != 0.0
    # where it may begin anew it may also fail once
    failures, compliance = 0 if started and m > _MOST_RESTARTED else -1, COMPLIANCE
    if started and not couples_weakly(law.G, mu):
        started = False
        for i in range(n):
            soft[i] = 0.0
    while compliance > RIGID:
        compliant = soften(law, compliance)
        if compliance < COMPLIANCE:
            found = newton_coulomb(compliant, b, mu, _STIFFER_STEPS, _CLOSE, 1e-2 * SHIFT, 3, soft)
        else:
            if started:
                found = resume_newton(compliant, b, mu, _RESUMED_STEPS, _CLOSE, soft)
            if not started or (m <= _MOST_RESTARTED and not found <= _CLOSE):
                for i in range(n):
                    soft[i] = 0.0
                found = newton_coulomb(compliant, b, mu, _STEPS, _CLOSE, SHIFT, 3, soft)
        # written so that a NaN fails too
        failures += not found <= _CLOSE
        if failures > 0:
            break
        keep_better(soft, 0.0, 1.0, trial)
        found = hold_as_compliant(law, compliant, b, mu, False, 0.1 * limit, trial)
        if found <= limit:
            clip_to_cones(mu, trial)
            return keep_better(trial, found, np.inf, p)
        compliance *= 0.1
    return np.inf
