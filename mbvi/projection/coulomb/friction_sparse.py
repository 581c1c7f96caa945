"""Coulomb's law for the sparse rows of many contacts."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from ...compiled import plain_array
from ...errors import ProjectionError
from ..dense.scaled_qp import Projection
from ..metric import Array, Metric
from ..sparse.contact_blocks import pack_contacts
from ..sparse.gram import islands
from .islands import solve_contact_islands
from .law import scale_cones, set_bounds
from .one_contact import coulomb_defect
from .sweeps import combine_contacts, contacts_residual

# solvers of free bodies are to reach this share of the residual asked, which is then computed from the rows as they are
_MARGIN = 0.9
# solvers of mechanisms aim at this share, at most, and at this residual at least: what is left of rounding
_FINE_MARGIN, _EXACT = 0.1, 1e-10
# how often contacts of mechanisms are solved after those of the free bodies that they touch
_ROUNDS = 10


class FineRows(NamedTuple):
    """Contacts that are solved to a smaller residual than others: those of mechanisms.

    Attributes
    ----------
    contacts : ndarray of bool, shape (m,)
        Which they are.
    residual : float
        Their relative residual; relative to the largest speed among themselves.
    rates : ndarray, shape (m,)
        The errors of rates that are aimed at for each contact [m/s, rad/s].
    """

    contacts: Array
    residual: float
    rates: Array


class _Packed(NamedTuple):
    """Whitened rows of contacts as of `pack_contacts`, in scaled and turned axes, with velocities and friction."""

    blocks: Array
    columns: Array
    starts: Array
    local: Array
    b: Array
    mu: Array
    bound: Array
    width: int

    def solve(self, targets: Array, known: Array, p: Array) -> None:
        """Solve each island to the least target of its contacts, from p, which receives the percussions."""
        label, count = self.islands()
        rows = self.blocks, self.columns, self.starts
        law = self.local, self.b, self.mu, self.bound
        solve_contact_islands(*rows, self.width, *law, known, label, count, targets, p)

    def islands(self) -> tuple[Array, int]:
        """Return the island of each contact, -1 where it moves nothing, and how many there are."""
        label = np.empty(len(self.mu), np.int64)
        moving = np.diff(self.starts.astype(np.int64)) > 0
        return label, islands(self.columns, self.starts, self.width, moving, label)

    def combine(self, p: Array) -> Array:
        """Return A p, shape (width,)."""
        z = np.empty(self.width)
        combine_contacts(self.blocks, self.columns, self.starts, p, z)
        return z

    def velocities(self, p: Array) -> Array:
        """Return A' A p + b, shape (3 m,)."""
        u = np.empty(len(p))
        rows = self.blocks, self.columns, self.starts
        contacts_residual(*rows, self.b, self.mu, self.bound, p, np.empty(self.width), u)
        return u

    def take(self, chosen: Array, b: Array) -> _Packed:
        """Return some contacts, with those that are bounded by them, and velocities b without their percussions."""
        sizes: Array = np.diff(self.starts.astype(np.int64))
        entry = np.repeat(chosen, sizes)
        starts = np.concatenate([[0], np.cumsum(sizes[chosen])]).astype(np.uint32)
        blocks = np.ascontiguousarray(self.blocks.reshape(-1, 3)[entry].ravel())
        bound = renumbered(self.bound, chosen)
        return _Packed(blocks, self.columns[entry], starts, self.local[chosen], b, self.mu[chosen], bound, self.width)


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
    fine: FineRows | None = None,
    accepted: Callable[[float], float] = float,
    bound: Array | None = None,
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
        The relative residual of contacts.
    start : ndarray, shape (3 m,), optional
        Percussions to start from, as of a `Projection`.
    known : ndarray of bool, shape (m,), optional
        Which contacts the start is of; all by default.
    rate : float
        Error of velocities that is allowed [m/s]: the residual is smaller where that is needed.
    fine : FineRows, optional
        Contacts with a smaller residual.
    accepted : callable
        Returns the residual above which this raises, given the one that is asked; the same by default.
    bound : ndarray of int, shape (m,), optional
        See `coulomb_law`; no contact is bounded by another by default.

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
    if bound is None:
        bound = np.full(m, -1, np.int64)
    bounded = bound >= 0
    blocks, columns, starts, local = _packed(metric.whiten_rows(J), bound)
    scale = local[:, 6].copy()
    still = scale == 0.0
    if still.any() and (lower[::3][still] > 0.0).any():
        raise ProjectionError("a contact whose normal row vanishes demands a positive rate: no velocity gives it", {})
    free = _by_contact(J @ x) * scale[:, None]
    speeds = free - _by_contact(lower) * scale[:, None]
    size = np.maximum(np.abs(free), np.abs(speeds)).max(axis=1, initial=0.0)
    chosen = np.zeros(m, bool) if fine is None else np.where(bounded, fine.contacts[bound], fine.contacts)
    # residuals of contacts of mechanisms are relative to the speeds of these
    largest, own = float(size.max(initial=0.0)), float(size[chosen].max(initial=0.0))
    if largest > 0.0 and rate < np.inf:
        # an error of r in scaled rows, relative to the largest speed, is one of r largest / scale
        residual = min(residual, rate * float(scale[~still & ~bounded].min(initial=np.inf)) / largest)
    targets = np.full(m, _MARGIN * residual * largest)
    if fine is not None:
        rates = np.where(bounded, np.inf, fine.rates * scale)
        aims = np.clip(rates, _EXACT * own, _FINE_MARGIN * fine.residual * own)
        targets[chosen] = np.minimum(aims, targets)[chosen]
    p = np.zeros(3 * m)
    if start is not None:
        p = _turned(_by_contact(start) / np.where(still, np.inf, scale)[:, None], local, 1.0).ravel()
    if known is None:
        known = np.full(m, start is not None)
    b, cone = _turned(speeds, local, 1.0).ravel(), np.empty(m)
    scale_cones(mu, bound, scale, largest, b, cone)
    set_bounds(mu, bound, b, p)
    packed = _Packed(blocks, columns, starts, local, b, cone, bound, len(x))
    _solve(packed, targets, chosen, known, p)
    # the residual shall be that of the percussions which bound others
    set_bounds(mu, bound, b, p)
    scaled = _turned(_by_contact(p), local, -1.0)
    w = x + metric.unwhiten(packed.combine(p))
    u = _by_contact(J @ w)
    u -= _by_contact(lower)
    u *= scale[:, None]
    found = 0.0
    for some, most, unit in ((~chosen, residual, largest), (chosen, 0.0 if fine is None else fine.residual, own)):
        if unit > 0.0 and some.any():
            off = coulomb_defect(u[some].ravel(), scaled[some].ravel(), cone[some]) / unit
            # written so that a NaN is refused too
            if not off <= accepted(most):
                problem = {"x": x, "M": metric, "J": J, "lower": lower, "friction": friction}
                raise ProjectionError(
                    f"Coulomb's law for {m} contacts stopped at the relative residual {off:.1e}, above "
                    f"{accepted(most):.1e}; the problem is in `.problem`",
                    problem,
                    off,
                )
            found = max(found, off)
    percussion = scaled * scale[:, None]
    percussion[bounded, 0] = 0.0
    return Projection(w, percussion.ravel(), found)


def _solve(packed: _Packed, targets: Array, fine: Array, known: Array, p: Array) -> None:
    """Write percussions p that reach the targets, as far as solvers do.

    An island of a mechanism among free bodies is solved to the target of these first, then the contacts of the
    mechanism to their own while the others stay, until both are reached.
    """
    mixed, label = np.zeros(0, bool), np.zeros(0, np.int64)
    if fine.any() and not fine.all():
        label, count = packed.islands()
        of_mechanisms, of_bodies = np.zeros(count, bool), np.zeros(count, bool)
        of_mechanisms[label[fine & (label >= 0)]], of_bodies[label[~fine & (label >= 0)]] = True, True
        mixed = of_mechanisms & of_bodies
    if not mixed.any():
        packed.solve(targets, known, p)
        return
    here = mixed[label] & (label >= 0)
    theirs = here & fine
    rough, rest = targets.copy(), here & ~fine
    rough[theirs] = targets[rest].min()
    each = np.repeat(theirs, 3)
    for _ in range(_ROUNDS):
        packed.solve(rough, known, p)
        others, own = np.where(each, 0.0, p), p[each]
        packed.take(theirs, packed.velocities(others)[each]).solve(targets[theirs], known[theirs], own)
        p[each] = own
        u = packed.velocities(p)
        off = coulomb_defect(u[np.repeat(rest, 3)], p[np.repeat(rest, 3)], packed.mu[rest])
        if off <= targets[rest].min() / _MARGIN:
            break
        rough[here], known = 0.3 * rough[here], np.ones(len(known), bool)


def renumbered(bound: Array, chosen: Array) -> Array:
    """Return the contacts that bound some others, chosen by a mask, in numbers of those that are chosen."""
    own = bound[chosen]
    return np.where(own >= 0, (np.cumsum(chosen) - 1)[own], -1)


def _packed(rows: csr_array, bound: Array) -> tuple[Array, Array, Array, Array]:
    """Return what `pack_contacts` makes of whitened rows."""
    m, n = rows.shape[0] // 3, rows.shape[1]
    columns, starts = np.empty(rows.nnz, np.uint32), np.empty(m + 1, np.uint32)
    blocks, local = np.empty(3 * rows.nnz), np.empty((m, 7))
    own_columns, own_starts = rows.indices.astype(np.uint32), rows.indptr.astype(np.uint32)
    pack_contacts(rows.data, own_columns, own_starts, n, bound, blocks, columns, starts, local)
    entries = int(starts[-1])
    return blocks[: 3 * entries], columns[:entries], starts, local


def _by_contact(values: Array) -> Array:
    return values.reshape(-1, 3)


def _turned(values: Array, local: Array, sense: float) -> Array:
    """Return vectors of contacts, shape (m, 3), in the turned tangents of `pack_contacts`; back if the sense is -1."""
    x, y = local[:, 4], sense * local[:, 5]
    return np.stack([values[:, 0], x * values[:, 1] + y * values[:, 2], x * values[:, 2] - y * values[:, 1]], axis=1)
