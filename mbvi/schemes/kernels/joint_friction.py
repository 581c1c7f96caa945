"""The law for given lower bounds of the rates of gaps, with all that resists as rows of Coulomb's law.

Dry friction of a joint, |tau| <= c, has a percussion of at most h c in a step, and opposes the velocity after it.
Torsional and rolling friction of a contact are bounded by its percussion.
"""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ...constraints.mechanism.tables import MOST_ROWS, RowBuffer, copy_row, rows_for
from ...projection.coulomb.few_contacts import MOST_CONTACTS
from ...projection.coulomb.friction import AIM, EXACT
from ...projection.coulomb.frictional_step import interleave
from ...projection.coulomb.law import COMPLIANT, NOTHING, UNIQUE
from ...projection.coulomb.separate_laws import coulomb_law
from ...projection.tree import factor_again, solve
from ...system.system import Array
from .records import DONE, UNSOLVED, MechanismStep

# rates relative to the terms that cancel in them
_ROUNDING = 1e-13


@kernel("i8(f8[::1])")
def joints_with_friction(friction: Array) -> int:
    """Return how many joints have dry friction; shape (nv,)."""
    count = 0
    for c in friction:
        count += c > 0.0
    return count


@kernel("void(RowBuffer, f8[::1], f8, f8[:,::1], f8[::1])")
def write_wide(rows: RowBuffer, friction: Array, h: float, wide: Array, mu: Array) -> None:
    """Write the normal and the tangents of each contact, then the rows of joints with dry friction.

    Parameters
    ----------
    rows : RowBuffer
        The k contacts.
    friction : ndarray, shape (nv,)
        Largest torques of dry friction [N, N m].
    h : float
        Time step [s].
    wide, mu : ndarray, shapes (3 (k + d), nv) and (k + d,)
        Zeros; receive the rows, and the coefficients of `coulomb_law`.
    """
    a, nv = rows.size[0], wide.shape[1]
    if len(rows.T) > 0:
        interleave(rows.J[:a], rows.T[: 2 * a], wide)
    for i in range(a):
        mu[i] = rows.mu[i] if len(rows.T) > 0 else 0.0
        for k in range(nv if len(rows.T) == 0 else 0):
            wide[3 * i, k] = rows.J[i, k]
    for k in range(nv):
        if friction[k] > 0.0:
            wide[3 * a + 1, k], mu[a] = 1.0, -h * friction[k]
            a += 1


@kernel("i8(RowBuffer, i8)")
def resisting(rows: RowBuffer, c: int) -> int:
    """Return how many contacts have torsional friction, c = 0, or rolling friction, c = 1."""
    count = 0
    for a in range(rows.size[0] if len(rows.R) > 0 else 0):
        count += rows.resistance[a, c] > 0.0
    return count


@kernel("void(RowBuffer, i8, f8[:,::1], f8[::1], i8[::1])")
def write_resistance(rows: RowBuffer, begin: int, wide: Array, mu: Array, bound: Array) -> None:
    """Write rows of torsional friction, then of rolling friction, from contact `begin` of the law on.

    Parameters
    ----------
    rows : RowBuffer
        The contacts.
    begin : int
        How many contacts, and joints with dry friction, the law has.
    wide, mu : ndarray
        See `write_wide`.
    bound : ndarray of int, shape (n,)
        Receives which contact bounds each.
    """
    i = begin
    for c in range(2):
        for a in range(rows.size[0] if len(rows.R) > 0 else 0):
            if rows.resistance[a, c] > 0.0:
                mu[i], bound[i] = rows.resistance[a, c], a
                for k in range(wide.shape[1]):
                    # the second tangent of torsional friction is a zero row
                    wide[3 * i + 1, k] = rows.R[3 * a + c, k]
                    wide[3 * i + 2, k] = rows.R[3 * a + 2, k] if c == 1 else 0.0
                i += 1


@kernel("void(RowBuffer, i8, f8[::1], f8[:,::1])")
def read_resistance(rows: RowBuffer, begin: int, found: Array, p: Array) -> None:
    """Write the percussions about normals and tangents, p[:, 3:], given all of the law; see `write_resistance`."""
    i = begin
    for a in range(rows.size[0]):
        p[a, 3] = p[a, 4] = p[a, 5] = 0.0
    for c in range(2):
        for a in range(rows.size[0] if len(rows.R) > 0 else 0):
            if rows.resistance[a, c] > 0.0:
                p[a, 3 + c] = found[3 * i + 1]
                if c == 1:
                    p[a, 5] = found[3 * i + 2]
                i += 1


@kernel("i8(MechanismStep, RowBuffer, f8[::1], f8[::1], f8, f8, f8[::1], f8[:,::1])")
def coulomb_of_few(
    s: MechanismStep, rows: RowBuffer, x: Array, lower: Array, h: float, limit: float, w: Array, p: Array
) -> int:
    """Do what `bounded_coulomb` does with all contacts at once."""
    memory, k, nv, m = s.memory, rows.size[0], len(x), s.mechanism
    rough = joints_with_friction(m.friction)
    n = k + rough + resisting(rows, 0) + resisting(rows, 1)
    if n > MOST_ROWS:
        return UNSOLVED
    wide, W, A, mu = np.zeros((3 * n, nv)), np.empty((3 * n, nv)), np.empty((3 * n, nv)), np.zeros(n)
    write_wide(rows, m.friction, h, wide, mu)
    bounds, table, case, known = np.zeros(3 * n), np.zeros((3, 3 * n)), np.empty(n, np.int64), NOTHING
    first, start = np.zeros(3 * n), memory.start[: 3 * n]
    if memory.size[1] == 3 * n:
        known = UNIQUE if memory.size[2] else COMPLIANT
        first[:] = start
    for a in range(k):
        bounds[3 * a] = lower[a]
    bound = np.full(n, -1, np.int64)
    write_resistance(rows, k + rough, wide, mu, bound)
    solve(s.room.L, m.parent, wide, W, A)
    residual, unique = coulomb_law(wide, A, x, bounds, mu, bound, known, AIM, first, w, table, case)
    # written so that a NaN is refused too
    if not 0.0 <= residual <= limit:
        return UNSOLVED
    memory.size[1], memory.size[2], start[:], s.residual[0] = 3 * n, 1 if unique else 0, first, residual
    for i in range(3 * k):
        p[i // 3, i % 3] = table[0, i]
    read_resistance(rows, k + rough, table[0], p)
    return DONE


@kernel("i8(MechanismStep, RowBuffer, f8[::1], f8[::1], f8, f8, f8[::1], f8[:,::1])")
def bounded_coulomb(
    s: MechanismStep, rows: RowBuffer, x: Array, lower: Array, h: float, limit: float, w: Array, p: Array
) -> int:  # fmt: skip
    """Write the velocity w and the percussions p of Coulomb's law with J w >= lower; return a code.

    Of many contacts those take part that would close without them: the law of these is that of all once no other one
    closes.

    Parameters
    ----------
    s : MechanismStep
        With the factor of M in its room.
    rows : RowBuffer
        The k contacts.
    x : ndarray, shape (nv,)
        The velocity to which percussions are added.
    lower : ndarray, shape (k,)
        Least rates of the gaps.
    h : float
        Time step [s], for the percussions of the dry friction of joints.
    limit : float
        Largest relative residual.
    w, p : ndarray, shapes (nv,) and (k, 6)
        Receive the result: percussions along normals and tangents, then about them.
    """
    k, n, count = rows.size[0], len(x), 0
    if k <= MOST_CONTACTS or joints_with_friction(s.mechanism.friction) > 0:
        return coulomb_of_few(s, rows, x, lower, h, limit, w, p)
    some, bounds, part = rows_for(MOST_CONTACTS, rows), np.empty(MOST_CONTACTS), np.zeros((MOST_CONTACTS, 6))
    place, closes, s.residual[0] = np.full(k, -1, np.int64), True, 0.0
    for j in range(n):
        w[j] = x[j]
    while closes:
        closes = False
        for a in range(k):
            rate = terms = 0.0
            for j in range(n):
                rate += rows.J[a, j] * w[j]
                terms += abs(rows.J[a, j] * w[j])
            # a rate within rounding of the terms that cancel in it closes nothing
            if place[a] >= 0 or rate >= lower[a] - _ROUNDING * terms:
                continue
            if count == MOST_CONTACTS:
                return UNSOLVED
            copy_row(rows, a, some)
            place[a], bounds[count], closes = count, lower[a], True
            count += 1
        if closes:
            code = coulomb_of_few(s, some, x, bounds[:count], h, limit, w, part[:count])
            if code != DONE:
                return code
    for a in range(k):
        for c in range(6):
            p[a, c] = part[place[a], c] if place[a] >= 0 else 0.0
    return DONE


@kernel("b1(MechanismStep)")
def factor_mass_again(s: MechanismStep) -> bool:
    """Write the factor of M after `move_freely`, which leaves that of M and damping; False where M has none."""
    m = s.mechanism
    return factor_again(m.mass, m.damping, m.parent, False, s.room.L) == 0


@kernel("b1(MechanismStep, f8, f8[::1])")
def apply_joint_friction(s: MechanismStep, h: float, w: Array) -> bool:
    """Let the dry friction of joints act on a velocity in flight, after `move_freely`; False where it is not solved."""
    m = s.mechanism
    if joints_with_friction(m.friction) == 0:
        return True
    if not factor_mass_again(s):
        return False
    # no contacts
    none, before, x = s.middle, s.middle.size[0], w.copy()
    none.size[0] = 0
    code = bounded_coulomb(s, none, x, w[:0], h, EXACT * s.scales.residual, w, np.empty((0, 6)))
    none.size[0] = before
    return code == DONE
