"""Plain numpy forms of the kernels in mbvi/constraints/admissible_set.py."""

from __future__ import annotations

import numpy as np

from mbvi.arguments import Array


def _use_up_plain(moved: Array, envelope: Array, travel: Array, spare: Array) -> int:
    """Take what was travelled from what constraints have to spare; return one bit for each that must be asked.

    Parameters
    ----------
    moved : ndarray, shape (nv,)
        Tangent vector between two configurations.
    envelope, travel : ndarray, shape (n, nv)
        How fast each velocity can close each constraint, and what was travelled since it was asked; added to.
    spare : ndarray, shape (n,)
        How far each is from closing; -inf where it must be asked in any case.
    """
    travel += np.abs(moved)
    spare -= envelope @ np.abs(moved)
    return sum(1 << k for k in range(len(spare)) if not spare[k] >= 0.0)
