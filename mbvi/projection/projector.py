"""The projection min |w - x|_M subject to J w >= c: scales it, tries solvers in order, and checks the residual."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import NamedTuple, Protocol

import numpy as np
from scipy.sparse import csr_array, vstack

from ..arguments import shown
from ..compiled import plain_array
from ..errors import InfeasibleError, InputError, ProjectionError
from .active_set import ActiveSet
from .cascade import dense_solvers, first_good_enough
from .coulomb import MOST_CONTACTS
from .dual_active_set import DualActiveSet, dual_active_set
from .energy_cap import capped_restitution
from .free_motion import FreeMotion
from .friction import (
    NO_START,
    FrictionalProjection,
    FrictionalStart,
    bearing_contacts,
    law_of_contacts,
    project_frictional,
)
from .friction_sparse import project_frictional_sparse
from .fused_step import MOST_FUSED, FusedStep, LinearGaps, Settled, contradiction
from .metric import Array, Metric
from .proxqp import ProxQP
from .scaled_qp import Candidate, Projection, ScaledQP, Solver
from .sparse_pcg import SparsePCG
from .tree import TreeFreeMotion
from .warm_start import LastPercussions, contact_keys

SOLVERS = (ProxQP, ActiveSet, DualActiveSet, SparsePCG)
# most rows of a failed problem that the dual active-set method checks for contradictions
_MOST_CHECKED = 400

# error of a rate, in accepted depths per step: an accepted depth also holds what earlier steps left
_SHARE = 0.25
# the largest residual that follows from a depth
_MOST_RESIDUAL = 1e-2
# the residual of bodies nearly at rest, relative to their speed over that of a step of free fall; and its least share.
# Where rows depend on each other, speeds that a residual leaves are up to ten times as large
_OF_SPEED, _LEAST = 0.01, 1.0 / 30.0

# entries of the rows of few contacts up to which they are solved as dense ones
_MOST_DENSE = 2_000_000

_NONE = np.zeros(0)

ChosenSolver = ProxQP | ActiveSet | DualActiveSet | SparsePCG


class FrictionalRows(Protocol):
    """What the projection needs of rows with tangents, which `constraints.Rows` has."""

    @property
    def constraint(self) -> Array:
        """The constraint of each row, shape (k,)."""

    @property
    def jacobian(self) -> Array | csr_array:
        """Gradients, shape (k, nv)."""

    @property
    def restitution(self) -> Array:
        """Restitution, shape (k,)."""

    @property
    def rate(self) -> Array | None:
        """Rates of gaps at v = 0, shape (k,)."""

    @property
    def tangents(self) -> TangentRows | None:
        """Their tangents."""


class TangentRows(Protocol):
    """What it needs of tangents, which `constraints.Tangents` has."""

    @property
    def friction(self) -> Array:
        """Coefficients, shape (k,)."""

    @property
    def jacobian(self) -> Array | csr_array:
        """Gradients, shape (2 k, nv)."""

    @property
    def rate(self) -> Array | None:
        """Rates at v = 0, shape (2 k,)."""


class AcceptedDepth(NamedTuple):
    """The penetration that a run accepts.

    Attributes
    ----------
    relative : float
        Relative to a size of the bodies.
    depth : float
        The same as a length [m].
    levers : callable
        Returns the factors that turn gaps of constraints, given by their numbers, into lengths.
    """

    relative: float
    depth: float
    levers: Callable[[Array], Array | float]

    def residual(self, qp: ScaledQP, contacts: Array | None, h: float) -> float:
        """Return the relative residual with which the gaps of a step h [s] are off by a quarter of the depth at most.

        A scaled row whose residual is r times the largest scaled speed s has the rate error r s l, where l is the
        length of its gradient in the metric. The residual is never larger than the relative depth or 1e-2: slow bodies
        would otherwise move at the speeds that it leaves.
        """
        lengths = qp.lengths if contacts is None else qp.lengths * self.levers(contacts)
        found = _SHARE * self.depth / (h * qp.scale * qp.largest * float(lengths.max()))
        return min(found, self.largest_residual)

    @property
    def largest_residual(self) -> float:
        """The residual of slow bodies, which does not follow from the depth."""
        return min(self.relative, _MOST_RESIDUAL)


class Projector:
    """Projections one after the other, each started from the last percussions.

    Unless a solver is chosen, solvers are tried in order. The first answer whose KKT residual is good enough is taken
    (`cascade.good_enough`). The order for dense rows is `FusedStep`, `GuessedSet`, `RefinedProxQP`, `DualActiveSet`.
    Sparse rows are solved by `SparsePCG`.

    Parameters
    ----------
    residual : float
        The relative KKT residual above which a projection raises.
    solver : ProxQP, ActiveSet, DualActiveSet or SparsePCG, optional
        The only solver of every projection.
    accepted : AcceptedDepth, optional
        Replaces the residual in projections of sparse rows that give the length of their step.
    friction_residual : float, optional
        The relative residual of Coulomb's law for more than 32 contacts; `residual` by default.
    energy_cap : bool
        Whether `capped_restitution` limits e.

    Attributes
    ----------
    strictest, loosest : float
        The least and the largest residual that followed from the accepted depth; inf and 0 before the first.
    """

    def __init__(
        self,
        residual: float = 1e-6,
        solver: ChosenSolver | None = None,
        accepted: AcceptedDepth | None = None,
        friction_residual: float | None = None,
        energy_cap: bool = False,
    ) -> None:
        self.energy_cap = energy_cap
        self.friction_residual = residual if friction_residual is None else friction_residual
        self._last_frictional = LastPercussions()
        self._frictional_start = NO_START
        self.residual, self.solver, self.accepted = residual, solver, accepted
        self.strictest, self.loosest = np.inf, 0.0
        # speed of the bodies over that of a step of free fall
        self._speed = np.inf
        self._last = LastPercussions()
        self._fused = FusedStep(self._last, residual) if solver is None else None

    def lend(self, percussion: Array, start: Array, size: Array) -> None:
        """Write what the next law starts from: percussions, the start with friction, and how many entries they have.

        The last entry of `size`, shape (3,), is whether the start is unique.
        """
        last, (first, unique) = self._last.percussion, self._frictional_start
        # longer ones are of no use where the rows are few
        size[:] = len(last) * (len(last) <= len(percussion)), len(first) * (len(first) <= len(start)), unique
        percussion[: size[0]], start[: size[1]] = last[: size[0]], first[: size[1]]

    def take_back(self, percussion: Array, start: Array, size: Array) -> None:
        """Read the same."""
        self._last.percussion, self._last.keys = percussion[: size[0]].copy(), None
        self._frictional_start = FrictionalStart(start[: size[1]].copy(), bool(size[2]))

    def begin(self, v: Array, free: Array) -> None:
        """Begin a step with the speeds v of bodies, which forces alone lead to `free`.

        The residual that follows from an accepted depth falls with the largest speed of bodies nearly at rest, so that
        it does not keep them moving.
        """
        fall = np.abs(free - v).max(initial=0.0)
        self._speed = float(np.abs(v).max(initial=0.0) / fall) if fall > 0.0 else np.inf

    def _at_speed(self, residual: float) -> float:
        """Return the residual that bodies of the present speed take, where those that fall take the given one."""
        return residual * min(1.0, max(_OF_SPEED * self._speed / residual, _LEAST))

    @property
    def residual_at_rest(self) -> float:
        """The relative residual of projections of sparse rows of bodies at rest."""
        return self.residual if self.accepted is None else _LEAST * self.accepted.largest_residual

    def project(
        self,
        x: Array,
        metric: Metric,
        J: Array | csr_array,
        lower: Array,
        contacts: Array | None = None,
        h: float | None = None,
    ) -> Projection:
        """Project x, as `mbvi.project` but without checks of the arguments.

        Parameters
        ----------
        contacts : ndarray of int, shape (m,), optional
            The constraint of each row. Sparse rows are matched by it with the percussions of the last projection.
        h : float, optional
            Length of the step after which the rates must keep gaps open [s]; the residual then follows from the
            accepted depth.
        """
        if self._fused is not None and 0 < len(lower) <= MOST_FUSED and isinstance(J, np.ndarray):
            found = self._fused.project(x, metric, J, lower)
            if found is not None:
                return found
        return self._solve(x, metric, J, lower, contacts, h)

    def law(
        self,
        v: Array,
        motion: FreeMotion | TreeFreeMotion,
        J: Array | csr_array,
        e: Array,
        contacts: Array | None = None,
        opened: Array | None = None,
    ) -> tuple[Array, Array, float]:
        """Return argmin |w - x|_M with J w >= -e J v, the rates of the rows, and the relative KKT residual.

        Parameters
        ----------
        v : ndarray, shape (nv,)
            Velocity before.
        motion : FreeMotion
            The velocity x under forces alone, and M.
        J : ndarray, shape (m, nv)
            Gradients of the active constraints.
        e : ndarray, shape (m,)
            Restitution of each.
        contacts : ndarray of int, shape (m,), optional
            As of `project`.
        opened : ndarray, shape (m,), optional
            Speeds at which rows that are open may close, 0 of others; see `newton_law`.

        Returns
        -------
        velocity : ndarray, shape (nv,)
            Velocity after.
        rates : ndarray, shape (4, m)
            Percussion, J x, J w and J v of each row.
        residual : float
            As of a `Projection`.
        """
        m, opened = len(e), _NONE if opened is None else opened
        if self._fused is not None and m <= MOST_FUSED and isinstance(J, np.ndarray):
            found = self._fused.law(v, motion, J, e, opened)
            if found is not None:
                return found
        x, rates = motion.free, np.empty((4, m))
        rates[3] = J.dot(v)
        lower = -e * rates[3]
        if len(opened):
            lower = np.where((opened > 0.0) & (rates[3] > -opened), np.minimum(lower, -opened), lower)
        velocity, rates[0], residual = self._solve(x, motion.metric, J, lower, contacts)
        rates[1], rates[2] = J.dot(x), J.dot(velocity)
        return velocity, rates, residual

    def frictional(
        self, x: Array, metric: Metric, rows: FrictionalRows, lower: Array, h: float | None = None
    ) -> FrictionalProjection | Projection:
        """Return the velocity of Coulomb's law with J w >= lower on normals; percussions have shape (3 k,).

        Of few contacts also their velocities.

        Parameters
        ----------
        rows : Rows
            Rows with tangents.
        x, metric, lower, h
            As of `project`.
        """
        tangents, m = rows.tangents, len(lower)
        assert tangents is not None
        bounds = np.zeros((m, 3))
        bounds[:, 0] = lower
        if tangents.rate is not None:
            bounds[:, 1:] = -tangents.rate.reshape(-1, 2)
        if _are_few(m, len(x)):
            J, start = _wide(rows.jacobian, tangents), self._frictional_start
            found = project_frictional(x, metric, J, bounds.ravel(), tangents.friction, self.residual, start)
            self._frictional_start = FrictionalStart(found.start, found.unique)
            return found
        if isinstance(rows.jacobian, np.ndarray):
            few = bearing_contacts(x, metric, _wide(rows.jacobian, tangents), bounds, tangents.friction, self.residual)
            if few is not None:
                return few
        return self._many_frictional(x, metric, rows, bounds.ravel(), h)

    def frictional_law(
        self, motion: FreeMotion | TreeFreeMotion, rows: FrictionalRows, opened: Array | None
    ) -> tuple[Array, Array, float, Array] | None:
        """Return velocity, rates, residual and slip of Coulomb's law for the contacts of one mechanism, in one kernel.

        They are as of `law_of_contacts`. None where the rows are not those of one mechanism or are too many, where none
        has friction, where e is capped, or where the residual is too large.

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
        T = tangents.jacobian
        if m > MOST_CONTACTS or self.energy_cap or not isinstance(T, np.ndarray):
            return None
        drift = _NONE if rows.rate is None and tangents.rate is None else _drift(rows, tangents).ravel()
        e, mu = plain_array(rows.restitution), plain_array(tangents.friction)
        J, T, opened = plain_array(J), plain_array(T), _NONE if opened is None else plain_array(opened)
        found = law_of_contacts(motion, J, T, e, drift, opened, mu, self._frictional_start, self.residual)
        if found is None:
            return None
        self._frictional_start = found[4]
        return found[:4]

    def capped_restitution(self, x: Array, metric: Metric, rows: FrictionalRows, before: Array) -> Array | None:
        """Return the largest restitution of rows, at most their own, with which an impact gains no energy.

        None where e is not capped, where rows have no friction or do not bounce, or for more than 32 contacts.

        Parameters
        ----------
        before : ndarray, shape (k,)
            Rates of their gaps before [m/s].
        x, metric, rows
            As of `frictional`.
        """
        e, tangents = rows.restitution, rows.tangents
        if not self.energy_cap or tangents is None or not tangents.friction.any() or not e.any():
            return None
        if not _are_few(len(e), len(x)):
            return None
        rate = _drift(rows, tangents)
        J = _wide(rows.jacobian, tangents)
        return capped_restitution(
            x, metric, J, before - rate[:, 0], e, tangents.friction, rate.ravel(), self.residual
        ).e

    def _many_frictional(
        self, x: Array, metric: Metric, rows: FrictionalRows, bounds: Array, h: float | None
    ) -> Projection:
        """Return the same of many contacts, started from their last percussions."""
        tangents, keys = rows.tangents, contact_keys(rows.constraint)
        assert tangents is not None
        J = csr_array(vstack([csr_array(rows.jacobian), csr_array(tangents.jacobian)], format="csr"))
        J = J[interleaved(len(keys))]
        residual, rate = self.friction_residual, np.inf
        if self.accepted is not None and h is not None:
            residual, rate = self.accepted.largest_residual, _SHARE * self.accepted.depth / h
            residual = self._at_speed(residual)
        start = self._last_frictional.of_rows(keys)
        found = project_frictional_sparse(x, metric, J, bounds, tangents.friction, residual, start, rate)
        self._last_frictional.keep(found.percussion.reshape(-1, 3), keys)
        return found

    def settle(
        self,
        motion: FreeMotion | TreeFreeMotion,
        gaps: LinearGaps,
        w: Array,
        displacement: Array,
        law: Array,
        rates: Array,
    ) -> Settled | None:
        """Project closed contacts out of penetration in one kernel, or return None; see `FusedStep.settle`."""
        if self._fused is None or len(law) > MOST_FUSED:
            return None
        return self._fused.settle(motion, gaps, w, displacement, law, rates)

    def _solve(
        self,
        x: Array,
        metric: Metric,
        J: Array | csr_array,
        lower: Array,
        contacts: Array | None,
        h: float | None = None,
    ) -> Projection:
        """Scale the QP, call the solvers, and check the residual."""
        qp = ScaledQP(x, metric, J, lower, self.residual)
        if qp.satisfied:
            return Projection(x, np.zeros(len(lower)), 0.0)
        if not (qp.lengths > 0.0).all():
            return self._without_zero_rows(qp, contacts, h)
        if self.accepted is not None and h is not None:
            residual = self.accepted.residual(qp, contacts, h)
            residual = self._at_speed(residual)
            qp.relative_tolerance = self._accepted_residual(residual, qp.sparse)
        keys = contact_keys(contacts) if qp.sparse and contacts is not None else None
        start = self._last.start(qp, keys)
        found, residual = first_good_enough(qp, self._solvers(qp), start)
        # written so that a NaN is refused too
        if found is None or not residual <= qp.tolerance:
            raise self._failure(qp, found, residual)
        result = qp.result(found, residual)
        self._last.keep(result.percussion, keys)
        return result

    def _accepted_residual(self, residual: float, sparse: bool) -> float:
        """Return the residual of a projection; dense rows are solved at least as well as without a depth."""
        if not sparse:
            return min(residual, self.residual)
        self.strictest, self.loosest = min(self.strictest, residual), max(self.loosest, residual)
        return residual

    def _solvers(self, qp: ScaledQP) -> Iterable[Solver]:
        if self.solver is not None:
            return [self.solver]
        return [SparsePCG()] if qp.sparse else dense_solvers()

    def _without_zero_rows(self, qp: ScaledQP, contacts: Array | None, h: float | None) -> Projection:
        """Project without the rows whose gradient is zero: J w >= lower reads 0 >= lower there."""
        kept = qp.lengths > 0.0
        if (qp.lower[~kept] > 0.0).any():
            raise InfeasibleError(
                "a constraint whose gradient vanishes demands a positive rate: no velocity gives it", _problem(qp)
            )
        contacts = None if contacts is None else contacts[kept]
        part = self.project(qp.x, qp.metric, qp.J[kept], qp.lower[kept], contacts, h)
        percussion = np.zeros(len(qp.lower))
        percussion[kept] = part.percussion
        return Projection(part.velocity, percussion, part.residual)

    def _failure(self, qp: ScaledQP, found: Candidate | None, residual: float) -> ProjectionError:
        problem = _problem(qp)
        if _contradictory(qp, found):
            return contradiction(problem)
        solver = "" if self.solver is None else f" by {self.solver!r}"
        relative = qp.relative(residual)
        return ProjectionError(
            f"the projection onto {len(qp.lower)} constraints{solver} stopped at the relative KKT residual "
            f"{relative:.1e}, above {qp.relative_tolerance:.1e}; the problem is in `.problem`",
            problem,
            float(relative),
        )


def _problem(qp: ScaledQP) -> dict[str, Array | csr_array | Metric]:
    # the dense M of many bodies could be too large for the memory
    return {"x": qp.x, "M": qp.metric if qp.sparse else qp.metric.dense(), "J": qp.J, "lower": qp.lower}


def _contradictory(qp: ScaledQP, found: Candidate | None) -> bool:
    """Return whether it is certain that no velocity meets the rows.

    It is certain (Farkas' lemma) if some u >= 0 has J' u = 0 and lower . u > 0. The percussions found are tried as u;
    then the dual active-set method searches for contradicting rows.
    """
    if found is not None and found.u.any():
        size = np.abs(qp.combine(found.u)).max(initial=0.0)
        terms = (abs(qp.rows).T @ found.u).max(initial=0.0)
        lower = qp.lower / qp.lengths
        if size <= 1e-6 * terms and lower @ found.u > 1e-6 * np.abs(lower) @ found.u:
            return True
    return len(qp.d) <= _MOST_CHECKED and dual_active_set(qp.columns, qp.d) is None


def _are_few(contacts: int, nv: int) -> bool:
    """Return whether contacts with friction are solved as dense rows."""
    return contacts <= MOST_CONTACTS and 3 * contacts * nv <= _MOST_DENSE


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


def interleaved(m: int) -> Array:
    """Return the order of 3 m rows that puts the tangents of each contact behind its normal; tangents come last."""
    return np.stack([np.arange(m), m + 2 * np.arange(m), m + 2 * np.arange(m) + 1], axis=1).ravel()


def checked_solver(solver: ChosenSolver | None) -> ChosenSolver | None:
    """Return the solver if it is one, or None; raise `InputError` otherwise."""
    if solver is not None and not isinstance(solver, SOLVERS):
        names = ", ".join(f"mbvi.{kind.__name__}()" for kind in SOLVERS)
        raise InputError(f"solver must be None or one of {names}; got {shown(solver)}")
    return solver
