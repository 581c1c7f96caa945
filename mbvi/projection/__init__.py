"""Projections in the kinetic metric: they know no robot and no time step."""

from .metric import BlockMetric, BodiesMetric, DenseMetric, DiagonalMetric, Metric, as_metric
from .project import impact, project
from .projector import FreeMotion, Projection, Projector
from .tree import TreeFreeMotion, TreeMetric

__all__ = [
    "BlockMetric",
    "BodiesMetric",
    "DenseMetric",
    "DiagonalMetric",
    "FreeMotion",
    "Metric",
    "Projection",
    "Projector",
    "TreeFreeMotion",
    "TreeMetric",
    "as_metric",
    "impact",
    "project",
]
