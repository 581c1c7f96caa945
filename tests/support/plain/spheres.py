"""Plain numpy forms of the kernels in mbvi/constraints/families/spheres.py."""

from __future__ import annotations

import numpy as np

from mbvi.arguments import Array


def pairs_within_plain(
    centres: Array, radii: Array, pairs: Array, tolerance: float, number: Array, gap: Array, point: Array, normal: Array
) -> int:
    """Write the pairs of spheres within the tolerance; return how many there are."""
    i, j = np.divmod(pairs, len(radii))
    apart = centres[j] - centres[i]
    length = np.sqrt(np.vecdot(apart, apart))
    gaps = length - radii[i] - radii[j]
    near = gaps <= tolerance
    count, length, i = int(near.sum()), length[near, None], i[near]
    number[:count], gap[:count] = pairs[near], gaps[near]
    # coinciding centres have no direction; any will do to push them apart
    normal[:count] = np.where(length > 0.0, apart[near] / np.where(length > 0.0, length, 1.0), [0.0, 0.0, 1.0])
    point[:count] = centres[i] + (radii[i] + 0.5 * gap[:count])[:, None] * normal[:count]
    return count
