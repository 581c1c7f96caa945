"""Plain numpy forms of the kernels in mbvi/projection/projected_pcg.py."""

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
    """Bring the natural residual max |min(u, G u - d)| down, from where u is; return what was reached.

    Parameters
    ----------
    starts, columns, G : ndarray, shapes (m + 1,), (k,), (k,)
        Scaled Delassus matrix, row after row, columns ascending; its diagonal is 1.
    d, u : ndarray, shape (m,)
        Missing rates; percussions to start from, which are written over.
    target, near : float
        The residual that is enough, and one that is enough after a round.
    most : int
        How many rounds at most.
    state : ndarray, shape (6,)
        Zeros at first; receives what the next call goes on from: shift, what is added to the factor, least residual so
        far, rounds in vain since, the last share of a way, and whether percussions were carried along.
    g : ndarray, shape (m,)
        Receives G u - d.

    Notes
    -----
    This form is the accelerated projected gradient with restarts, whatever is near and however many rounds there may
    be: slow, and enough to compare with.
    """
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
