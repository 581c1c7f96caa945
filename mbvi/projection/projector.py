"""The projection min |w - x|_M subject to J w >= c: scales it, chooses a solver, and checks the residual."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from ..arguments import shown
from ..errors import InfeasibleError, InputError, ProjectionError
from .acceptance import OF_MECHANISMS, Acceptance, AcceptedDepth, StatedDepth
from .coulomb.friction import FrictionalProjection, FrictionalStart
from .coulomb.frictional_laws import FrictionalLaws
from .dense.dual_active_set import DualActiveSet, contradictory
from .dense.fused_step import FEW, MOST_FUSED, FusedStep, contradiction
from .dense.proxqp import ProxQP
from .dense.scaled_qp import Candidate, Projection, ScaledQP, Solver, WarmStart
from .free_motion import FreeMotion
from .frictional_rows import FrictionalRows
from .metric import Array, DiagonalMetric, Metric
from .sparse.column_blocks import touched_columns
from .sparse.sparse_pcg import SparsePCG, refine
from .tree import TreeFreeMotion
from .warm_start import LastPercussions, contact_keys

SOLVERS = (ProxQP, DualActiveSet, SparsePCG)
# speeds at which open rows may close where no row is open
_NONE_OPEN = np.zeros(0)
# the residual of bodies nearly at rest, relative to their speed over that of a step of free fall; and its least share.
# Where rows depend on each other, speeds that a residual leaves are up to ten times as large
_OF_SPEED, _LEAST = 0.01, 1.0 / 30.0

ChosenSolver = ProxQP | DualActiveSet | SparsePCG


class Projector:
    """Projections one after the other, each started from the last percussions.

    Unless a solver is chosen, dense rows are solved by `FusedStep`, and by `DualActiveSet` where its residual is too
    large. Sparse rows are solved by `SparsePCG`; up to 32 rows of spheres by `FusedStep`, on the spheres that they
    touch.

    Parameters
    ----------
    residual : float
        The relative KKT residual above which a projection raises.
    solver : ProxQP, DualActiveSet or SparsePCG, optional
        The only solver of every projection.
    accepted : AcceptedDepth, optional
        Replaces the residual in projections of sparse rows that give the length of their step.
    friction_residual : float, optional
        The relative residual of Coulomb's law where more than 64 contacts are not solved exactly; `residual` by
        default.
    energy_cap : bool
        Whether restitution is limited so that no impact with friction gains energy.
    stated : StatedDepth, optional
        How deep an error may let a row sink in a step.

    Attributes
    ----------
    acceptance : Acceptance
        Which answers are accepted.
    friction : FrictionalLaws
        Coulomb's law for rows with tangents.
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
        stated: StatedDepth | None = None,
    ) -> None:
        self.acceptance = Acceptance(stated)
        self.friction = FrictionalLaws(residual, energy_cap, self.acceptance)
        self.friction_residual = residual if friction_residual is None else friction_residual
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
        last, (first, unique) = self._last.percussion, self.friction.start
        # longer ones are of no use where the rows are few
        size[:] = len(last) * (len(last) <= len(percussion)), len(first) * (len(first) <= len(start)), unique
        percussion[: size[0]], start[: size[1]] = last[: size[0]], first[: size[1]]

    def take_back(self, percussion: Array, start: Array, size: Array) -> None:
        """Read the same."""
        self._last.percussion, self._last.keys = percussion[: size[0]].copy(), None
        self.friction.start = FrictionalStart(start[: size[1]].copy(), bool(size[2]))

    @property
    def usual_step(self) -> float:
        """Length of a usual step of the run [s]; 0 where it is not known."""
        stated = self.acceptance.stated
        return 0.0 if stated is None else stated.h

    def forget(self) -> None:
        """Forget the last percussions: the next projections start from none."""
        self._last.percussion, self._last.keys = np.zeros(0), None
        self.friction.forget()

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
        if self._fused is not None and 0 < len(lower) <= MOST_FUSED:
            if isinstance(J, np.ndarray):
                found = self._fused.project(x, metric, J, lower)
                if found is not None:
                    return found
            elif len(lower) <= FEW and type(metric) is DiagonalMetric:
                part, rows = touched_columns(J)
                found = self._fused.project(x[part], DiagonalMetric(metric.diagonal[part]), rows, lower)
                if found is not None:
                    return found._replace(velocity=_moved(x, part, found.velocity))
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
            See `project`.
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
        m, opened = len(e), _NONE_OPEN if opened is None else opened
        if self._fused is not None and m <= MOST_FUSED and isinstance(J, np.ndarray):
            found = self._fused.law(v, motion, J, e, opened)
            if found is not None:
                return found
        if self._fused is not None and m <= FEW and type(motion.metric) is DiagonalMetric:
            part, rows = touched_columns(J)
            few = FreeMotion(motion.free[part], DiagonalMetric(motion.metric.diagonal[part]))
            found = self._fused.law(v[part], few, rows, e, opened)
            if found is not None:
                return _moved(motion.free, part, found[0]), *found[1:]
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
        """Return the velocity of Coulomb's law with J w >= lower on normals; see `FrictionalLaws.project`.

        The arguments are those of `project`, but for the rows, which have tangents.
        """
        residual, rate = self.friction_residual, np.inf
        if self.accepted is not None and h is not None:
            residual, rate = self._at_speed(self.accepted.largest_residual), self.accepted.rate(h)
        return self.friction.project(x, metric, rows, lower, residual, rate)

    def _solve(
        self,
        x: Array,
        metric: Metric,
        J: Array | csr_array,
        lower: Array,
        contacts: Array | None,
        h: float | None = None,
    ) -> Projection:
        """Scale the QP, call the solver, and check the residual."""
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
        solver: Solver = self.solver or (SparsePCG() if qp.sparse else DualActiveSet())
        asked, (found, residual) = qp.relative_tolerance, self._attempt(qp, solver, start, J)
        qp.relative_tolerance = self.acceptance.bound(asked)
        # written so that a NaN is refused too
        if found is None or not residual <= qp.tolerance:
            raise self._failure(qp, found, residual, contacts)

        def taken(found: Candidate, residual: float) -> tuple[tuple[Candidate, Projection], Array]:
            result = qp.result(found, residual)
            return (found, result), lower - qp.speeds(result.velocity)

        def again(
            factor: float, last: tuple[Candidate, Projection]
        ) -> tuple[tuple[Candidate, Projection], Array] | None:
            qp.relative_tolerance = factor * asked
            better, left = self._attempt(qp, solver, WarmStart(last[0].u), J)
            return None if better is None or not qp.relative(left) < last[1].residual else taken(better, left)

        first = taken(found, residual)
        (_, result), closing = self.acceptance.refined(contacts if qp.sparse else None, first, again)
        self.acceptance.check(result.residual, asked, contacts, closing, lambda: _problem(qp))
        self._last.keep(result.percussion, keys)
        return result

    def _attempt(
        self, qp: ScaledQP, solver: Solver, start: WarmStart | None, J: Array | csr_array
    ) -> tuple[Candidate | None, float]:
        """Return what a solver finds, to a finer residual in rows of mechanisms, and its residual; inf if nothing."""
        found, stated = solver.solve(qp, start), self.acceptance.stated
        if found is not None and qp.sparse and stated is not None and qp.relative_tolerance > OF_MECHANISMS:
            own = np.flatnonzero(stated.of_mechanisms(J)) if stated.jointed.any() else np.zeros(0, np.int64)
            if own.size:
                found = refine(qp, found, own)
        return found, np.inf if found is None else qp.residual(found)

    def _accepted_residual(self, residual: float, sparse: bool) -> float:
        """Return the residual of a projection; dense rows are solved at least as well as without a depth."""
        if not sparse:
            return min(residual, self.residual)
        self.strictest, self.loosest = min(self.strictest, residual), max(self.loosest, residual)
        return residual

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

    def _failure(
        self, qp: ScaledQP, found: Candidate | None, residual: float, contacts: Array | None
    ) -> ProjectionError:
        problem = _problem(qp)
        worst = (
            None if contacts is None else int(contacts[qp.d.argmax() if found is None else qp.slack(found.z).argmin()])
        )
        if contradictory(qp, found):
            return contradiction(problem)
        solver = "" if self.solver is None else f" by {self.solver!r}"
        relative, stopped = qp.relative(residual), "" if found is None or not found.stopped else f" ({found.stopped})"
        return ProjectionError(
            f"the projection onto {len(qp.lower)} constraints{solver} stopped at the relative KKT residual "
            f"{relative:.1e}, above {qp.relative_tolerance:.1e}{stopped}; the problem is in `.problem`",
            problem,
            float(relative),
            worst,
        )


def _moved(x: Array, part: Array, values: Array) -> Array:
    """Return x with other values of some entries."""
    moved = x.copy()
    moved[part] = values
    return moved


def _problem(qp: ScaledQP) -> dict[str, Array | csr_array | Metric]:
    # the dense M of many bodies could be too large for the memory
    return {"x": qp.x, "M": qp.metric if qp.sparse else qp.metric.dense(), "J": qp.J, "lower": qp.lower}


def checked_solver(solver: ChosenSolver | None) -> ChosenSolver | None:
    """Return the solver if it is one, or None; raise `InputError` otherwise."""
    if solver is not None and not isinstance(solver, SOLVERS):
        names = ", ".join(f"mbvi.{kind.__name__}()" for kind in SOLVERS)
        raise InputError(f"solver must be None or one of {names}; got {shown(solver)}")
    return solver
