"""Plain numpy forms of the kernels in mbvi/geometry/sphere_capsule.py."""

from __future__ import annotations

import numpy as np

from mbvi.arguments import Array


def _ball_contacts_plain(
    places: Array, frame: Array, ends: Array, radius: Array, sides: Array, pairs: Array, gap: Array, point: Array,
    normal: Array,
) -> bool:  # fmt: skip
    """Write the contacts of pairs of which one side at least is a sphere; False if some have no normal, but NaN."""
    for i, pair in enumerate(pairs):
        a, b = sides[pair]
        first, second = (
            ends[s] if frame[s] < 0 else ends[s] @ places[frame[s], :3] + places[frame[s], 3] for s in (a, b)
        )
        nearest = _nearest(first, second[0]), _nearest(second, first[0])
        apart = nearest[1] - nearest[0]
        length = np.linalg.norm(apart)
        normal[i] = apart / length if length > 0.0 else np.nan
        gap[i] = length - radius[a] - radius[b]
        point[i] = nearest[0] + (radius[a] + 0.5 * gap[i]) * normal[i]
    return not np.isnan(normal).any()


def _nearest(segment: Array, target: Array) -> Array:
    """Return the point of a segment, shape (2, 3), nearest to a point."""
    along = segment[1] - segment[0]
    square = along @ along
    return segment[0] + (np.clip((target - segment[0]) @ along / square, 0.0, 1.0) * along if square > 0.0 else 0.0)
