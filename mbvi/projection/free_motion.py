"""The free motion of a step: the velocity at its end under forces alone, and the metric."""

from __future__ import annotations

from typing import NamedTuple

from .metric import Array, Metric


class FreeMotion(NamedTuple):
    """The velocity at the end of a step under forces alone, v + h M^-1 g of shape (nv,), and M.

    Attributes
    ----------
    free, metric
        These two.
    """

    free: Array
    metric: Metric

    @property
    def friction(self) -> Array | None:
        """The largest percussions of dry friction of joints; see `Metric`."""
        return self.metric.friction
