"""Coulomb's law for rows with tangents, one step after the other: which solver takes them, and from which start."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array, vstack
from scipy.sparse.csgraph import connected_components

from ...compiled import plain_array
from ...errors import ProjectionError
from ..acceptance import OF_MECHANISMS, Acceptance
from ..dense.scaled_qp import Projection
from ..free_motion import FreeMotion
from ..frictional_rows import FrictionalRows, TangentRows
from ..metric import Array, Metric
from ..tree import TreeFreeMotion
from ..warm_start import LastPercussions, contact_keys
from .energy_cap import capped_restitution
from .few_contacts import MOST_CONTACTS
from .friction import EXACT, NO_START, FrictionalProjection, FrictionalStart, law_of_contacts, project_frictional
from .friction_sparse import FineRows, project_frictional_sparse, renumbered

# so many contacts have no other solver
_FEW_ENOUGH = 32
# entries of the rows of few contacts up to which they are solved as dense ones
_MOST_DENSE = 2_000_000

_NONE = np.zeros(0)


class FrictionalLaws:
    """Coulomb's law in one step after the other, each started from the last percussions.

    Parameters
    ----------
    residual : float
        The relative residual of few contacts, and of all contacts of mechanisms.
    energy_cap : bool
        Whether `capped_restitution` limits e.
    acceptance : Acceptance
        Which answers are accepted.

    Attributes
    ----------
    yielding : ndarray of bool, shape (k,), or None
        Which contacts of the last `project` had their bounds lowered; None if none had.
    jams : int
        In how many laws there were such contacts.
    """

    def __init__(self, residual: float, energy_cap: bool, acceptance: Acceptance) -> None:
        self._residual, self._energy_cap, self._acceptance = residual, energy_cap, acceptance
        self._last, self.start = LastPercussions(), NO_START
        self.yielding: Array | None = None
        self.jams = 0

    def forget(self) -> None:
        """Forget the last percussions: the next laws start from none."""
        self._last, self.start = LastPercussions(), NO_START

    def project(
        self, x: Array, metric: Metric, rows: FrictionalRows, lower: Array, residual: float, rate: float
    ) -> FrictionalProjection | Projection:
        """Return the velocity of Coulomb's law with J w >= lower on normals; percussions have shape (3 k,).

        Of few contacts also their velocities. Bodies that jam may have no velocity with which contacts part as fast as
        `lower` demands. Among them contacts are only kept from closing then (`yielding`), for which there is one where
        walls are at rest.

        Parameters
        ----------
        x : ndarray, shape (nv,)
            Velocity under the forces alone.
        metric : Metric
            M.
        rows : Rows
            Rows with tangents.
        lower : ndarray, shape (k,)
            Least normal rates.
        residual, rate : float
            The relative residual of more contacts of free bodies, and the error of velocities that they may have.

        Raises
        ------
        ProjectionError
            If the law is not solved with the lower bounds either.
        """
        self.yielding = None
        try:
            return self._project(x, metric, rows, lower, residual, rate)
        except ProjectionError:
            still = np.zeros(len(lower)) if rows.rate is None else -rows.rate
            parting = lower > still
            if not parting.any():
                raise
            self.yielding, self.jams = parting & self._jammed(x, metric, rows, lower, residual, rate), self.jams + 1
            return self._project(x, metric, rows, np.where(self.yielding, still, lower), residual, rate)

    def _jammed(
        self, x: Array, metric: Metric, rows: FrictionalRows, lower: Array, residual: float, rate: float
    ) -> Array:
        """Return which contacts belong to bodies for which the law is not solved, shape (k,)."""
        assert rows.tangents is not None
        J = _contact_rows(rows)
        W = abs(metric.whiten_rows(J))
        _, label = connected_components(W @ W.T, directed=False)
        bounds, mu, fine = _bounds(rows, lower), rows.tangents.friction, self._fine_rows(J, rows.constraint)
        # normals of joints are zero
        bound = rows.tangents.bound
        label = np.where(mu < 0.0, label[1::3], label[::3])
        if bound is not None:
            label = np.where(bound >= 0, label[bound], label)
        islands = np.unique(label)
        jammed = np.full(len(lower), len(islands) == 1)
        for island in islands if len(islands) > 1 else []:
            some = label == island
            own = None if fine is None else FineRows(fine.contacts[some], fine.residual, fine.rates[some])
            law = J[np.repeat(some, 3)], bounds[some].ravel(), mu[some]
            bound_of = None if bound is None else renumbered(bound, some)
            try:
                if (mu[some] < 0.0).any():
                    project_frictional(x, metric, law[0].toarray(), *law[1:], residual, bound=bound_of)
                else:
                    project_frictional_sparse(
                        x, metric, *law, residual, rate=rate, fine=own, accepted=self._acceptance.bound, bound=bound_of
                    )
            except ProjectionError:
                jammed |= some
        return jammed

    def _project(
        self, x: Array, metric: Metric, rows: FrictionalRows, lower: Array, residual: float, rate: float
    ) -> FrictionalProjection | Projection:
        """Return what `project` returns, with the bounds as they are; errors name the contact that closes fastest."""
        try:
            return self._solved(x, metric, rows, lower, residual, rate)
        except ProjectionError as error:
            if error.constraint is None:
                error.constraint = int(rows.constraint[(lower - rows.jacobian @ x).argmax()])
            raise

    def _solved(
        self, x: Array, metric: Metric, rows: FrictionalRows, lower: Array, residual: float, rate: float
    ) -> FrictionalProjection | Projection:
        """Return what `_project` does."""
        tangents, m, accepted = rows.tangents, len(lower), self._acceptance.bound
        assert tangents is not None
        bounds = _bounds(rows, lower)
        if _are_few(m, len(x)) or _has_joints(rows):
            try:
                return self._solved_as_few(x, metric, rows, bounds, lower)
            except ProjectionError:
                # of more contacts sweeps may still reach their larger residual
                if m <= _FEW_ENOUGH or _has_joints(rows):
                    raise
        keys = contact_keys(rows.constraint)
        J, (start, known) = _contact_rows(rows), self._last.of_contacts(keys)
        fine = self._fine_rows(J, rows.constraint)
        law = x, metric, J, bounds.ravel(), tangents.friction

        def solved(asked: float, start: Array, known: Array) -> tuple[Projection, Array]:
            many = project_frictional_sparse(*law, asked, start, known, rate, fine, accepted, tangents.bound)
            return many, lower - rows.jacobian @ many.velocity

        def again(factor: float, last: Projection) -> tuple[Projection, Array] | None:
            try:
                return solved(factor * residual, last.percussion, np.ones(m, bool))
            except ProjectionError:
                return None

        many, closing = self._acceptance.refined(rows.constraint, solved(residual, start, known), again)
        first = residual if fine is None or not fine.contacts.any() else fine.residual
        self._accept(many, first, rows, lower, closing)
        self._last.keep(many.percussion.reshape(-1, 3), keys)
        return many

    def _solved_as_few(
        self, x: Array, metric: Metric, rows: FrictionalRows, bounds: Array, lower: Array
    ) -> FrictionalProjection:
        """Return what `_project` does, by the solver of few contacts; `bounds` are those of all rows, shape (k, 3)."""
        tangents = rows.tangents
        assert tangents is not None
        J, residual = _wide(rows.jacobian, tangents), self._acceptance.bound(self._residual)
        law = x, metric, J, bounds.ravel(), tangents.friction, residual, self.start, tangents.bound
        found = project_frictional(*law)
        self._accept(found, self._residual, rows, lower, lower - found.after[::3])
        self.start = FrictionalStart(found.start, found.unique)
        return found

    def _fine_rows(self, J: csr_array, numbers: Array) -> FineRows | None:
        """Return which contacts are those of mechanisms, given all their rows and their constraints; None in no run."""
        stated = self._acceptance.stated
        if stated is None:
            return None
        contacts = stated.of_mechanisms(J).reshape(-1, 3)
        return FineRows(np.asarray(contacts.any(axis=1)), min(self._residual, OF_MECHANISMS), stated.aims(numbers))

    def _accept(
        self, found: FrictionalProjection | Projection, residual: float, rows: FrictionalRows, lower: Array,
        closing: Array,
    ) -> None:  # fmt: skip
        """Raise `ProjectionError` if a row sinks too deep; see `Acceptance.check`."""
        about = {"w": found.velocity, "J": rows.jacobian, "lower": lower}
        self._acceptance.check(found.residual, residual, rows.constraint, closing, lambda: about)

    def law(
        self, motion: FreeMotion | TreeFreeMotion, rows: FrictionalRows, opened: Array | None
    ) -> tuple[Array, Array, float, Array] | None:
        """Return velocity, rates, residual and slip of Coulomb's law for the contacts of one mechanism, in one kernel.

        See `law_of_contacts`. None where the rows are not those of one mechanism or are too many, where none
        has friction or one torsional or rolling friction, where e is capped, or where the law is not solved exactly.

        Parameters
        ----------
        motion : TreeFreeMotion
            The free motion; None is returned for others.
        rows : Rows
            Rows with tangents.
        opened : ndarray, shape (k,), or None
            Speeds at which rows that are open may close, 0 of others.
        """
        tangents, J, m = rows.tangents, rows.jacobian, len(rows.restitution)
        if type(motion) is not TreeFreeMotion or tangents is None or not isinstance(J, np.ndarray):
            return None
        if tangents.resistance is not None:
            return None
        T = tangents.jacobian
        if m > MOST_CONTACTS or self._energy_cap or not isinstance(T, np.ndarray):
            return None
        drift = _NONE if rows.rate is None and tangents.rate is None else _drift(rows, tangents).ravel()
        e, mu = plain_array(rows.restitution), plain_array(tangents.friction)
        J, T, opened = plain_array(J), plain_array(T), _NONE if opened is None else plain_array(opened)
        found = law_of_contacts(motion, J, T, e, drift, opened, mu, self.start, EXACT * self._residual)
        if found is None:
            return None
        self.start = found[4]
        return found[:4]

    def capped_restitution(self, x: Array, metric: Metric, rows: FrictionalRows, before: Array) -> Array | None:
        """Return the largest restitution of rows, at most their own, with which an impact gains no energy.

        None where e is not capped, where rows have no friction or do not bounce, or for more than 64 contacts.

        Parameters
        ----------
        before : ndarray, shape (k,)
            Rates of their gaps before [m/s].
        x, metric, rows
            See `project`.
        """
        e, tangents = rows.restitution, rows.tangents
        if not self._energy_cap or tangents is None or not tangents.friction.any() or not e.any():
            return None
        if not _are_few(len(e), len(x)):
            return None
        rate = _drift(rows, tangents)
        J = _wide(rows.jacobian, tangents)
        return capped_restitution(
            x, metric, J, before - rate[:, 0], e, tangents.friction, rate.ravel(), self._residual
        ).e


def _are_few(contacts: int, nv: int) -> bool:
    """Return whether contacts with friction are solved as dense rows."""
    return contacts <= MOST_CONTACTS and 3 * contacts * nv <= _MOST_DENSE


def _has_joints(rows: FrictionalRows) -> bool:
    """Return whether some row is the dry friction of a joint."""
    return rows.tangents is not None and bool((rows.tangents.friction < 0.0).any())


def _drift(rows: FrictionalRows, tangents: TangentRows) -> Array:
    """Return the rates of contacts at v = 0, each normal followed by its tangents, shape (m, 3)."""
    rate = np.zeros((len(rows.restitution), 3))
    if rows.rate is not None:
        rate[:, 0] = rows.rate
    if tangents.rate is not None:
        rate[:, 1:] = tangents.rate.reshape(-1, 2)
    return rate


def _wide(J: Array | csr_array, tangents: TangentRows) -> Array:
    """Return dense rows of contacts, each normal followed by its tangents, shape (3 m, nv)."""
    wide = np.empty((J.shape[0], 3, J.shape[1]))
    wide[:, 0], wide[:, 1:] = _full(J), _full(tangents.jacobian).reshape(len(wide), 2, -1)
    return wide.reshape(-1, J.shape[1])


def _full(rows: Array | csr_array) -> Array:
    return rows if isinstance(rows, np.ndarray) else rows.toarray()


def _bounds(rows: FrictionalRows, lower: Array) -> Array:
    """Return the bounds of normals and the rates of tangents at which contacts stick, shape (k, 3)."""
    bounds = np.zeros((len(lower), 3))
    bounds[:, 0] = lower
    if rows.tangents is not None and rows.tangents.rate is not None:
        bounds[:, 1:] = -rows.tangents.rate.reshape(-1, 2)
    return bounds


def _contact_rows(rows: FrictionalRows) -> csr_array:
    """Return sparse rows of contacts, each normal followed by its tangents, shape (3 k, nv)."""
    assert rows.tangents is not None
    m = rows.jacobian.shape[0]
    order = np.stack([np.arange(m), m + 2 * np.arange(m), m + 2 * np.arange(m) + 1], axis=1).ravel()
    both = vstack([csr_array(rows.jacobian), csr_array(rows.tangents.jacobian)], format="csr")
    return csr_array(both)[order]
