"""Kernels for the problems of Coulomb's law that Newton's method does not solve at once; the best found is kept."""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ..metric import Array
from .newton.cases import find_cases, tangential_scale
from .newton.directions import Delassus, soften
from .newton.iterations import SHIFT, hold_cases, newton_coulomb
from .one_contact import closing_order, contact_velocities, coulomb_defect, sweep_contacts

# compliance of every contact, relative to its own G_nn, whose answer is followed to rigid contacts; the least, and the
# factor between
COMPLIANCE, RIGID, _STIFFER = 1e-4, 1e-9, 0.1
# the largest compliance
_SOFT = 1.0
# returned where percussions grow without bound as compliance falls
UNBOUNDED = -1.0
# residual of the problems within an iteration
_CLOSE = 1e-12
# proximal point iteration: first weight, its factor, least weight, most iterations
_WEIGHT, _LESS, _LEAST, _MOST_PROXIMAL = 1.0, 0.3, 1e-9, 40
# sweeps of the first round, their factor from round to round; Newton steps after each, and errors remembered in them
_FIRST_SWEEPS, _MORE_SWEEPS, _STEPS, _REMEMBERED = 3, 3, 60, 3
# Newton's method may go on without end: after few sweeps it has so many steps, after many one for each so many sweeps
_FEW_STEPS, _SWEEPS_A_STEP = 20, 4
# rounds of sweeps
_ROUNDS = 7
_HELD_STEPS, _POLISHING_SWEEPS = 30, 300
# percussions that grow by such a factor in so many steps of compliance have no limit
_GROWTH, _MOST_GROWTHS = 5.0, 3
# a residual up to this is a solution, of which last digits are left to cheap methods
_SOLVED = 1e-9
# Newton steps of a round; a fruitful one leaves less than this part of the residual
_ROUND, _LEFT = 3, 0.5
# shifts of the attempts by Newton's method, and the fruitless rounds that end each: the last shift costs no digits
_SHIFTS, _FRUITLESS = (1e-7, 1e-6, 1e-8, 1e-9, SHIFT), (2, 2, 2, 3, 4)
# shift of dependent rows: less of the rounding gets into percussions that the velocity does not depend on
_HELD_SHIFT = 1e-7
# a smaller shift is tried as long as the last one left less than this part of the residual
_GAIN = 0.9


@kernel("f8(f8[::1], f8, f8, f8[::1])")
def keep_better(trial: Array, residual: float, best: float, p: Array) -> float:
    """Copy a trial to p if its residual is less than the best so far; return the lesser of both."""
    # written so that a NaN is not kept
    if residual < best:
        best = residual
        for i in range(len(p)):
            p[i] = trial[i]
    return best


@kernel("f8(Delassus, f8[::1], f8[::1], f8, f8[::1])")
def proximal_newton(law: Delassus, b: Array, mu: Array, limit: float, p: Array) -> float:
    """Improve percussions by proximal point iterations with Newton's method inside; return the residual.

    The arguments are those of `newton_coulomb`; p is the start and receives the best found. Each iteration solves the
    law with G + weight I and b - weight p. A large weight decouples the contacts.
    """
    n = len(b)
    c, u, point = np.empty(n), np.empty(n), p.copy()
    best, weight = np.inf, _WEIGHT
    for _ in range(_MOST_PROXIMAL):
        for i in range(n):
            c[i] = b[i] - weight * point[i]
        newton_coulomb(soften(law, weight), c, mu, 15, 1e-3 * limit if weight < 1e-5 else 1e-6, SHIFT, 3, point)
        largest = contact_velocities(law.G, b, point, u)
        best = keep_better(point, coulomb_defect(u, point, mu) / largest, best, p)
        if best <= limit:
            break
        weight = max(_LESS * weight, _LEAST)
    return best


@kernel("f8(Delassus, f8[::1], f8[::1], f8, f8[::1])")
def sweeps_and_newton(law: Delassus, b: Array, mu: Array, limit: float, p: Array) -> float:
    """Improve percussions by ever more sweeps, each time with Newton's method after them; return the residual.

    The arguments are those of `newton_coulomb`; p is the start and receives the best found.
    """
    trial, swept, order = np.empty(len(b)), p.copy(), np.empty(len(mu), np.int64)
    closing_order(b, order)
    best, sweeps = np.inf, _FIRST_SWEEPS
    for _ in range(_ROUNDS):
        best = keep_better(swept, sweep_contacts(law.G, b, mu, order, sweeps, limit, swept), best, p)
        if best <= limit:
            break
        keep_better(swept, 0.0, 1.0, trial)
        steps = min(max(_FEW_STEPS, sweeps // _SWEEPS_A_STEP), _STEPS)
        residual = newton_coulomb(law, b, mu, steps, limit, SHIFT, _REMEMBERED, trial)
        best = keep_better(trial, residual, best, p)
        if best <= limit:
            break
        sweeps *= _MORE_SWEEPS
    return best


@kernel("f8(Delassus, f8[::1], f8[::1], f8, i8, f8[::1])")
def newton_in_rounds(law: Delassus, b: Array, mu: Array, limit: float, attempt: int, p: Array) -> float:
    """Improve percussions by rounds of Newton's method as long as they gain digits; return the residual.

    Where rows depend on each other, steps may go on without end, between residuals just above the limit or far above.

    Parameters
    ----------
    law, b, mu, limit
        See `newton_coulomb`.
    attempt : int
        The number of the shift of dependent rows.
    p : ndarray, shape (n,)
        The start, which receives the best found.
    """
    trial, best, fruitless = p.copy(), np.inf, 0
    for _ in range(_STEPS // _ROUND):
        last, residual = best, newton_coulomb(law, b, mu, _ROUND, limit, _SHIFTS[attempt], _REMEMBERED, trial)
        best = keep_better(trial, residual, best, p)
        fruitless = 0 if best < _LEFT * last else fruitless + 1
        if best <= limit or fruitless >= (_FRUITLESS[0] if best <= _SOLVED else _FRUITLESS[attempt]):
            break
    return best


@kernel("f8(Delassus, f8[::1], f8[::1], i8[::1], b1, f8, f8[::1])")
def hold_rigid(law: Delassus, b: Array, mu: Array, case: Array, independent: bool, limit: float, p: Array) -> float:
    """Solve the equations of given cases, of dependent rows with ever smaller shifts; return the residual.

    Parameters
    ----------
    law, b, mu, case, limit, p
        See `hold_cases`.
    independent : bool
        Whether rows are independent.
    """
    shift, last = 0.0 if independent else _HELD_SHIFT, np.inf
    residual = hold_cases(law, b, mu, case, _HELD_STEPS, limit, shift, p)
    # where a smaller shift gains nothing, the cases are not those of the answer
    while residual > limit and shift > 1e-3 * SHIFT and residual < _GAIN * last:
        shift, last = 0.1 * shift, residual
        residual = hold_cases(law, b, mu, case, _HELD_STEPS, limit, shift, p)
    return residual


@kernel("f8(Delassus, Delassus, f8[::1], f8[::1], b1, f8, f8[::1])")
def hold_as_compliant(
    law: Delassus, compliant: Delassus, b: Array, mu: Array, independent: bool, limit: float, p: Array
) -> float:
    """Solve the equations of the cases of compliant contacts, whose percussions p holds; return the residual.

    The other arguments are those of `hold_rigid`.
    """
    u, scale, case = np.empty(len(b)), np.empty(len(mu)), np.empty(len(mu), np.int64)
    contact_velocities(compliant.G, b, p, u)
    tangential_scale(compliant.G, scale)
    find_cases(u, p, mu, scale, case)
    return hold_rigid(law, b, mu, case, independent, limit, p)


@kernel("f8(Delassus, f8[::1], f8[::1], b1, b1, f8, f8, f8[::1])")
def stiffen(
    law: Delassus, b: Array, mu: Array, independent: bool, patient: bool, compliance: float, limit: float, p: Array
) -> float:
    """Follow the answer of compliant contacts as they get stiffer; write the best found and return its residual.

    Where percussions grow as compliance falls, as where the law has no solution, this ends with `UNBOUNDED`.

    Parameters
    ----------
    law, b, mu, limit
        See `newton_coulomb`.
    independent : bool
        Whether rows are independent.
    patient : bool
        Whether to go on by sweeps where Newton's method does not solve the law of compliant contacts soon; else this
        ends there.
    compliance : float
        That of the contacts whose percussions p holds.
    p : ndarray, shape (n,)
        See `compliance`; receives the best found.
    """
    n = len(b)
    soft, trial, best = p.copy(), np.empty(n), np.inf
    size, growths = np.inf, 0
    while compliance > RIGID and best > _SOLVED:
        compliance *= _STIFFER
        compliant = soften(law, compliance)
        steps = _STEPS if patient else _FEW_STEPS
        if newton_coulomb(compliant, b, mu, steps, _CLOSE, 1e-2 * SHIFT, _REMEMBERED, soft) > _CLOSE:
            if not patient:
                break
            sweeps_and_newton(compliant, b, mu, _CLOSE, soft)
        keep_better(soft, 0.0, 1.0, trial)
        best = keep_better(trial, hold_as_compliant(law, compliant, b, mu, independent, limit, trial), best, p)
        last, size = size, 0.0
        for i in range(n):
            size = max(size, abs(soft[i]))
        growths = growths + 1 if compliance < COMPLIANCE and size > _GROWTH * last else 0
        if growths == _MOST_GROWTHS:
            return UNBOUNDED
    return best


@kernel("f8(Delassus, f8[::1], f8[::1], b1, f8, f8, f8[::1], f8[::1])")
def improve_coulomb(
    law: Delassus, b: Array, mu: Array, independent: bool, residual: float, limit: float, soft: Array, p: Array
) -> float:
    """Improve percussions of a given residual by one method after the other; return the residual reached.

    Parameters
    ----------
    law, b, mu, limit
        See `newton_coulomb`.
    independent : bool
        Whether rows are independent.
    residual : float
        That of p.
    soft : ndarray, shape (n,)
        Percussions of contacts with COMPLIANCE.
    p : ndarray, shape (n,)
        The start, which receives the best found.
    """
    trial, order = np.empty(len(b)), np.empty(len(mu), np.int64)
    newton = len(_SHIFTS)
    for attempt in range(newton + 5):
        if residual <= _SOLVED:
            break
        keep_better(soft if attempt == newton + 1 or attempt == newton + 3 else p, 0.0, 1.0, trial)
        if attempt < newton:
            found = newton_in_rounds(law, b, mu, limit, attempt, trial)
        elif attempt == newton:
            closing_order(b, order)
            found = sweep_contacts(law.G, b, mu, order, _POLISHING_SWEEPS, limit, trial)
        elif attempt == newton + 1:
            found = stiffen(law, b, mu, independent, False, COMPLIANCE, limit, trial)
            if found == UNBOUNDED:
                continue
        elif attempt == newton + 2:
            found = proximal_newton(law, b, mu, limit, trial)
        elif attempt == newton + 3:
            found = stiffen(law, b, mu, independent, True, COMPLIANCE, limit, trial)
            if found == UNBOUNDED:
                # very compliant contacts may be those of another answer
                for i in range(len(p)):
                    trial[i] = 0.0
                found = stiffen(law, b, mu, independent, True, _SOFT, limit, trial)
            if found == UNBOUNDED:
                break
        else:
            found = sweeps_and_newton(law, b, mu, limit, trial)
        residual = keep_better(trial, found, residual, p)
    if limit < residual <= _SOLVED:
        keep_better(p, 0.0, 1.0, trial)
        residual = keep_better(trial, newton_in_rounds(law, b, mu, limit, newton - 1, trial), residual, p)
    return residual
