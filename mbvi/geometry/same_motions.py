"""Which motions of walls are the same: walls with the same motion are one surface."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ..arguments import Array
from .motion import Motion, Oscillation, Rotation, Translation


def each_once(motions: Iterable[Motion | None]) -> list[Motion]:
    """Return motions in their order, without None and those that are the same as one before."""
    found = dict[object, Motion]()
    for motion in motions:
        if motion is not None:
            found.setdefault(_what(motion), motion)
    return list(found.values())


def numbered(motions: Iterable[Motion | None]) -> Array:
    """Return a number for each motion, the same for those that are the same."""
    seen = dict[object, int]()
    return np.array([seen.setdefault(_what(motion), len(seen)) for motion in motions], dtype=np.int64)


def same(one: Motion | None, other: Motion | None) -> bool:
    """Return whether two walls move together: by one object, or by motions of `mbvi.motion` with equal parameters."""
    return _what(one) == _what(other)


def _what(motion: Motion | None) -> object:
    # objects of users are the same only where they are one object: what they depend on is not known
    return motion if type(motion) in (Translation, Oscillation, Rotation) else id(motion)
