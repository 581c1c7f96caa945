"""Projections in the kinetic metric: they know no robot and no time step."""

from .delassus import against_condition_12, cosines_between, independent, islands, unit_gradients
from .forks import Forks, follow, forks
from .metric import BlockMetric, BodiesMetric, DenseMetric, DiagonalMetric, Metric, as_metric
from .project import impact, project
from .projector import Projection, Projector, Push
from .tree import TreeMetric, TreePush

__all__ = [
    "BlockMetric",
    "BodiesMetric",
    "DenseMetric",
    "DiagonalMetric",
    "Forks",
    "Metric",
    "Projection",
    "Projector",
    "Push",
    "TreeMetric",
    "TreePush",
    "against_condition_12",
    "as_metric",
    "cosines_between",
    "follow",
    "forks",
    "impact",
    "independent",
    "islands",
    "project",
    "unit_gradients",
]
