"""Kernels of an impact with Coulomb friction: from rows and velocities to percussions, cases and the residual."""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ..metric import Array
from ..row_speeds import row_speeds
from .few_contacts import MOST_CONTACTS, couples_weakly, independent_rows, solve_coulomb
from .newton.cases import STICK, find_cases, tangential_scale
from .newton.directions import Delassus, without_rows
from .newton.iterations import resume_newton
from .one_contact import closing_order, coulomb_defect, sweep_contacts
from .quick import MOST_NEWTON, quick_coulomb
from .sticking.carried import diagonal_blocks, list_columns, solve_carried

# what is known of the last problem: nothing, its percussions where they were unique, else those of compliant contacts
NOTHING, UNIQUE, COMPLIANT = 0, 1, 2
_RESUMED_STEPS = 6
# fewest contacts among which some may be carried
FEWEST_WITH_CARRIED = 8
# most sweeps over more contacts, and their multiplications, about two seconds
_MOST_SWEEPS, _WORK = 20_000, 2e9
# error of a speed by rounding, relative to the terms that cancel in it
_ROUNDING = 4e-15


@kernel("void(i8[::1], f8[:,::1])")
def bind(bound: Array, G: Array) -> None:
    """Write the rows of G, shape (3 m, 3 m), that bind normal percussions of contacts to those which bound them.

    Where a tangent is a zero row, the percussion along it is 0.
    """
    for a in range(len(bound)):
        if bound[a] >= 0:
            i = 3 * a
            G[i, 3 * bound[a]] = -1.0
            G[i, i] = 1.0
            for j in (i + 1, i + 2):
                if G[j, j] == 0.0:
                    G[j, j] = 1.0


@kernel("void(f8[:,::1], f8[:,::1], f8[::1], i8[::1], f8[:,::1], f8[::1])")
def delassus(J: Array, A: Array, mu: Array, bound: Array, G: Array, scale: Array) -> None:
    """Write J A', shape (n, n), scaled to unit normal entries, and the scale of each contact, shape (m,).

    A contact whose normal row vanishes has the scale 0, and zeros in G. The friction of a joint and contacts that are
    bounded by others have the scale of their longer tangent.
    """
    m, nv = len(scale), J.shape[1]
    moved = np.empty(nv, np.int64)
    for a in range(m):
        i, count = 3 * a, 0
        # a contact touches few of many bodies
        for k in range(nv):
            if J[i, k] != 0.0 or J[i + 1, k] != 0.0 or J[i + 2, k] != 0.0:
                moved[count] = k
                count += 1
        # its own block first: it gives the scale
        for c in range(a, -1, -1):
            j = 3 * c
            s00 = s01 = s02 = s10 = s11 = s12 = s20 = s21 = s22 = 0.0
            for n in range(count):
                k = moved[n]
                x, y, z = J[i, k], J[i + 1, k], J[i + 2, k]
                f, g, h = A[j, k], A[j + 1, k], A[j + 2, k]
                s00, s01, s02 = s00 + x * f, s01 + x * g, s02 + x * h
                s10, s11, s12 = s10 + y * f, s11 + y * g, s12 + y * h
                s20, s21, s22 = s20 + z * f, s21 + z * g, s22 + z * h
            if c == a:
                size = s00 if mu[a] >= 0.0 and bound[a] < 0 else max(s11, s22)
                scale[a] = 1.0 / np.sqrt(size) if size > 0.0 else 0.0
                s01, s02, s12 = 0.5 * (s01 + s10), 0.5 * (s02 + s20), 0.5 * (s12 + s21)
                s10, s20, s21 = s01, s02, s12
            f = scale[a] * scale[c]
            G[i, j], G[i, j + 1], G[i, j + 2] = f * s00, f * s01, f * s02
            G[i + 1, j], G[i + 1, j + 1], G[i + 1, j + 2] = f * s10, f * s11, f * s12
            G[i + 2, j], G[i + 2, j + 1], G[i + 2, j + 2] = f * s20, f * s21, f * s22
            for r in range(3):
                for q in range(3):
                    G[j + q, i + r] = G[i + r, j + q]
        if mu[a] < 0.0:
            G[3 * a, 3 * a] = 1.0
            if scale[a] == 0.0:
                # an equality holds this joint, and its friction moves nothing
                G[3 * a + 1, 3 * a + 1] = 1.0
    bind(bound, G)


@kernel("f8(f8[:,::1], f8[:,::1], f8[::1], f8[::1], f8[::1], i8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[:,::1])")
def apply_percussions(
    J: Array, A: Array, x: Array, lower: Array, mu: Array, bound: Array, scale: Array, p: Array, u: Array, w: Array,
    table: Array,
) -> float:  # fmt: skip
    """Write the velocity that scaled percussions p bring about, and scaled velocities u; return `coulomb_defect`.

    The other arguments are those of `coulomb_law` and `delassus`.
    """
    n, nv = J.shape
    for k in range(nv):
        w[k] = x[k]
    for i in range(n):
        table[0, i] = p[i] * scale[i // 3]
        if p[i] != 0.0:
            for k in range(nv):
                w[k] += table[0, i] * A[i, k]
    row_speeds(J, w, 1.0, table[2])
    for i in range(n):
        u[i] = (table[2, i] - lower[i]) * scale[i // 3]
        if i % 3 == 0 and (mu[i // 3] < 0.0 or bound[i // 3] >= 0):
            # that of the velocity which has this percussion in any case
            table[0, i], u[i] = 0.0, 0.0
    return coulomb_defect(u, p, mu)


@kernel("Tuple((b1, f8))(f8[:,::1], f8[::1], f8[::1], f8[::1], f8[:,::1])")
def free_speeds(J: Array, x: Array, lower: Array, mu: Array, table: Array) -> tuple[bool, float]:
    """Write zero percussions and twice J x; return whether some contact closes, and the largest terms that cancel.

    The arguments are those of `coulomb_law`.
    """
    closing, cancelled = False, 0.0
    for i in range(0, len(J), 3):
        # three sums side by side wait less for each other
        a = b = c = e = f = g = 0.0
        for k in range(J.shape[1]):
            p, q, r = J[i, k] * x[k], J[i + 1, k] * x[k], J[i + 2, k] * x[k]
            a, b, c, e, f, g = a + p, b + q, c + r, e + abs(p), f + abs(q), g + abs(r)
        table[0, i] = table[0, i + 1] = table[0, i + 2] = 0.0
        for row in (1, 2):
            table[row, i], table[row, i + 1], table[row, i + 2] = a, b, c
        cancelled = max(cancelled, e, f, g)
        # a speed within rounding of the terms that cancel in it closes nothing
        closing = closing or not a >= lower[i] - 1e-13 * e
        closing = closing or (mu[i // 3] < 0.0 and (a != 0.0 or b != 0.0 or c != 0.0))
    return closing, cancelled


@kernel("f8(f8[:,::1], f8[::1], f8[::1], f8, f8, f8[::1])")
def scale_speeds(table: Array, lower: Array, scale: Array, cancelled: float, limit: float, b: Array) -> float:
    """Write the scaled velocities J x - lower, shape (n,); return the largest scaled speed.

    At least such that the rounding of terms which cancel is a residual within the limit. It is inf where a contact that
    moves nothing demands a positive rate. The arguments are those of `coulomb_law` and `free_speeds`.
    """
    largest, rounding = 0.0, max(1e-9, _ROUNDING / limit) * cancelled
    for i in range(len(b)):
        s = scale[i // 3]
        if i % 3 == 0 and s == 0.0 and lower[i] > 0.0:
            return np.inf
        b[i] = (table[1, i] - lower[i]) * s
        largest = max(largest, abs(table[1, i]) * s, abs(b[i]), rounding * s)
    return largest


@kernel("void(f8[::1], i8[::1], f8[::1], f8, f8[::1], f8[::1])")
def scale_cones(mu: Array, bound: Array, scale: Array, largest: float, b: Array, cone: Array) -> None:
    """Write the coefficients of scaled contacts, shape (m,), and the velocities b of normals of the friction of joints.

    Of a joint |p_t| <= -mu becomes |p_t| <= -cone p_n, with the known p_n at most the largest scaled speed. A contact
    and the one that it is bounded by have scales of their own.
    """
    for a in range(len(mu)):
        cone[a] = mu[a]
        if mu[a] < 0.0:
            most = -mu[a] / scale[a] if scale[a] > 0.0 else 1.0
            known = min(most, largest)
            b[3 * a], cone[a] = -known, -most / known
        elif bound[a] >= 0:
            cone[a] = mu[a] * scale[bound[a]] / scale[a] if scale[a] > 0.0 else 0.0


@kernel("void(f8[::1], i8[::1], f8[::1], f8[::1])")
def set_bounds(mu: Array, bound: Array, b: Array, p: Array) -> None:
    """Write the normal percussions of the friction of joints, which are known, and of contacts bounded by others."""
    for a in range(len(mu)):
        if mu[a] < 0.0:
            p[3 * a] = -b[3 * a]
        elif bound[a] >= 0:
            p[3 * a] = p[3 * bound[a]]


@kernel("b1(Delassus, f8[::1], f8[::1], i8[::1], i8, f8, f8[::1], f8[::1])")
def solve_scaled(
    law: Delassus, b: Array, mu: Array, bound: Array, known: int, limit: float, soft: Array, p: Array
) -> bool:
    """Write percussions p of the law for scaled rows; return whether they are known to be unique.

    Parameters
    ----------
    law, b, mu, limit
        See `few_contacts.solve_coulomb`.
    bound, known
        See `coulomb_law`.
    soft, p : ndarray, shape (n,)
        Percussions to start from, of which p is a copy. Where the answer is not unique, `soft` receives those of
        compliant contacts.
    """
    G, m, contacts = law.G, len(mu), 0
    for a in range(m):
        contacts += mu[a] >= 0.0
    if contacts > MOST_CONTACTS or m > MOST_NEWTON:
        if m > MOST_NEWTON or not quick_coulomb(law, b, mu, limit, p) <= limit:
            order = np.empty(m, np.int64)
            closing_order(b, order)
            sweep_contacts(G, b, mu, order, min(_MOST_SWEEPS, int(_WORK / G.size)), limit, p)
        return False
    weak, independent = couples_weakly(G, mu), independent_rows(G, mu, bound)
    unique = independent and weak
    residual = np.inf
    if unique and known != NOTHING:
        residual = resume_newton(law, b, mu, _RESUMED_STEPS, limit, p)
    # written so that a NaN is refused too
    if not residual <= limit:
        solve_coulomb(law, b, mu, limit, independent, weak and known == COMPLIANT, soft, p)
    return unique


@kernel(
    "Tuple((f8, b1))(f8[:,::1], f8[:,::1], f8[::1], f8[::1], f8[::1], i8[::1], i8, f8, f8[::1], f8, f8[:,::1], "
    "f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[::1], f8[:,::1])"
)
def carried_law(
    J: Array, A: Array, x: Array, lower: Array, mu: Array, bound: Array, known: int, limit: float, start: Array,
    cancelled: float, G: Array, scale: Array, b: Array, p: Array, soft: Array, u: Array, w: Array, table: Array,
) -> tuple[float, bool]:  # fmt: skip
    """Write what `coulomb_law` does where bodies stick at one contact; see `carried`.

    The other arguments are those of `coulomb_law`, and what it needs.

    Returns
    -------
    residual : float
        As of `coulomb_law`; inf where too few bodies stick, and where other kinds of contacts are among them.
    unique : bool
        As of `coulomb_law`.
    """
    n, nv = J.shape
    for a in range(len(mu)):
        if mu[a] < 0.0 or bound[a] >= 0:
            return np.inf, False
    columns, counts, owner = np.empty((len(mu), nv), np.int64), np.empty(len(mu), np.int64), np.empty(nv, np.int64)
    list_columns(J, A, columns, counts, owner)
    if not diagonal_blocks(J, A, columns, counts, G, scale):
        return np.inf, False
    largest = scale_speeds(table, lower, scale, cancelled, limit, b)
    for i in range(n):
        p[i] = soft[i] = start[i] / scale[i // 3]
    found, unique = solve_carried(J, A, G, scale, b, mu, owner, columns, counts, known == UNIQUE, limit, soft, p)
    if not found:
        return np.inf, False
    return apply_percussions(J, A, x, lower, mu, bound, scale, p, u, w, table) / largest, unique


@kernel(
    "Tuple((f8, b1))(f8[:,::1], f8[:,::1], f8[::1], f8[::1], f8[::1], i8[::1], i8, f8, f8[::1], f8, f8[::1], "
    "f8[:,::1], i8[::1])"
)
def law_of_all(
    J: Array, A: Array, x: Array, lower: Array, mu: Array, bound: Array, known: int, limit: float, start: Array,
    cancelled: float, w: Array, table: Array, case: Array,
) -> tuple[float, bool]:  # fmt: skip
    """Write what `coulomb_law` does for contacts of which some close, all at once.

    `cancelled` and `table` are those of `free_speeds`; the other arguments, and the result, those of `coulomb_law`.
    """
    n = len(J)
    m = n // 3
    G, scale, tangential, cone = np.empty((n, n)), np.empty(m), np.empty(m), np.empty(m)
    b, p, soft, u = np.empty(n), np.empty(n), np.empty(n), np.empty(n)
    residual, unique = np.inf, False
    if known != NOTHING and FEWEST_WITH_CARRIED <= m <= MOST_CONTACTS:
        residual, unique = carried_law(
            J, A, x, lower, mu, bound, known, limit, start, cancelled, G, scale, b, p, soft, u, w, table
        )
        for a in range(m):
            cone[a] = mu[a]
    # written so that a NaN is refused too
    if not residual <= limit:
        delassus(J, A, mu, bound, G, scale)
        largest = scale_speeds(table, lower, scale, cancelled, limit, b)
        if largest == np.inf:
            return np.inf, False
        # of contacts that move nothing all scaled speeds vanish
        largest = largest if largest > 0.0 else 1.0
        scale_cones(mu, bound, scale, largest, b, cone)
        for i in range(n):
            s = scale[i // 3]
            p[i] = start[i] / s if known != NOTHING and s > 0.0 else 0.0
        set_bounds(mu, bound, b, p)
        for i in range(n):
            soft[i] = p[i]
        law, plain = Delassus(G, J, A, scale, 0.0), True
        for a in range(m):
            plain = plain and bound[a] < 0
        unique = solve_scaled(law if plain else without_rows(G), b, cone, bound, known, limit, soft, p)
        # the residual shall be that of the percussions which bound others
        set_bounds(mu, bound, b, p)
        residual = apply_percussions(J, A, x, lower, cone, bound, scale, p, u, w, table) / largest
    tangential_scale(G, tangential)
    find_cases(u, p, cone, tangential, case)
    for i in range(n):
        start[i] = table[0, i] if unique else soft[i] * scale[i // 3]
        if mu[i // 3] < 0.0 and i % 3 == 1 and case[i // 3] == STICK:
            # a joint that sticks does not creep by rounding; a hinge between bodies has several velocities
            count = last = 0
            for k in range(len(w)):
                if J[i, k] != 0.0:
                    count, last = count + 1, k
            if count == 1:
                w[last] = table[2, i] = 0.0
    return residual, unique
