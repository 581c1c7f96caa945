"""The free motion of a step: the velocity at its end under forces alone, and the metric."""

from __future__ import annotations

from typing import NamedTuple

from .metric import Array, Metric


class FreeMotion(NamedTuple):
    """The velocity at the end of a step under forces alone, v + h M^-1 g of shape (nv,), and M."""

    free: Array
    metric: Metric

    def of(self, v: Array, at: Array) -> FreeMotion:
        """Return the free motion from another velocity v under the same forces; this one began at the velocity `at`."""
        return FreeMotion(self.free + (v - at), self.metric)
