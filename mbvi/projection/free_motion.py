"""The velocity that forces alone lead to within a step, and the metric."""

from __future__ import annotations

from typing import NamedTuple

from .metric import Array, Metric


class FreeMotion(NamedTuple):
    """The velocity that forces alone lead to within a step: v + h M^-1 g, shape (nv,), and M."""

    free: Array
    metric: Metric

    def of(self, v: Array, at: Array) -> FreeMotion:
        """Return the free motion of the velocity v under the same forces, if these are those at the velocity `at`."""
        return FreeMotion(self.free + (v - at), self.metric)
