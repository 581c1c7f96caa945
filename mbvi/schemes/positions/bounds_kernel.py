"""The kernel of a law with given lower bounds of the rates of gaps, with friction where rows have it."""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ...constraints.mechanism.tables import RowBuffer
from ...projection.coulomb.friction import EXACT
from ...projection.tree import solve
from ...system.system import Array
from ..kernels.joint_friction import bounded_coulomb, joints_with_friction
from ..kernels.phases import has_friction, write_rates_of
from ..kernels.records import DONE, UNSOLVED, MechanismStep
from .displacement_kernel import IMPOSSIBLE, project_moving


@kernel("i8(MechanismStep, RowBuffer, f8[::1], f8[::1], f8[::1], f8)")
def apply_bounds(s: MechanismStep, rows: RowBuffer, v: Array, x: Array, lower: Array, h: float) -> int:
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
    h : float
        Length of the step [s].
    """
    k, n, L = rows.size[0], len(v), s.room.L
    J, w, p = rows.J[:k], np.empty(n), np.zeros((k, 6))
    if has_friction(rows) or joints_with_friction(s.mechanism.friction) > 0:
        # Python checks each row of others than exact answers
        code = bounded_coulomb(s, rows, x, lower, h, EXACT * s.scales.residual, w, p)
        if code != DONE:
            return code
    else:
        W, A, table = np.empty((k, n)), np.empty((k, n)), np.empty((3, k))
        solve(L, s.mechanism.parent, J, W, A)
        residual = project_moving(s, J, A, W, x, lower, w, table)
        if not 0.0 <= residual < np.inf:
            return IMPOSSIBLE if residual < 0.0 else UNSOLVED
        p[:, 0], s.residual[0] = table[0], residual
    for j in range(n):
        s.v[j] = w[j]
    write_rates_of(s, rows, v, p)
    return DONE
