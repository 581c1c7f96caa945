"""Kernels of Newton's method for Coulomb's law, with cases that are held or free."""

from __future__ import annotations

import numpy as np

from ....compiled import kernel
from ...metric import Array
from ..one_contact import contact_velocities, coulomb_defect
from .cases import case_error, find_cases, tangential_scale
from .directions import Delassus, newton_direction

# added to the diagonal of G in derivatives only: rows may depend on each other
SHIFT = 1e-10
_MOST_HALVINGS = 4
# share of the slope by which the line search must lower the squared error
_DECREASE = 1e-4


@kernel("f8(Delassus, f8[::1], f8[::1], i8, f8, f8, i8, f8[::1])")
def newton_coulomb(
    law: Delassus, b: Array, mu: Array, most: int, limit: float, shift: float, remembered: int, p: Array
) -> float:
    """Improve percussions by a semismooth Newton method with a line search; return the residual.

    Parameters
    ----------
    law : Delassus
        Whose G, shape (n, n), n = 3 m, gives the velocities of percussions.
    b, mu, p : ndarray, shapes (n,), (m,) and (n,)
        Velocities without percussions, coefficients of friction, and the start, which receives the result.
    most : int
        Most steps.
    limit : float
        Relative residual that ends them.
    shift : float
        See `newton_direction`.
    remembered : int
        The line search compares the squared error with the largest of so many last ones.
    """
    n, m = len(b), len(mu)
    room, scale, recent = np.empty((n + 5, n)), np.empty(m), np.empty(8)
    K, u, error, trial, step, y = room[5:], room[0], room[1], room[2], room[3], room[4]
    place, case = np.empty(n, np.int64), np.empty(m, np.int64)
    largest = contact_velocities(law.G, b, p, u)
    if largest == 0.0:
        for i in range(n):
            p[i] = 0.0
        return 0.0
    tangential_scale(law.G, scale)
    find_cases(u, p, mu, scale, case)
    value = case_error(u, p, mu, scale, case, error)
    for k in range(remembered):
        recent[k] = value
    residual = coulomb_defect(u, p, mu) / largest
    for iteration in range(most):
        if residual <= limit or not newton_direction(law, u, p, mu, scale, error, case, shift, K, y, place, step):
            break
        highest, length = 0.0, 1.0
        for k in range(remembered):
            highest = max(highest, recent[k])
        for _ in range(_MOST_HALVINGS):
            for i in range(n):
                trial[i] = p[i] + length * step[i]
            contact_velocities(law.G, b, trial, u)
            find_cases(u, trial, mu, scale, case)
            value = case_error(u, trial, mu, scale, case, error)
            if value <= (1.0 - _DECREASE * length) * highest:
                break
            length *= 0.5
        for i in range(n):
            p[i] = trial[i]
        recent[iteration % remembered] = value
        residual = coulomb_defect(u, p, mu) / largest
    return residual


@kernel("f8(Delassus, f8[::1], f8[::1], i8[::1], i8, f8, f8, f8[::1])")
def hold_cases(
    law: Delassus, b: Array, mu: Array, case: Array, most: int, limit: float, shift: float, p: Array
) -> float:
    """Improve percussions by Newton steps within given cases, shape (m,), as long as they help; return the residual.

    The other arguments are those of `newton_coulomb`. p becomes the best found.
    """
    n, m = len(b), len(mu)
    room, scale, place = np.empty((n + 5, n)), np.empty(m), np.empty(n, np.int64)
    K, u, error, trial, step, y = room[5:], room[0], room[1], room[2], room[3], room[4]
    for i in range(n):
        trial[i] = p[i]
    largest, best, worse = contact_velocities(law.G, b, p, u), np.inf, 0
    tangential_scale(law.G, scale)
    for _ in range(most + 1):
        residual = coulomb_defect(u, trial, mu) / largest
        worse += 1
        if residual < best:
            best, worse = residual, 0
            for i in range(n):
                p[i] = trial[i]
        if best <= limit or worse > 1:
            break
        case_error(u, trial, mu, scale, case, error)
        if not newton_direction(law, u, trial, mu, scale, error, case, shift, K, y, place, step):
            break
        for i in range(n):
            trial[i] += step[i]
        contact_velocities(law.G, b, trial, u)
    return best


@kernel("f8(Delassus, f8[::1], f8[::1], i8, f8, f8[::1])")
def resume_newton(law: Delassus, b: Array, mu: Array, most: int, limit: float, p: Array) -> float:
    """Improve percussions that are nearly right by full Newton steps, at least one; return the residual.

    The arguments are those of `newton_coulomb`.
    """
    n, m = len(b), len(mu)
    room, scale, place, case = np.empty((n + 4, n)), np.empty(m), np.empty(n, np.int64), np.empty(m, np.int64)
    K, u, error, step, y = room[4:], room[0], room[1], room[2], room[3]
    largest, residual = contact_velocities(law.G, b, p, u), np.inf
    tangential_scale(law.G, scale)
    for _ in range(most):
        find_cases(u, p, mu, scale, case)
        case_error(u, p, mu, scale, case, error)
        if not newton_direction(law, u, p, mu, scale, error, case, 0.0, K, y, place, step):
            break
        for i in range(n):
            p[i] += step[i]
        contact_velocities(law.G, b, p, u)
        residual = coulomb_defect(u, p, mu) / largest
        if residual <= limit:
            break
    return residual
