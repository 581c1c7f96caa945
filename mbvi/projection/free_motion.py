"""The free motion of a step: the velocity at its end under forces alone, and the metric."""

from __future__ import annotations

from typing import NamedTuple

from .metric import Array, Metric
from .tree import TreeFreeMotion


class FreeMotion(NamedTuple):
    """The velocity at the end of a step under forces alone, v + h M^-1 g of shape (nv,), and M.

    Attributes
    ----------
    free, metric
        These two.
    mechanisms : tuple of (slice, TreeFreeMotion)
        The free motions of mechanisms among several systems, and where they stand in v.
    """

    free: Array
    metric: Metric
    mechanisms: tuple[tuple[slice, TreeFreeMotion], ...] = ()

    def of(self, v: Array, at: Array) -> FreeMotion:
        """Return the free motion from another velocity v under the same forces; this one began at the velocity `at`.

        Damping of mechanisms is that of v itself; see `TreeFreeMotion.of`.
        """
        free = self.free + (v - at)
        for where, motion in self.mechanisms:
            free[where] = motion.of(v[where], at[where]).free
        return FreeMotion(free, self.metric)
