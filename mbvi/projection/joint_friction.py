"""Dry friction of joints as rows of Coulomb's law."""

from __future__ import annotations

import numpy as np

from .coulomb.friction import project_frictional
from .free_motion import FreeMotion
from .metric import Array, BlockMetric, Metric
from .tree import TreeFreeMotion, TreeMetric


def joint_rows(metric: Metric) -> tuple[Array, Array]:
    """Return the tangents of the joints and hinges with dry friction, and their coefficients; their normals are zero.

    Parameters
    ----------
    metric : Metric
        A metric with dry friction.

    Returns
    -------
    tangents : ndarray, shape (2 d, nv)
        Two of each joint, of which the second is zero.
    mu : ndarray, shape (d,)
        See `coulomb_law`.
    """
    friction, hinges = metric.friction, metric.hinges
    assert friction is not None
    nv = len(friction) if hinges is None else hinges.shape[1]
    rough = np.flatnonzero(friction > 0.0)
    joints = rough[rough < nv]
    tangents = np.zeros((2 * len(rough), nv))
    tangents[2 * np.arange(len(joints)), joints] = 1.0
    if hinges is not None:
        tangents[2 * len(joints) :: 2] = hinges[rough[len(joints) :] - nv]
    return tangents, -friction[rough]


def without_friction(metric: Metric) -> Metric:
    """Return the metric without dry friction of joints."""
    if isinstance(metric, BlockMetric):
        return BlockMetric([without_friction(part) for part in metric.parts], metric.slices)
    return metric.with_friction(None) if isinstance(metric, TreeMetric) else metric


def in_flight(motion: FreeMotion | TreeFreeMotion, residual: float = 1e-9) -> Array:
    """Return the velocity after a step without contacts, shape (nv,): forces act, and dry friction of joints.

    Raises
    ------
    ProjectionError
        If the law is not solved.
    """
    if motion.friction is None:
        return motion.free
    metric = motion.metric
    tangents, mu = joint_rows(metric)
    wide = np.zeros((3 * len(mu), tangents.shape[1]))
    wide[1::3] = tangents[::2]
    return project_frictional(motion.free, metric, wide, np.zeros(len(mu)), mu, residual).velocity
