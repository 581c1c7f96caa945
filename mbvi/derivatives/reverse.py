"""The gradient of a number at the end of a run, by one pass back over its steps and impacts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..problem import Problem
from ..schemes.event_driven.runge_kutta import RungeKuttaStep
from ..system.system import Array
from .directions import Directions
from .variation import Followed, Variation


class Reverse(Variation):
    """Records the smooth steps of a run, and the matrix of each impact, for a pass back.

    Parameters
    ----------
    problem : Problem
        The problem that runs.
    tolerance : float
        That of the scheme.
    varied : Directions
        The p columns of the gradient.

    Notes
    -----
    At an impact all 2 nv variations of the state are carried once, and p more that vary what the columns do besides. In
    between only steps are kept; back over them dy/dt = -A' y, and the columns add up B' y.
    """

    def __init__(self, problem: Problem, tolerance: float, varied: Directions) -> None:
        n, width = 2 * problem.system.nv, varied.start.shape[1]
        self._basis = np.hstack([np.eye(n), np.zeros((n, width))])
        by_e, by_p, by_gap = (np.pad(one, ((0, 0), (n, 0))) for one in (varied.by_e, varied.by_p, varied.by_gap))
        sizes = np.concatenate([np.ones(n), varied.sizes])
        every = replace(varied, start=self._basis, by_e=by_e, by_p=by_p, by_gap=by_gap, sizes=sizes)
        super().__init__(problem, tolerance, every)
        self._given = varied
        self._varies_start = bool(varied.start.any() or varied.by_gap.any())
        # matrices of impacts, shape (2 nv, 2 nv + p), and steps with the rows that are closed in them, and their kinks
        self._tape: list[Array | tuple[RungeKuttaStep, Array, list[float]]] = []

    def _begin_step(self, t: float, q: Array, v: Array, integrator: Followed) -> None:
        self._X = self._basis
        super()._begin_step(t, q, v, integrator)
        if self._X is not self._basis:
            self._tape.append(self._X)

    def _smooth(self, step: RungeKuttaStep) -> None:
        self._tape.append((step, self._closed, self.kinks(step)))

    def gradient(self, row: Array) -> Array:
        """Return the gradient, shape (p,), of a number whose derivative by the state at the end is given, (2 nv,)."""
        units, n = self._linear.units, len(row)
        # derivatives of the number by the state, in units of the scene, and by what else the columns vary
        y = np.concatenate([units * row, np.zeros(len(self._given.sizes))])
        for part in reversed(self._tape):
            if isinstance(part, np.ndarray):
                back = part.T @ (y[:n] / units)
                y = np.concatenate([units * back[:n], y[n:] + back[n:]])
            else:
                y = self._back(y, *part)
        return np.asarray(self._given.start.T @ (y[:n] / units) + y[n:]) / self._given.sizes

    def _back(self, y: Array, step: RungeKuttaStep, closed: Array, kinks: list[float]) -> Array:
        """Return the derivatives at the start of a step."""
        n, units, by_p = len(self._linear.units), self._linear.units, self._given.by_p

        def matrices(shares: Array) -> Array:
            A = self.rates(step, 1.0 - shares, closed)
            return np.concatenate([A[..., :n] * units, A[..., n:] @ by_p], axis=-1).swapaxes(1, 2)

        def applied(matrices: Array, y: Array) -> Array:
            return matrices @ (y[..., :n, :] / units[:, None])

        ends = [0.0, *(1.0 - share for share in reversed(kinks)), 1.0]
        return self.integrated(step, ends, matrices, applied, y[:, None], 0.0)[:, 0]
