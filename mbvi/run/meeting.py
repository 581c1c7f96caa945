"""Where a pair of bodies meets on its way through a step; where that stays undecided, it counts as met."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from ..constraints.relative_ways import Approach

# penetration at the end of a shortened step, relative to the thickness that would be passed through
DEPTH = 1e-3
# how much deeper bodies get, that touch at the start or are not convex, before a step is shortened, in thicknesses
DEEP = 0.25
# most places at which a pair is measured, the first of them without normals, and the gap that counts as zero,
# relative to the travel
_MOST_MEASURED, _ROUGH, _ZERO = 300, 12, 1e-9


class Meeting(NamedTuple):
    """A pair that could pass through each other on its way, and how to find where it meets.

    Attributes
    ----------
    approach : callable
        approach(x, close) -> the gap at a share of the way, and a bound of how far it falls from there; `close` is
        whether to compute the sharpest bound, which takes longer.
    tolerance : float
        Gap at and below which a constraint is active [m].
    travel, thickness : float
        The most that the bodies travel towards each other on the way, and their thickness [m].
    """

    approach: Callable[[float, bool], Approach]
    tolerance: float
    travel: float
    thickness: float

    def touching(self) -> float:
        """Return the share of the way just after two convex bodies touch, or may touch; 1 if they do not."""
        start = self.approach(0.0, False)
        if start.gap > self._near:
            return self._past(self._first(0.0, start, 0.0))
        # a short step lets the law act on what sinks at once
        begin = self._short(start)
        here = self.approach(begin, False)
        if here.gap - start.gap < self._near:
            return begin if here.gap - start.gap < -self._near else self.entering()
        return self._past(self._first(begin, here, 0.0))

    def entering(self) -> float:
        """Return the share of the way just after a pair touches, or goes deeper, before it is `DEEP`; 1 if never.

        Bodies that are not convex may part or slide along each other and meet again elsewhere within a step.
        """
        start = self.approach(0.0, False)
        low, high = 0.0, self._first(0.0, start, DEEP * self.thickness + max(-start.gap, 0.0))
        level, short = min(start.gap, self._near) - self._near, self._short(start)
        while high < 1.0 and high - low > short:
            middle = 0.5 * (low + high)
            low, high = (low, middle) if self.approach(middle, False).gap < level else (middle, high)
        return self._past(high)

    @property
    def _near(self) -> float:
        """The change of a gap that counts as one [m]."""
        return max(self.tolerance, 0.1 * DEPTH * self.thickness)

    def _short(self, here: Approach) -> float:
        """Return a share of the way in which the gap changes by no more than `DEPTH` thicknesses."""
        deep = DEPTH * self.thickness
        return min(deep / max(here.most, deep), here.share)

    def _past(self, x: float) -> float:
        """Return a share of the way by so much larger that bodies that touch there have sunk."""
        return min(x + self._short(self.approach(x, True)), 1.0) if x < 1.0 else 1.0

    def _first(self, begin: float, here: Approach, depth: float) -> float:
        """Return the first share, from one on, at which the pair is that deep, or may be; 1 if it never is."""
        x, zero = begin, _ZERO * self.travel
        for measured in range(1, _MOST_MEASURED):
            x, last = x + here.free(max(here.gap + depth, zero)), here.gap
            if x >= 1.0:
                return 1.0
            here = self.approach(x, measured >= _ROUGH)
            # what is so deep at the start may rise from there
            if here.gap + depth <= zero and here.gap <= last:
                break
        return x
