"""One projection min |w - x|_M subject to J w >= c, and the impact law (8) built on it: arguments are checked here."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array, issparse

from ..arguments import array, shown
from ..errors import InputError
from .coulomb.friction import LARGEST_FRICTION, project_frictional
from .dense.scaled_qp import Projection
from .metric import Array, Metric, as_metric
from .projector import Projector


def project(
    x: Array,
    M: Array | Metric,
    J: Array | csr_array,
    lower: Array | float = 0.0,
    friction: Array | float | None = None,
) -> Projection:
    """Project a velocity onto {w : J w >= lower} in the kinetic metric; with friction, apply Coulomb's law.

    Parameters
    ----------
    x : ndarray, shape (nv,)
        Velocity to project [m/s, rad/s].
    M : ndarray, shape (nv, nv), or Metric
        Mass matrix, symmetric positive definite.
    J : ndarray or sparse array, shape (m, nv)
        Constraint gradients, one a row; rows may be dependent, repeated, opposite or zero.
    lower : float or ndarray, shape (m,)
        Least rate of each constraint [m/s, rad/s]; 0 gives the projection onto the tangent cone.
    friction : float or ndarray, shape (k,), optional
        Coefficients of Coulomb friction of k contacts; above 100 they count as 100. J is then dense and has three rows
        for each: its normal and two tangents of unit length, orthogonal to each other; `lower` has one entry a contact
        and acts on normals.

    Returns
    -------
    Projection
        Velocity, percussions and residual. With friction, percussions are those of the rows of J, p_n >= 0 and
        |p_t| <= mu p_n, and the residual is that of Coulomb's law.

    Raises
    ------
    InputError
        On wrong shapes, entries that are not finite, M not symmetric positive definite, friction below 0.
    InfeasibleError
        If no velocity meets the constraints.
    ProjectionError
        If the relative KKT residual stays above 1e-6. The error carries the residual that was reached.

    Notes
    -----
    Proj_M(T_K, x) of equation (8) of the paper (docs/theory/mathematics.md); percussions as in its Lemma 3.3, with the
    sign changed so that p >= 0.
    """
    if friction is not None:
        velocity, rows, bound, mu = _checked_contacts(x, J, lower, "lower", friction)
        found = project_frictional(velocity, as_metric(M, velocity.size), rows, bound, mu)
        return Projection(found.velocity, found.percussion, found.residual)
    velocity, J, bound = _checked(x, J, lower, "lower")
    return Projector().project(velocity, as_metric(M, velocity.size), J, bound)


def impact(v: Array, M: Array | Metric, J: Array, e: Array | float, friction: Array | float | None = None) -> Array:
    """Apply the impact law v+ = -e v- + (1 + e) Proj_M(T, v-), or Coulomb's law with restitution e on the normal.

    Parameters
    ----------
    v : ndarray, shape (nv,)
        Velocity before, v-.
    M : ndarray, shape (nv, nv), or Metric
        Mass matrix.
    J : ndarray, shape (m, nv)
        Gradients of the active constraints.
    e : float or ndarray, shape (m,)
        Restitution in [0, 1]: one for all constraints, or one for each.
    friction : float or ndarray, shape (k,), optional
        Coefficients of Coulomb friction of k contacts, with the rows of J as of `project`; e has one entry a contact.

    Returns
    -------
    ndarray, shape (nv,)
        Velocity after, v+.

    Raises
    ------
    InputError, ProjectionError
        As `project`; also if e is outside [0, 1].

    Notes
    -----
    Equation (8). Since T is a cone, v+ = argmin |w - v|_M subject to J w >= -e J v, which carries one e per
    constraint as well. With friction the velocity need not be unique where rows depend on each other; then contacts
    are taken as equally compliant to choose which of them stick and slip.
    """
    if friction is not None:
        velocity, rows, restitution, mu = _checked_contacts(v, J, e, "e", friction)
        _check_restitution(restitution, e)
        lower = -restitution * (rows[::3] @ velocity)
        return project_frictional(velocity, as_metric(M, velocity.size), rows, lower, mu).velocity
    velocity, J, restitution = checked_impact(v, J, e)
    metric = as_metric(M, velocity.size)
    return Projector().project(velocity, metric, J, -restitution * (J @ velocity)).velocity


def checked_impact(v: Array, J: Array, e: Array | float) -> tuple[Array, Array, Array]:
    """Return the arguments of `impact` as float arrays of fitting shapes, one e per row, or raise `InputError`."""
    velocity, J, restitution = _checked(v, J, e, "e")
    _check_restitution(restitution, e)
    return velocity, J, restitution


def _check_restitution(restitution: Array, e: Array | float) -> None:
    # written so that a NaN is refused too
    if not ((restitution >= 0.0) & (restitution <= 1.0)).all():
        raise InputError(f"restitution e must lie in [0, 1]; got {shown(e)}")


def _checked_contacts(
    x: Array, J: Array, bound: Array | float, name: str, friction: Array | float
) -> tuple[Array, Array, Array, Array]:
    """Return velocity, rows, `bound` and friction as float arrays, the last two one per contact."""
    x, J, mu = array(x, "the velocity", ("nv",)), array(J, "J"), array(friction, "friction")
    if J.ndim != 2 or J.shape[1] != x.size or J.shape[0] % 3:
        raise InputError(
            f"J has shape {J.shape}; with friction it must have (3 m, {x.size}): a normal and two tangents a contact"
        )
    m = J.shape[0] // 3
    if mu.shape not in ((), (m,)):
        raise InputError(f"friction has shape {mu.shape}; it must be one number or one a contact, ({m},)")
    if (mu < 0.0).any():
        raise InputError(f"friction must be at least 0; got {shown(friction)}")
    bound = array(bound, name)
    if bound.shape not in ((), (m,)):
        raise InputError(f"{name} has shape {bound.shape}; it must be one number or one a contact, ({m},)")
    return x, J, np.broadcast_to(bound, m), np.array(np.broadcast_to(np.minimum(mu, LARGEST_FRICTION), m))


def _checked(x: Array, J: Array, bound: Array | float, name: str) -> tuple[Array, Array, Array]:
    """Return the arguments as float arrays of fitting shapes, `bound` one per row of J."""
    # a copy, because it is returned itself if no row is violated
    x = array(x, "the velocity", ("nv",))
    if issparse(J):
        array(J.data, "J")
        J = csr_array(J, dtype=float)
    else:
        J = array(J, "J")
    if J.ndim != 2 or J.shape[1] != x.size:
        raise InputError(f"J has shape {J.shape}; it must have (m, {x.size}), as many columns as the velocity")
    bound = array(bound, name)
    if bound.shape not in ((), J.shape[:1]):
        raise InputError(f"{name} has shape {bound.shape}; it must be one number or one a row of J, ({J.shape[0]},)")
    return x, J, np.broadcast_to(bound, J.shape[:1])
