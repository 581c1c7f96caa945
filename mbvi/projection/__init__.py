"""Projections in the kinetic metric: they know no robot and no time step."""

from .metric import BlockMetric, BodiesMetric, DenseMetric, DiagonalMetric, Metric, as_metric
from .project import Projection, Projector, Push, impact, project
from .tree import TreeMetric, TreePush

__all__ = [
    "BlockMetric",
    "BodiesMetric",
    "DenseMetric",
    "DiagonalMetric",
    "Metric",
    "Projection",
    "Projector",
    "Push",
    "TreeMetric",
    "TreePush",
    "as_metric",
    "impact",
    "project",
]
