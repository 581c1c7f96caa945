"""Plain numpy forms of the kernels in mbvi/projection/sparse/projected_pcg.py."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from mbvi.arguments import Array


def projected_pcg_plain(
    starts: Array,
    columns: Array,
    G: Array,
    d: Array,
    target: float,
    near: float,
    most: int,
    state: Array,
    g: Array,
    u: Array,
) -> float:
    """Bring the natural residual max |min(u, G u - d)| down, from where u is; return what was reached."""
    A = csr_array((G, columns, starts), shape=(len(d), len(d)))
    length = float(abs(A).sum(axis=1).max(initial=1.0))
    y, momentum = u.copy(), 1.0
    for _ in range(200_000):
        g[:] = A @ u - d
        if np.abs(np.minimum(u, g)).max(initial=0.0) <= target:
            break
        new = np.maximum(y - (A @ y - d) / length, 0.0)
        following = 0.5 * (1.0 + np.sqrt(1.0 + 4.0 * momentum**2))
        back = (y - new) @ (new - u) > 0.0
        y = new if back else new + (momentum - 1.0) / following * (new - u)
        u[:], momentum = new, 1.0 if back else following
    g[:] = A @ u - d
    return float(np.abs(np.minimum(u, g)).max(initial=0.0))
