"""Plain numpy forms of the kernels in mbvi/run/recording/impact_rows.py."""

from __future__ import annotations

import numpy as np

from mbvi.arguments import Array


def _raise_levels_plain(number: Array, percussion: Array, known: Array, level: Array) -> None:
    """Raise the level of each known constraint to its largest percussion."""
    place = np.minimum(np.searchsorted(known, number), len(known) - 1)
    same = known[place] == number
    np.maximum.at(level, place[same], percussion[same])
