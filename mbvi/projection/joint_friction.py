"""Dry friction of joints as rows of Coulomb's law."""

from __future__ import annotations

import numpy as np

from .coulomb.friction import project_frictional
from .free_motion import FreeMotion
from .metric import Array, BlockMetric, Metric
from .tree import TreeFreeMotion, TreeMetric


def joint_rows(friction: Array) -> tuple[Array, Array, Array]:
    """Return the rows of the joints with dry friction, the tangents of each, and their coefficients.

    Parameters
    ----------
    friction : ndarray, shape (nv,)
        Largest percussions of dry friction in a step [N s, N m s].

    Returns
    -------
    normals, tangents : ndarray, shapes (d, nv) and (2 d, nv)
        The gradients; normals and second tangents are zero.
    mu : ndarray, shape (d,)
        See `coulomb_law`.
    """
    rough = np.flatnonzero(friction > 0.0)
    tangents = np.zeros((2 * len(rough), len(friction)))
    tangents[2 * np.arange(len(rough)), rough] = 1.0
    return np.zeros((len(rough), len(friction))), tangents, -friction[rough]


def without_friction(metric: Metric) -> Metric:
    """Return the metric without dry friction of joints."""
    if isinstance(metric, BlockMetric):
        return BlockMetric([without_friction(part) for part in metric.parts], metric.slices)
    return metric.rubbed(None) if isinstance(metric, TreeMetric) else metric


def in_flight(motion: FreeMotion | TreeFreeMotion, residual: float = 1e-9) -> Array:
    """Return the velocity after a step without contacts, shape (nv,): forces act, and dry friction of joints.

    Raises
    ------
    ProjectionError
        If the law is not solved.
    """
    metric = motion.metric
    if metric.friction is None:
        return motion.free
    normals, tangents, mu = joint_rows(metric.friction)
    wide = np.zeros((len(mu), 3, len(metric.friction)))
    wide[:, 0], wide[:, 1:] = normals, tangents.reshape(len(mu), 2, -1)
    rows = wide.reshape(-1, len(metric.friction))
    return project_frictional(motion.free, metric, rows, np.zeros(len(mu)), mu, residual).velocity
