"""The projection min |w - x|_M subject to J w >= c, one after the other.

With M = L L', A = L^-1 J' scaled to unit columns and z = L'(w - x), this is the point of least norm of a
polyhedron: min |z|^2 subject to A' z >= d. A guess at the active set is tried first, then ProxQP finds it; either
way the result is solved anew on that set and judged by its own residual, so its accuracy is that of the linear
algebra and not of a stopping test.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from ..compiled import plain_array
from ..errors import InfeasibleError, ProjectionError
from .active_set import Candidate, dual_active_set, kkt_residual, press_what_is_missing, solve_on
from .metric import Array, Metric
from .nonnegative import ROUNDING
from .nonnegative import shared as nonnegative_shared
from .proxqp import ProxQP
from .robot_step import law as robot_step_law
from .robot_step import press, tree_law
from .sparse_projector import Large, contradictory
from .tree import TreeFreeMotion

# up to so many rows the compiled projection comes first and all are taken to rounding, beyond to a thousandth of the
# residual that is asked
_FEW, _POSITIVE = 32, 1e-7
# rows up to which those that press are exchanged one by one before ProxQP is asked
_EXCHANGED = 64


class Projection(NamedTuple):
    """The nearest velocity, the percussions that lead to it, and how well both fit.

    Attributes
    ----------
    velocity : ndarray, shape (nv,)
        w = argmin |w - x|_M with J w >= lower.
    percussion : ndarray, shape (m,)
        p >= 0 with M (w - x) = J' p [N s, N m s] (Lemma 3.3 with the sign turned).
    residual : float
        max |min(p, J w - lower)| over the rows scaled to a unit gradient in the metric, relative to the largest of
        the speeds J x and lower so scaled.
    """

    velocity: Array
    percussion: Array
    residual: float


class FreeMotion(NamedTuple):
    """What forces do within a step: v + h M^-1 g, shape (nv,), and M."""

    free: Array
    metric: Metric

    def of(self, v: Array, at: Array) -> FreeMotion:
        """Return what the same forces do to the velocity v, if these are those at the velocity `at`."""
        return FreeMotion(self.free + (v - at), self.metric)


class Projector:
    """Projections in a row: the QP solvers are kept, one per number of rows, and started from their last result.

    Making one loads the kernels, so that every projection of a process is compiled.

    Parameters
    ----------
    residual : float
        The relative KKT residual above which a projection raises.
    """

    def __init__(self, residual: float = 1e-6) -> None:
        self.residual = residual
        self._solver = ProxQP()
        self._large: Large | None = None
        self._contradiction = False
        # percussions of the last projection
        self._last = np.zeros(0)

    def project(
        self, x: Array, metric: Metric, J: Array | csr_array, lower: Array, contacts: Array | None = None
    ) -> Projection:
        """Project x; see `project`, whose checks this leaves out; `contacts`, shape (m,), name sparse rows."""
        if not isinstance(J, np.ndarray):
            return self._many(x, metric, J, lower, contacts)
        x, J, lower = plain_array(x), plain_array(J), plain_array(lower)
        if 0 < len(lower) <= _FEW:
            velocity, rates = np.empty(len(x)), np.empty((3, len(lower)))
            A = plain_array(metric.solve_rows(J))
            residual = press(J, A, x, lower, self._last, velocity, rates)
            if residual < np.inf:
                self._last = rates[0]
                return Projection(velocity, rates[0], residual)
        return self._many(x, metric, J, lower)

    def law(
        self, v: Array, push: FreeMotion | TreeFreeMotion, J: Array | csr_array, e: Array, contacts: Array | None = None
    ) -> tuple[Array, Array, float]:
        """Return argmin |w - x|_M with J w >= -e J v, the rates of the rows, and the relative KKT residual.

        Parameters
        ----------
        v : ndarray, shape (nv,)
            Velocity before.
        push : FreeMotion
            The velocity x as the forces alone would leave it, and M.
        J : ndarray, shape (m, nv)
            Gradients of the active constraints.
        e : ndarray, shape (m,)
            Restitution of each.
        contacts : ndarray of int, shape (m,), optional
            What names sparse rows from one projection to the next, so that they start from their last percussions.

        Returns
        -------
        velocity : ndarray, shape (nv,)
            Velocity after.
        rates : ndarray, shape (4, m)
            Percussion, J x, J w and J v of each row.
        residual : float
            As of a `Projection`.
        """
        m = len(e)
        rates = np.empty((4, m))
        if m <= _FEW and isinstance(J, np.ndarray):
            velocity = np.empty(len(v))
            if type(push) is TreeFreeMotion:
                residual = tree_law(*push.told, J, e, self._last, velocity, rates)
            else:
                A = plain_array(push.metric.solve_rows(J))
                residual = robot_step_law(J, A, plain_array(v), e, plain_array(push.free), self._last, velocity, rates)
            if residual < np.inf:
                self._last = rates[0]
                return velocity, rates, residual
        x = push.free
        rates[3] = J.dot(v)
        velocity, rates[0], residual = self._many(x, push.metric, J, -e * rates[3], contacts)
        rates[1], rates[2] = J.dot(x), J.dot(velocity)
        return velocity, rates, residual

    def _sparse(self, x: Array, metric: Metric, J: csr_array, lower: Array, contacts: Array | None) -> Projection:
        """Project onto rows of many bodies."""
        sums = np.concatenate([[0.0], np.cumsum(np.abs(J.data * x[J.indices]))])
        speeds = sums[J.indptr[1:]] - sums[J.indptr[:-1]] + np.abs(lower)
        if (lower - J.dot(x)).max(initial=0.0) <= ROUNDING * speeds.max(initial=0.0):
            # what is missing, if anything, is the rounding of J x
            return Projection(x, np.zeros(len(lower)), 0.0)
        if self._large is None:
            self._large = Large(Projector(0.1 * self.residual).project)
        found = Projection(*self._large.project(x, metric, J, lower, self.residual, contacts))
        # written so that a NaN is refused too
        if not found.residual <= self.residual:
            self._contradiction = contradictory(metric, J, lower, found.percussion)
            raise self._failure(x, metric, J, lower, found.residual)
        return found

    def _many(
        self, x: Array, metric: Metric, J: Array | csr_array, lower: Array, contacts: Array | None = None
    ) -> Projection:
        """Project onto many rows, or onto few that are not settled yet."""
        if not isinstance(J, np.ndarray):
            return self._sparse(x, metric, J, lower, contacts)
        speed = J @ x
        missing = lower - speed
        if (missing <= 0.0).all():
            return Projection(x, np.zeros(len(missing)), 0.0)
        columns = metric.whiten(J.T)
        G = columns.T @ columns
        lengths = np.sqrt(G.diagonal())
        if not (lengths > 0.0).all():
            return self._without_zero_rows(x, metric, J, lower, lengths > 0.0)
        largest = float(((np.abs(speed) + np.abs(lower)) / lengths).max())
        guess = press_what_is_missing(G, missing, lengths)
        if guess is not None:
            velocity = x + metric.unwhiten(columns @ guess)
            slack = J @ velocity - lower
            residual = float(np.abs(np.minimum(guess * lengths, slack / lengths)).max()) / largest
            if residual <= ROUNDING:
                return Projection(velocity, guess, residual)
        return self._general(x, metric, J, lower, columns, lengths, largest)

    def _general(
        self, x: Array, metric: Metric, J: Array, lower: Array, columns: Array, lengths: Array, largest: float
    ) -> Projection:
        """Project where the first guess at the pressing rows is wrong, or the rows depend on each other."""
        missing = lower - J @ x
        if (missing <= ROUNDING * (np.abs(J) @ np.abs(x) + np.abs(lower))).all():
            # what is missing is the rounding of J x
            return Projection(x, np.zeros(len(missing)), 0.0)
        missing /= lengths
        scale = missing.max()
        last = self._last * lengths / scale if len(self._last) == len(missing) else None
        (z, p), residual = self._solve(columns / lengths, missing / scale, last)
        residual *= scale / max(largest, scale)
        # written so that a NaN is refused too
        if not residual <= self.residual:
            raise self._failure(x, metric, J, lower, residual)
        self._last = scale * p / lengths
        return Projection(x + scale * metric.unwhiten(z), self._last, residual)

    def _solve(self, A: Array, d: Array, last: Array | None) -> tuple[Candidate, float]:
        """Return the best candidate for min |z|^2, A' z >= d and its residual; `last` are multipliers to start from."""
        best, smallest = Candidate(np.zeros(len(A)), np.zeros(len(d))), np.inf
        self._contradiction = False
        for candidate in self._candidates(A, d, last):
            if candidate is None:
                continue
            residual = kkt_residual(A, d, candidate)
            if residual < smallest:
                best, smallest = candidate, residual
            # a huge z may be a wrong one, so that it does not excuse any residual
            rounding = ROUNDING * min(1.0 + np.abs(candidate.z).max(), 1e3)
            if residual <= (rounding if len(d) <= _FEW else 1e-3 * self.residual):
                break
        return best, smallest

    def _candidates(self, A: Array, d: Array, last: Array | None) -> Iterator[Candidate | None]:
        """Yield the cheapest first: the last active set or a guess at it, ProxQP's, ProxQP itself, an exact method."""
        G = A.T @ A
        if len(d) <= _FEW:
            yield solve_on(A, G, d, d > 0.0) if last is None else solve_on(A, G, d, last > 0.0, last)
        if len(d) <= _EXCHANGED:
            shared = nonnegative_shared(np.ascontiguousarray(G), np.ascontiguousarray(d))
            yield None if shared is None else Candidate(A @ shared, shared)
        # what it stops at depends on where its memory begins
        p = np.maximum(self._solver.solve(G, d), 0.0)
        yield solve_on(A, G, d, p > _POSITIVE * p.max(), p)
        yield Candidate(A @ p, p)
        exact = dual_active_set(A, d, ROUNDING)
        self._contradiction = exact is None
        yield exact

    def _without_zero_rows(self, x: Array, metric: Metric, J: Array, lower: Array, kept: Array) -> Projection:
        """Project with the rows whose gradient vanishes left out: they ask 0 >= lower."""
        if (lower[~kept] > 0.0).any():
            raise InfeasibleError(
                "a constraint whose gradient vanishes asks for a positive rate: no velocity gives it",
                {"x": x, "M": metric.dense(), "J": J, "lower": lower},
            )
        part = self.project(x, metric, J[kept], lower[kept])
        percussion = np.zeros(len(lower))
        percussion[kept] = part.percussion
        return Projection(part.velocity, percussion, part.residual)

    def _failure(self, x: Array, metric: Metric, J: Array, lower: Array, residual: float) -> ProjectionError:
        # of many bodies M would be too large to write out
        problem = {"x": x, "M": metric.dense() if isinstance(J, np.ndarray) else metric, "J": J, "lower": lower}
        if self._contradiction:
            return InfeasibleError("no velocity w meets J w >= lower: two or more rows contradict each other", problem)
        return ProjectionError(
            f"the projection onto {len(lower)} constraints stopped at the relative KKT residual {residual:.1e}, "
            f"above {self.residual:.1e}; the problem is in `.problem`",
            problem,
            float(residual),
        )
