"""The kernel of a law with given lower bounds of the rates of gaps, with friction where rows have it."""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ...constraints.mechanism.tables import RowBuffer
from ...projection.coulomb.few_contacts import MOST_CONTACTS
from ...projection.coulomb.friction import AIM, EXACT
from ...projection.coulomb.frictional_step import interleave
from ...projection.coulomb.law import COMPLIANT, NOTHING, UNIQUE, coulomb_law
from ...projection.dense.orthonormal_rows import inner
from ...projection.tree import solve
from ...system.system import Array
from ..kernels.phases import has_friction
from ..kernels.records import DONE, UNSOLVED, MechanismStep
from .displacement_kernel import IMPOSSIBLE, project_moving


@kernel("i8(MechanismStep, RowBuffer, f8[::1], f8[::1], f8[::1])")
def apply_bounds(s: MechanismStep, rows: RowBuffer, v: Array, x: Array, lower: Array) -> int:
    """Write velocity, rates and residual of the law with given lower bounds; return a code, or `IMPOSSIBLE`.

    Parameters
    ----------
    s : MechanismStep
        With the free motion and the factor of M where the law acts. It is not changed where no velocity is found.
    rows : RowBuffer
        The rows.
    v, x : ndarray, shape (nv,)
        The velocity before the law, and that to which it adds percussions.
    lower : ndarray, shape (k,)
        Least rates of the gaps.
    """
    k, n, parent, L = rows.size[0], len(v), s.mechanism.parent, s.room.L
    J, w, part, p = rows.J[:k], np.empty(n), np.zeros((3, 3 * k)), np.zeros((k, 3))
    if has_friction(rows):
        if k > MOST_CONTACTS:
            return UNSOLVED
        wide, W, A, bounds = np.empty((3 * k, n)), np.empty((3 * k, n)), np.empty((3 * k, n)), np.zeros(3 * k)
        interleave(J, rows.T[: 2 * k], wide)
        solve(L, parent, wide, W, A)
        memory, known, case = s.memory, NOTHING, np.empty(k, np.int64)
        start = memory.start[: 3 * k]
        if memory.size[1] == 3 * k:
            known = UNIQUE if memory.size[2] else COMPLIANT
        first = start.copy() if known != NOTHING else np.zeros(3 * k)
        for a in range(k):
            bounds[3 * a] = lower[a]
        residual, unique = coulomb_law(wide, A, x, bounds, rows.mu[:k], known, AIM, first, w, part, case)
        # Python checks each row of the others
        if not 0.0 <= residual <= EXACT * s.scales.residual:
            return UNSOLVED
        memory.size[1], memory.size[2], start[:] = 3 * k, 1 if unique else 0, first
        for i in range(3 * k):
            p[i // 3, i % 3] = part[0, i]
    else:
        W, A, table = np.empty((k, n)), np.empty((k, n)), np.empty((3, k))
        solve(L, parent, J, W, A)
        residual = project_moving(s, J, A, W, x, lower, w, table)
        if not 0.0 <= residual < np.inf:
            return IMPOSSIBLE if residual < 0.0 else UNSOLVED
        p[:, 0] = table[0]
    s.residual[0] = residual
    for j in range(n):
        s.v[j] = w[j]
    write_rates_of(s, rows, v, p)
    return DONE


@kernel("void(MechanismStep, RowBuffer, f8[::1], f8[:,::1])")
def write_rates_of(s: MechanismStep, rows: RowBuffer, v: Array, p: Array) -> None:
    """Write percussions p, shape (k, 3), and the rates of rows under forces alone, after and before the law."""
    k, free = rows.size[0], s.room.free
    for a in range(k):
        s.rates[a], J = p[a, 0], rows.J[a]
        s.rates[k + a], s.rates[2 * k + a], s.rates[3 * k + a] = inner(J, free), inner(J, s.v), inner(J, v)
        for c in range(2 if len(rows.T) > 0 else 0):
            i, T = 2 * a + c, rows.T[2 * a + c]
            s.slip[i], s.slip[2 * k + i] = p[a, 1 + c], inner(T, free)
            s.slip[4 * k + i], s.slip[6 * k + i] = inner(T, s.v), inner(T, v)
