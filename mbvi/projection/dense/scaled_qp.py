"""The projection as a scaled QP: rows of unit length in the metric, and the residual that judges every answer.

With M = L L', A = L^-1 J' scaled to unit columns and z = L'(w - x), min |w - x|_M subject to J w >= lower becomes
min |z|^2 subject to A' z >= d. Its solution is z = A u with u >= 0, where u solves the dual, min u' G u / 2 - d' u over
u >= 0 with G = A' A.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np
from scipy.sparse import csr_array

from ..metric import Array, Metric, like
from ..row_speeds import combine_rows, times
from ..sparse.sparse_whitening import row_lengths

# a violation below this share of the sum of its terms, |J| |x| + |lower|, is rounding
ROUNDING = 1e-13
# residuals do not count the speed of a row that is open by so many times the largest of violated rows: where its
# gradient is little more than rounding, that speed exceeds all others by 1e15
FAR = 1e3


class Projection(NamedTuple):
    """The nearest velocity, the percussions that lead to it, and the residual of both.

    Attributes
    ----------
    velocity : ndarray, shape (nv,)
        w = argmin |w - x|_M with J w >= lower.
    percussion : ndarray, shape (m,)
        p >= 0 with M (w - x) = J' p [N s, N m s] (Lemma 3.3 with the sign turned). A percussion is an impulse at a
        contact.
    residual : float
        KKT residual: max |min(p, J w - lower)| with rows scaled to unit gradients in the metric, relative to the
        largest |J x| + |lower| of a scaled row, without rows that are open by a thousand times that of violated rows.
        If w was not computed from p, the error of that relation counts, too.
    """

    velocity: Array
    percussion: Array
    residual: float


class Candidate(NamedTuple):
    """The answer of a solver.

    Attributes
    ----------
    z : ndarray, shape (nv,)
        A u. Some solvers compute it by other means, because the product loses digits if u is large.
    u : ndarray, shape (m,)
        Percussions.
    stationary : bool
        Whether z was computed as A u.
    stopped : str
        The bound of the solver's work that ended it, in words; empty where none did.
    """

    z: Array
    u: Array
    stationary: bool = False
    stopped: str = ""


class WarmStart(NamedTuple):
    """Scaled percussions of the last projection.

    Attributes
    ----------
    u : ndarray, shape (m,)
        Zero for rows that the last projection did not have.
    """

    u: Array


class Solver(Protocol):
    """Finds the percussions of a scaled QP."""

    def solve(self, qp: ScaledQP, start: WarmStart | None) -> Candidate | None:
        """Return percussions u >= 0 and z = A u, or None if there is no answer; the residual is checked elsewhere.

        Parameters
        ----------
        qp : ScaledQP
            The problem; at least one row is violated, and no gradient is zero.
        start : WarmStart, optional
            Percussions of the last projection, if rows match.
        """
        ...


class ScaledQP:
    """min |w - x|_M subject to J w >= lower, scaled.

    Parameters
    ----------
    x : ndarray, shape (nv,)
        Velocity to project.
    metric : Metric
        M.
    J : ndarray or csr_array, shape (m, nv)
        Gradients.
    lower : ndarray, shape (m,)
        Least rates.
    residual : float
        The largest relative KKT residual that is accepted.
    """

    def __init__(self, x: Array, metric: Metric, J: Array | csr_array, lower: Array, residual: float) -> None:
        self.x, self.metric, self.lower = x, metric, lower
        self.sparse = not isinstance(J, np.ndarray)
        # an array or, if sparse, a csr_array
        self.J: Any = J
        self._speed = self.speeds(x)
        self.relative_tolerance = residual
        # kept, because solvers that check their answer compute the same slack as `residual`
        self._last_slack: tuple[Array, Array] | None = None

    def speeds(self, v: Array) -> Array:
        """Return J v, shape (m,)."""
        return times(self.J, v) if self.sparse else self.J @ v

    @property
    def satisfied(self) -> bool:
        """Whether x violates no row by more than the rounding of J x."""
        violation = self.lower - self._speed
        if not (violation > 0.0).any():
            return True
        if not self.sparse:
            terms = np.abs(self.J) @ np.abs(self.x) + np.abs(self.lower)
            return bool((violation <= ROUNDING * terms).all())
        J = self.J
        # no row has larger terms; where the violation exceeds their rounding, the terms need not be added up
        most = len(self.x) * np.abs(J.data).max(initial=0.0) * np.abs(self.x).max(initial=0.0)
        if violation.max() > ROUNDING * (most + np.abs(self.lower).max()):
            return False
        sums = np.concatenate([[0.0], np.cumsum(np.abs(J.data * self.x[J.indices]))])
        terms = sums[J.indptr[1:]] - sums[J.indptr[:-1]] + np.abs(self.lower)
        return bool(violation.max() <= ROUNDING * terms.max())

    @cached_property
    def _whitened(self) -> Any:
        """L^-1 J': shape (nv, m) if dense, its transpose if sparse."""
        return self.metric.whiten_rows(self.J) if self.sparse else self.metric.whiten(self.J.T)

    @cached_property
    def lengths(self) -> Array:
        """Length of each gradient in the metric, shape (m,)."""
        if self.sparse:
            lengths = np.empty(len(self.lower))
            row_lengths(self._whitened.indptr.astype(np.int64), self._whitened.data, lengths)
            return lengths
        return np.sqrt(np.einsum("ij,ij->j", self._whitened, self._whitened))

    @cached_property
    def _scaled(self) -> tuple[Array, float]:
        violation = (self.lower - self._speed) / self.lengths
        scale = float(np.ldexp(1.0, np.frexp(violation.max())[1]))
        return violation / scale, scale

    @property
    def d(self) -> Array:
        """Violations of the scaled rows by x, shape (m,); the largest lies in [0.5, 1)."""
        return self._scaled[0]

    @property
    def scale(self) -> float:
        """The power of two that d was divided by, so that the scaling rounds nothing."""
        return self._scaled[1]

    @cached_property
    def largest(self) -> float:
        """The largest scaled speed, which residuals are relative to."""
        speeds = (np.abs(self._speed) + np.abs(self.lower)) / self.lengths / self.scale
        violated = speeds[self.d > 0.0]
        # an island of a larger problem may hold no violated row
        return float(speeds[-self.d <= FAR * violated.max()].max() if violated.size else speeds.max())

    @property
    def tolerance(self) -> float:
        """The largest residual of the scaled problem that is accepted."""
        return self.relative_tolerance * self.largest

    @cached_property
    def columns(self) -> Array:
        """A, dense, shape (nv, m)."""
        return np.ascontiguousarray(self.rows.toarray().T) if self.sparse else self._whitened / self.lengths

    @cached_property
    def rows(self) -> csr_array:
        """A', sparse, shape (m, nv)."""
        if not self.sparse:
            return csr_array(self.columns.T)
        W = self._whitened
        return like(W, W.data / np.repeat(self.lengths, np.diff(W.indptr)))

    @cached_property
    def parts(self) -> tuple[Array, Array, Array]:
        """The entries of sparse rows A', their columns, and where each row begins."""
        return self.rows.data, self.rows.indices.astype(np.uint32), self.rows.indptr.astype(np.uint32)

    @cached_property
    def G(self) -> Array:
        """A' A, dense, shape (m, m)."""
        return np.ascontiguousarray(self.columns.T @ self.columns)

    def combine(self, u: Array) -> Array:
        """Return A u."""
        if not self.sparse:
            return self.columns @ u
        z = np.empty(len(self.x))
        combine_rows(*self.parts, u, z)
        return z

    def slack(self, z: Array) -> Array:
        """Return A' z - d."""
        if self._last_slack is None or self._last_slack[0] is not z:
            self._last_slack = z, (times(self.rows, z) if self.sparse else self.columns.T @ z) - self.d
        return self._last_slack[1]

    def residual(self, candidate: Candidate) -> float:
        """Return the KKT residual: the larger of max |min(u, A' z - d)| and max |z - A u| / (1 + max u).

        Zero exactly at a solution.
        """
        z, u, stationary, _ = candidate
        natural = np.abs(np.minimum(u, self.slack(z))).max()
        if stationary:
            return float(natural)
        stationarity = np.abs(z - self.combine(u)).max() / (1.0 + u.max())
        return float(max(natural, stationarity))

    def result(self, candidate: Candidate, residual: float) -> Projection:
        """Return the candidate as velocity and percussions, with its relative residual."""
        velocity = self.x + self.scale * self.metric.unwhiten(candidate.z)
        return Projection(velocity, self.scale * candidate.u / self.lengths, self.relative(residual))

    def relative(self, residual: float) -> float:
        """Return a residual of the scaled problem relative to its largest speed."""
        return residual / self.largest
