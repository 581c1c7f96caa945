"""Dry friction of joints as rows of Coulomb's law."""

from __future__ import annotations

import numpy as np

from .coulomb.friction import project_frictional
from .free_motion import FreeMotion
from .metric import Array, BlockMetric, Metric
from .tree import TreeFreeMotion, TreeMetric


def joint_rows(friction: Array) -> tuple[Array, Array]:
    """Return the tangents of the joints with dry friction, and their coefficients; their normals are zero.

    Parameters
    ----------
    friction : ndarray, shape (nv,)
        Largest percussions of dry friction in a step [N s, N m s].

    Returns
    -------
    tangents : ndarray, shape (2 d, nv)
        Two of each joint, of which the second is zero.
    mu : ndarray, shape (d,)
        See `coulomb_law`.
    """
    joints = np.flatnonzero(friction > 0.0)
    tangents = np.zeros((2 * len(joints), len(friction)))
    tangents[2 * np.arange(len(joints)), joints] = 1.0
    return tangents, -friction[joints]


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
    tangents, mu = joint_rows(motion.friction)
    wide = np.zeros((3 * len(mu), tangents.shape[1]))
    wide[1::3] = tangents[::2]
    return project_frictional(motion.free, motion.metric, wide, np.zeros(len(mu)), mu, residual).velocity
