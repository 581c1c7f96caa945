"""The kernel of an impact with Coulomb friction of one mechanism: from its mass matrix to all rates of the contacts."""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ..metric import Array
from ..row_speeds import row_speeds
from ..tree import advance_by, factor_again, solve
from .separate_laws import coulomb_law

# returned where no contact has friction
WITHOUT_FRICTION = -1.0


@kernel("void(f8[:,::1], f8[:,::1], f8[:,::1])")
def interleave(J: Array, T: Array, wide: Array) -> None:
    """Write each normal row followed by its two tangents: shapes (m, nv), (2 m, nv) and (3 m, nv)."""
    m, n = J.shape
    for a in range(m):
        for k in range(n):
            wide[3 * a, k], wide[3 * a + 1, k], wide[3 * a + 2, k] = J[a, k], T[2 * a, k], T[2 * a + 1, k]


@kernel(
    "Tuple((f8, b1))(f8[:,::1], i8[::1], f8[::1], f8[::1], f8[:,::1], f8[:,::1], f8[::1], f8[::1], f8[::1], f8[::1], "
    "i8, f8, f8[::1], f8[::1], f8[:,::1], f8[:,:,::1])"
)
def frictional_law_of_rows(
    L: Array, parent: Array, x: Array, v: Array, J: Array, T: Array, e: Array, drift: Array, opened: Array,
    mu: Array, known: int, limit: float, start: Array, w: Array, rates: Array, slip: Array,
) -> tuple[float, bool]:  # fmt: skip
    """Write the velocity that Coulomb's law gives for one mechanism.

    Parameters
    ----------
    L, parent
        The factor of M; see `factor`.
    x, v : ndarray, shape (nv,)
        The velocity under forces alone, and that before.
    J, T : ndarray, shapes (m, nv) and (2 m, nv)
        Gradients of gaps, and of each contact those along its two tangents.
    e : ndarray, shape (m,)
        Restitution.
    drift : ndarray, shape (3 m,) or (0,)
        Rates at v = 0, of each contact the normal and two tangents; all are zero if there are none.
    opened : ndarray, shape (m,) or (0,)
        Speeds at which open contacts may close, 0 of others.
    mu, known, limit, start
        See `coulomb_law`.
    w : ndarray, shape (nv,)
        Receives the velocity.
    rates : ndarray, shape (4, m)
        Receives percussions and rates of gaps under forces alone, after and before.
    slip : ndarray, shape (4, m, 2)
        Receives the same of the tangents.

    Returns
    -------
    residual, unique
        See `coulomb_law`.
    """
    m, nv = J.shape
    n = 3 * m
    wide, W, A = np.empty((n, nv)), np.empty((n, nv)), np.empty((n, nv))
    interleave(J, T, wide)
    solve(L, parent, wide, W, A)
    before, lower, table, case = np.empty(n), np.empty(n), np.empty((3, n)), np.empty(m, np.int64)
    row_speeds(wide, v, 1.0, before)
    for i in range(n):
        own = drift[i] if len(drift) else 0.0
        before[i] += own
        if i % 3 == 0:
            a = i // 3
            lower[i] = -e[a] * before[i]
            # what closes within the step by its own speed has its impact now
            if len(opened) and opened[a] > 0.0 and before[i] > -opened[a]:
                lower[i] = min(lower[i], -opened[a])
        else:
            lower[i] = 0.0
        lower[i] -= own
    bound = np.full(m, -1, np.int64)
    residual, unique = coulomb_law(wide, A, x, lower, mu, bound, known, limit, start, w, table, case)
    for i in range(n):
        a, c = i // 3, i % 3
        own = drift[i] if len(drift) else 0.0
        for r in range(4):
            value = before[i] if r == 3 else table[r, i]
            if r == 1 or r == 2:
                value += own
            if c == 0:
                rates[r, a] = value
            else:
                slip[r, a, c - 1] = value
    return residual, unique


@kernel(
    "Tuple((f8, b1))(f8[:,::1], f8[::1], i8[::1], f8[::1], f8, f8[::1], f8[::1], b1, f8[:,::1], f8[:,::1], f8[::1], "
    "f8[::1], f8[::1], f8[::1], i8, f8, f8[::1], f8[::1], f8[:,::1], f8[:,:,::1])"
)
def frictional_tree_law(
    mass: Array, damping: Array, parent: Array, v: Array, h: float, torque: Array, effects: Array, twice: bool,
    J: Array, T: Array, e: Array, drift: Array, opened: Array, mu: Array, known: int, limit: float, start: Array,
    w: Array, rates: Array, slip: Array,
) -> tuple[float, bool]:  # fmt: skip
    """Write the velocity that Coulomb's law gives, from the free motion of one mechanism; see `TreeFreeMotion`.

    The first arguments are those of `advance_by`, the others, as the result, those of `frictional_law_of_rows`; the
    residual is inf where M is not positive definite, `WITHOUT_FRICTION` where no mu is positive.
    """
    most = 0.0
    for a in range(len(mu)):
        most = max(most, mu[a])
    if most == 0.0:
        return WITHOUT_FRICTION, False
    L, x = np.empty(mass.shape), np.empty(len(v))
    if advance_by(mass, damping, parent, v, h, torque, effects, twice, L[:0], L, np.empty((2, len(v))), x):
        return np.inf, False
    if factor_again(mass, damping, parent, twice, L):
        return np.inf, False
    return frictional_law_of_rows(
        L, parent, x, v, J, T, e, drift, opened, mu, known, limit, start, w, rates, slip
    )  # fmt: skip
