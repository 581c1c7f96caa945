"""Kernels of Newton's method for Coulomb's law: the equation of P. Alart and A. Curnier (1991), cases held or free."""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ..metric import Array
from .one_contact import contact_velocities, coulomb_defect

OPEN, STICK, SLIP = 0, 1, 2
# added to the diagonal of G in derivatives only: rows may depend on each other
SHIFT = 1e-10
_MOST_HALVINGS = 4
# share of the slope by which the line search must lower the squared error
_DECREASE = 1e-4


@kernel("void(f8[:,::1], f8[::1])")
def tangential_scale(G: Array, scale: Array) -> None:
    """Write the inverse of the largest eigenvalue of each contact's tangential block, shape (m,): any axes give it."""
    for a in range(len(scale)):
        i = 3 * a
        mean, half = 0.5 * (G[i + 1, i + 1] + G[i + 2, i + 2]), 0.5 * (G[i + 1, i + 1] - G[i + 2, i + 2])
        largest = mean + np.sqrt(half * half + G[i + 1, i + 2] ** 2)
        scale[a] = 1.0 / largest if largest > 0.0 else 1.0


@kernel("void(f8[::1], f8[::1], f8[::1], f8[::1], i8[::1])")
def find_cases(u: Array, p: Array, mu: Array, scale: Array, case: Array) -> None:
    """Write which case of the law each contact is nearest to, shape (m,): OPEN, STICK or SLIP.

    u, p, mu: see `coulomb_defect`; `scale`: see `tangential_scale`. A closed contact without friction slips.
    """
    for a in range(len(mu)):
        i = 3 * a
        normal = p[i] - u[i]
        t, s = p[i + 1] - scale[a] * u[i + 1], p[i + 2] - scale[a] * u[i + 2]
        if normal <= 0.0:
            case[a] = OPEN
        else:
            case[a] = STICK if mu[a] != 0.0 and np.sqrt(t * t + s * s) <= abs(mu[a]) * normal else SLIP


@kernel("f8(f8[::1], f8[::1], f8[::1], f8[::1], i8[::1], f8[::1])")
def case_error(u: Array, p: Array, mu: Array, scale: Array, case: Array, error: Array) -> float:
    """Write by how much each contact violates the equations of its case, shape (3 m,); return the sum of squares."""
    total = 0.0
    for a in range(len(mu)):
        i = 3 * a
        if case[a] == OPEN:
            error[i], error[i + 1], error[i + 2] = p[i], p[i + 1], p[i + 2]
        else:
            error[i] = u[i]
            error[i + 1], error[i + 2] = scale[a] * u[i + 1], scale[a] * u[i + 2]
            if case[a] == SLIP:
                t, s = p[i + 1] - error[i + 1], p[i + 2] - error[i + 2]
                length = np.sqrt(t * t + s * s)
                factor = abs(mu[a]) * (p[i] - u[i]) / length if length > 0.0 else 0.0
                error[i + 1], error[i + 2] = p[i + 1] - factor * t, p[i + 2] - factor * s
        total += error[i] ** 2 + error[i + 1] ** 2 + error[i + 2] ** 2
    return total


@kernel("b1(f8[:,::1], f8[::1], i8)")
def solve_linear(A: Array, y: Array, n: int) -> bool:
    """Overwrite n entries of y by A^-1 y, and A by its factors; False if A is singular."""
    # behind the last entry of each row that is not zero: contacts of different bodies are not coupled
    end = np.empty(n, np.int64)
    for i in range(n):
        end[i] = n
        while end[i] > 0 and A[i, end[i] - 1] == 0.0:
            end[i] -= 1
    for k in range(n):
        pivot = k
        for i in range(k + 1, n):
            if abs(A[i, k]) > abs(A[pivot, k]):
                pivot = i
        # written so that a NaN is refused too
        if not abs(A[pivot, k]) > 1e-300:
            return False
        if pivot != k:
            y[k], y[pivot] = y[pivot], y[k]
            end[k], end[pivot] = end[pivot], end[k]
            for j in range(k, n):
                A[k, j], A[pivot, j] = A[pivot, j], A[k, j]
        # two rows at once: the row of the pivot is read half as often
        for i in range(k + 1, n - 1, 2):
            a, b = A[i, k] / A[k, k], A[i + 1, k] / A[k, k]
            if a != 0.0 or b != 0.0:
                y[i], y[i + 1] = y[i] - a * y[k], y[i + 1] - b * y[k]
                end[i], end[i + 1] = max(end[i], end[k]), max(end[i + 1], end[k])
                for j in range(k + 1, end[k]):
                    A[i, j], A[i + 1, j] = A[i, j] - a * A[k, j], A[i + 1, j] - b * A[k, j]
        if (n - k) % 2 == 0:
            a = A[n - 1, k] / A[k, k]
            y[n - 1] -= a * y[k]
            end[n - 1] = max(end[n - 1], end[k])
            for j in range(k + 1, end[k]):
                A[n - 1, j] -= a * A[k, j]
    for k in range(n - 1, -1, -1):
        for j in range(k + 1, end[k]):
            y[k] -= A[k, j] * y[j]
        y[k] /= A[k, k]
    return True


@kernel("b1(f8[:,::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], i8[::1], f8, f8[:,::1], f8[::1], i8[::1], f8[::1])")
def newton_direction(
    G: Array, u: Array, p: Array, mu: Array, scale: Array, error: Array, case: Array, shift: float, A: Array,
    y: Array, place: Array, step: Array,
) -> bool:  # fmt: skip
    """Write the Newton step of the equations of given cases; False if their matrix is singular.

    The percussions of open contacts and, without friction, those of tangents are no unknowns: they become 0.

    Parameters
    ----------
    G, u, p, mu, scale, error, case
        See `newton_coulomb`.
    shift : float
        Added to the diagonal of G in the derivative only.
    A, y, place : ndarray, shapes (n, n), (n,) and (n,)
        Overwritten.
    step : ndarray, shape (n,)
        Receives the step of p.
    """
    m, n, k = len(mu), len(p), 0
    for a in range(m):
        for j in range(3 * a, 3 * a + 3):
            if case[a] != OPEN and (mu[a] > 0.0 or j == (3 * a if mu[a] == 0.0 else 3 * a + 1)):
                place[k], step[j] = j, 0.0
                k += 1
            elif mu[a] < 0.0 and j == 3 * a:
                step[j] = -u[j] / G[j, j]
            else:
                step[j] = -p[j]
    r = 0
    while r < k:
        i = place[r]
        a = i // 3
        if mu[a] < 0.0:
            # the friction of a joint: its velocity vanishes, or its percussion is known
            slips, known = case[a] == SLIP, 0.0
            for j in range(n):
                known += G[i, j] * step[j]
            y[r] = -error[i] - (0.0 if slips else scale[a] * known)
            for c in range(k):
                A[r, c] = 0.0 if slips else scale[a] * G[i, place[c]]
            A[r, r] += 1.0 if slips else scale[a] * shift
            r += 1
            continue
        # what the known steps change
        o0 = o1 = o2 = 0.0
        for j in range(n):
            if step[j] != 0.0:
                o0, o1, o2 = o0 + G[i, j] * step[j], o1 + G[i + 1, j] * step[j], o2 + G[i + 2, j] * step[j]
        y[r] = -error[i] - o0
        if mu[a] == 0.0:
            for c in range(k):
                A[r, c] = G[i, place[c]]
            A[r, r] += shift
            r += 1
            continue
        # error of the tangents: T u + S p with 2 x 2 matrices T, S of rates, and the column of the normal
        s11, s12, s22, d1, d2 = 0.0, 0.0, 0.0, 0.0, 0.0
        t11, t12, t22 = scale[a], 0.0, scale[a]
        if case[a] == SLIP:
            x, z = p[i + 1] - scale[a] * u[i + 1], p[i + 2] - scale[a] * u[i + 2]
            length = max(np.sqrt(x * x + z * z), 1e-300)
            x, z = x / length, z / length
            f = mu[a] * (p[i] - u[i]) / length
            t11, t12, t22 = scale[a] * f * (1.0 - x * x), -scale[a] * f * x * z, scale[a] * f * (1.0 - z * z)
            s11, s12, s22 = 1.0 - f * (1.0 - x * x), f * x * z, 1.0 - f * (1.0 - z * z)
            d1, d2 = mu[a] * x, mu[a] * z
        y[r + 1] = -error[i + 1] - t11 * o1 - t12 * o2 - d1 * o0
        y[r + 2] = -error[i + 2] - t12 * o1 - t22 * o2 - d2 * o0
        for c in range(k):
            j = place[c]
            g0, g1, g2 = G[i, j], G[i + 1, j], G[i + 2, j]
            if c == r:
                g0 += shift
            elif c == r + 1:
                g1 += shift
            elif c == r + 2:
                g2 += shift
            A[r, c] = g0
            A[r + 1, c] = t11 * g1 + t12 * g2 + d1 * g0
            A[r + 2, c] = t12 * g1 + t22 * g2 + d2 * g0
        A[r + 1, r], A[r + 2, r] = A[r + 1, r] - d1, A[r + 2, r] - d2
        A[r + 1, r + 1], A[r + 1, r + 2] = A[r + 1, r + 1] + s11, A[r + 1, r + 2] + s12
        A[r + 2, r + 1], A[r + 2, r + 2] = A[r + 2, r + 1] + s12, A[r + 2, r + 2] + s22
        r += 3
    if not solve_linear(A, y, k):
        return False
    for c in range(k):
        step[place[c]] = y[c]
    return True


@kernel("f8(f8[:,::1], f8[::1], f8[::1], i8, f8, f8, i8, f8[::1])")
def newton_coulomb(
    G: Array, b: Array, mu: Array, most: int, limit: float, shift: float, remembered: int, p: Array
) -> float:
    """Improve percussions by a semismooth Newton method with a line search; return the residual.

    Parameters
    ----------
    G : ndarray, shape (n, n), n = 3 m
        Positive semidefinite with unit normal entries, symmetric but for contacts that are bounded by others.
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
    A, u, error, trial, step, y = room[5:], room[0], room[1], room[2], room[3], room[4]
    place, case = np.empty(n, np.int64), np.empty(m, np.int64)
    largest = contact_velocities(G, b, p, u)
    if largest == 0.0:
        for i in range(n):
            p[i] = 0.0
        return 0.0
    tangential_scale(G, scale)
    find_cases(u, p, mu, scale, case)
    value = case_error(u, p, mu, scale, case, error)
    for k in range(remembered):
        recent[k] = value
    residual = coulomb_defect(u, p, mu) / largest
    for iteration in range(most):
        if residual <= limit or not newton_direction(G, u, p, mu, scale, error, case, shift, A, y, place, step):
            break
        highest, length = 0.0, 1.0
        for k in range(remembered):
            highest = max(highest, recent[k])
        for _ in range(_MOST_HALVINGS):
            for i in range(n):
                trial[i] = p[i] + length * step[i]
            contact_velocities(G, b, trial, u)
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


@kernel("f8(f8[:,::1], f8[::1], f8[::1], i8[::1], i8, f8, f8, f8[::1])")
def hold_cases(G: Array, b: Array, mu: Array, case: Array, most: int, limit: float, shift: float, p: Array) -> float:
    """Improve percussions by Newton steps within given cases, shape (m,), as long as they help; return the residual.

    The other arguments are those of `newton_coulomb`. p becomes the best found.
    """
    n, m = len(b), len(mu)
    room, scale, place = np.empty((n + 5, n)), np.empty(m), np.empty(n, np.int64)
    A, u, error, trial, step, y = room[5:], room[0], room[1], room[2], room[3], room[4]
    for i in range(n):
        trial[i] = p[i]
    largest, best, worse = contact_velocities(G, b, p, u), np.inf, 0
    tangential_scale(G, scale)
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
        if not newton_direction(G, u, trial, mu, scale, error, case, shift, A, y, place, step):
            break
        for i in range(n):
            trial[i] += step[i]
        contact_velocities(G, b, trial, u)
    return best


@kernel("f8(f8[:,::1], f8[::1], f8[::1], i8, f8, f8[::1])")
def resume_newton(G: Array, b: Array, mu: Array, most: int, limit: float, p: Array) -> float:
    """Improve percussions that are nearly right by full Newton steps, at least one; return the residual.

    The arguments are those of `newton_coulomb`.
    """
    n, m = len(b), len(mu)
    room, scale, place, case = np.empty((n + 4, n)), np.empty(m), np.empty(n, np.int64), np.empty(m, np.int64)
    A, u, error, step, y = room[4:], room[0], room[1], room[2], room[3]
    largest, residual = contact_velocities(G, b, p, u), np.inf
    tangential_scale(G, scale)
    for _ in range(most):
        find_cases(u, p, mu, scale, case)
        case_error(u, p, mu, scale, case, error)
        if not newton_direction(G, u, p, mu, scale, error, case, 0.0, A, y, place, step):
            break
        for i in range(n):
            p[i] += step[i]
        contact_velocities(G, b, p, u)
        residual = coulomb_defect(u, p, mu) / largest
        if residual <= limit:
            break
    return residual
