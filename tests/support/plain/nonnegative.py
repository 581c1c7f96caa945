"""Plain numpy forms of the kernels in mbvi/projection/nonnegative.py."""

from __future__ import annotations

import numpy as np

from mbvi.arguments import Array
from mbvi.projection.nonnegative import _DEPENDENT, _INDEPENDENT, ROUNDING


def solve_equalities_plain(G: Array, d: Array, chosen: Array, base: Array, u: Array) -> bool:
    """Write the u nearest to `base` with (G u)_S = d_S on the chosen rows, zero elsewhere; False if there is none."""
    S = np.flatnonzero(chosen)
    u[:] = 0.0
    values, vectors = np.linalg.eigh(G[np.ix_(S, S)])
    kept = values > _DEPENDENT * len(S)
    if (values[kept] < _INDEPENDENT).any():
        return False
    missing = d[S] - G[np.ix_(S, S)] @ base[S]
    u[S] = base[S] + vectors[:, kept] @ ((vectors[:, kept].T @ missing) / values[kept])
    return True


def dual_active_set_plain(G: Array, d: Array, chosen: Array) -> bool:
    """Find the rows that press by the dual active-set method; False if none was found."""
    m = len(d)
    S: list[int] = []
    u = np.zeros(m)
    for _ in range(10 * m):
        slack = G @ u - d
        slack[S] = np.inf
        entering = int(np.argmin(slack))
        if slack[entering] >= -ROUNDING * (np.abs(d).max() + np.abs(G @ u).max()):
            chosen[:] = False
            chosen[S] = True
            return True
        while True:
            r = np.linalg.solve(G[np.ix_(S, S)], G[S, entering])
            curvature = G[entering, entering] - G[entering, S] @ r
            missing = d[entering] - G[entering] @ u
            full = missing / curvature if curvature > _INDEPENDENT else np.inf
            ratios = [u[a] / s if s > 0.0 else np.inf for a, s in zip(S, r, strict=True)]
            step = min([full, *ratios])
            if not np.isfinite(step):
                return False
            u[S] -= step * r
            u[entering] += step
            if step == full:
                break
            del S[int(np.argmin(ratios))]
            u[[a for a in range(m) if a not in S and a != entering]] = 0.0
        S.append(entering)
    return False
