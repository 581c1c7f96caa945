"""Plain numpy form of the kernel in mbvi/projection/dense/goldfarb_idnani.py, on new QR factors for every set."""

from __future__ import annotations

import numpy as np

from mbvi.arguments import Array
from mbvi.projection.dense.goldfarb_idnani import _DEPENDENT, LAST_DIGITS


def goldfarb_idnani_plain(
    W: Array, d: Array, rounding: float, size: int, S: Array, L: Array, Q: Array, u: Array, z: Array, slack: Array
) -> tuple[int, float]:
    """Solve min |z|^2 / 2, W z >= d; see `goldfarb_idnani`."""
    active = S[:size].tolist()
    percussion = u[:size].copy()
    if not active:
        z[:] = 0.0
    for _ in range(10 * len(d) + 50):
        slack[:] = W @ z - d
        violation = -slack
        violation[active] = -np.inf
        entering = int(np.argmax(violation))
        if violation[entering] <= rounding + LAST_DIGITS * np.sqrt(z @ z):
            break
        row, size = W[entering], len(active)
        while True:
            basis, R = np.linalg.qr(W[active].T)
            along = basis.T @ row
            across = row - basis @ along
            along += basis.T @ across
            across -= basis @ (basis.T @ across)
            r = np.linalg.solve(R, along)
            independent = np.sqrt(across @ across) > _DEPENDENT
            full = (d[entering] - row @ z) / (across @ across) if independent else np.inf
            ratios = np.where(r > 0.0, percussion / np.where(r > 0.0, r, 1.0), np.inf)
            step = min(full, ratios.min(initial=np.inf))
            if not np.isfinite(step):
                return -1, (d[entering] - row @ z) / (1.0 - r.sum())
            percussion = percussion - step * r
            if independent:
                z += step * across
            if step == full:
                break
            leaving = int(np.argmin(ratios))
            percussion = np.delete(percussion, leaving)
            del active[leaving]
        active.append(entering)
        basis, R = np.linalg.qr(W[active].T)
        y = np.linalg.solve(R.T, d[active])
        z[:], percussion = basis @ y, np.maximum(np.linalg.solve(R, y), 0.0)
    size = len(active)
    S[:size], u[:size] = active, percussion
    if size:
        basis, R = np.linalg.qr(W[active].T)
        signs = np.sign(R.diagonal())
        L[:size, :size], Q[:size] = (R * signs[:, None]).T, (basis * signs).T
    return size, 0.0
