"""Coulomb's law for the sparse rows of many contacts."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from ..compiled import plain_array
from ..errors import ProjectionError
from .contact_blocks import pack_contacts
from .coulomb_contact import coulomb_defect
from .coulomb_islands import solve_contact_islands
from .coulomb_sweeps import combine_contacts
from .gram import islands
from .metric import Array, Metric
from .scaled_qp import Projection

# sweeps are to reach this share of the residual asked, which is then computed from the rows as they are
_MARGIN = 0.9


def project_frictional_sparse(
    x: Array,
    metric: Metric,
    J: csr_array,
    lower: Array,
    friction: Array,
    residual: float = 1e-3,
    start: Array | None = None,
    known: Array | None = None,
    rate: float = np.inf,
) -> Projection:
    """Return the velocity w that Coulomb's law gives for sparse rows, with M (w - x) = J' p.

    For each contact, K_mu ∋ p ⊥ (u_n - lower + mu |u_t|, u_t) ∈ K_mu* with u = J w (Moreau; De Saxcé). Where several
    velocities satisfy the law, the order of the contacts and the start choose one.

    Parameters
    ----------
    x : ndarray, shape (nv,)
        Velocity under the forces alone.
    metric : Metric
        M.
    J : csr_array, shape (3 m, nv)
        Of each contact the normal and two tangents, all of unit length and orthogonal to each other in space.
    lower : ndarray, shape (3 m,)
        Of each contact the least normal rate, and the negative tangential velocities of what it touches [m/s].
    friction : ndarray, shape (m,)
        Coefficients of friction.
    residual : float
        The relative residual above which this raises.
    start : ndarray, shape (3 m,), optional
        Percussions to start from, as of a `Projection`.
    known : ndarray of bool, shape (m,), optional
        Which contacts the start is of; all by default.
    rate : float
        Error of velocities that is allowed [m/s]: the residual is smaller where that is needed.

    Returns
    -------
    Projection
        Percussions have shape (3 m,). The residual is the natural map of the law, in rows scaled to unit normal
        entries of J M^-1 J', relative to the largest scaled speed of x, or of `lower`.

    Raises
    ------
    ProjectionError
        If the residual is not reached.
    """
    m, mu = len(friction), plain_array(friction)
    blocks, columns, starts, local = _packed(metric.whiten_rows(J))
    scale = local[:, 6]
    still = scale == 0.0
    if still.any() and (lower[::3][still] > 0.0).any():
        raise ProjectionError("a contact whose normal row vanishes demands a positive rate: no velocity gives it", {})
    speeds = _by_contact(J @ x) * scale[:, None]
    largest = float(np.abs(speeds).max(initial=0.0))
    speeds -= _by_contact(lower) * scale[:, None]
    largest = max(largest, float(np.abs(speeds).max(initial=0.0)))
    if largest > 0.0 and rate < np.inf:
        # an error of r in scaled rows, relative to the largest speed, is one of r largest / scale
        residual = min(residual, rate * float(scale[~still].min(initial=np.inf)) / largest)
    p, z = np.zeros(3 * m), np.empty(len(x))
    if start is not None:
        p = _turned(_by_contact(start) / np.where(still, np.inf, scale)[:, None], local, 1.0).ravel()
    b, target = _turned(speeds, local, 1.0).ravel(), _MARGIN * residual * largest
    label = np.empty(m, np.int64)
    count = islands(columns, starts, len(x), np.diff(starts.astype(np.int64)) > 0, label)
    if known is None:
        known = np.full(m, start is not None)
    solve_contact_islands(blocks, columns, starts, len(x), local, b, mu, known, label, count, target, p)
    combine_contacts(blocks, columns, starts, p, z)
    scaled = _turned(_by_contact(p), local, -1.0)
    w = x + metric.unwhiten(z)
    u = _by_contact(J @ w)
    u -= _by_contact(lower)
    found = coulomb_defect((u * scale[:, None]).ravel(), scaled.ravel(), mu) / largest if largest > 0.0 else 0.0
    # written so that a NaN is refused too
    if not found <= residual:
        problem = {"x": x, "M": metric, "J": J, "lower": lower, "friction": friction}
        raise ProjectionError(
            f"Coulomb's law for {m} contacts stopped at the relative residual {found:.1e}, above {residual:.1e}; "
            "the problem is in `.problem`",
            problem,
            found,
        )
    return Projection(w, (scaled * scale[:, None]).ravel(), found)


def _packed(rows: csr_array) -> tuple[Array, Array, Array, Array]:
    """Return what `pack_contacts` makes of whitened rows."""
    m, n = rows.shape[0] // 3, rows.shape[1]
    columns, starts = np.empty(rows.nnz, np.uint32), np.empty(m + 1, np.uint32)
    blocks, local = np.empty(3 * rows.nnz), np.empty((m, 7))
    own_columns, own_starts = rows.indices.astype(np.uint32), rows.indptr.astype(np.uint32)
    pack_contacts(rows.data, own_columns, own_starts, n, blocks, columns, starts, local)
    return blocks, columns, starts, local


def _by_contact(values: Array) -> Array:
    return values.reshape(-1, 3)


def _turned(values: Array, local: Array, sense: float) -> Array:
    """Return vectors of contacts, shape (m, 3), in the turned tangents of `pack_contacts`; back if the sense is -1."""
    x, y = local[:, 4], sense * local[:, 5]
    return np.stack([values[:, 0], x * values[:, 1] + y * values[:, 2], x * values[:, 2] - y * values[:, 1]], axis=1)
