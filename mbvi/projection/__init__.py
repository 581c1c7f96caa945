"""Projections in the kinetic metric: solvers, metrics and the check of the residual."""

from .acceptance import Acceptance, AcceptedDepth, StatedDepth
from .coulomb.friction_sparse import project_frictional_sparse
from .dense.dual_active_set import DualActiveSet
from .dense.proxqp import ProxQP
from .dense.scaled_qp import Projection
from .free_motion import FreeMotion
from .joint_friction import in_flight, joint_rows, without_friction
from .metric import BlockMetric, BodiesMetric, DenseMetric, DiagonalMetric, Metric, as_metric
from .project import impact, project
from .projector import ChosenSolver, Projector, checked_solver
from .sparse.sparse_pcg import SparsePCG
from .tree import TreeFreeMotion, TreeMetric

__all__ = [
    "Acceptance",
    "AcceptedDepth",
    "BlockMetric",
    "BodiesMetric",
    "ChosenSolver",
    "DenseMetric",
    "DiagonalMetric",
    "DualActiveSet",
    "FreeMotion",
    "Metric",
    "Projection",
    "Projector",
    "ProxQP",
    "SparsePCG",
    "StatedDepth",
    "TreeFreeMotion",
    "TreeMetric",
    "as_metric",
    "checked_solver",
    "impact",
    "in_flight",
    "joint_rows",
    "project",
    "project_frictional_sparse",
    "without_friction",
]
