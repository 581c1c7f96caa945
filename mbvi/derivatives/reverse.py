"""The gradient of a function of the states at some times of a run, by one pass back over its steps and impacts."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from ..problem import Problem
from ..results.trajectory import Trajectory
from ..schemes.event_driven.runge_kutta import RungeKuttaStep
from ..system.system import Array
from .directions import Directions
from .motion.friction import ChosenModes
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

    Attributes
    ----------
    impacts : list of (float, float, ndarray of int)
        The time of each impact, within what time of it the state may be that before or after [s], and its rows.

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
        # matrices of events, shape (2 nv, 2 nv + p), and steps with the rows that are closed in them, their modes and
        # kinks
        self._tape: list[Array | tuple[RungeKuttaStep, Array, ChosenModes | None, list[float]]] = []
        self.impacts: list[tuple[float, float, Array]] = []

    def _begin_step(self, t: float, q: Array, v: Array, integrator: Followed) -> None:
        self._X = self._basis
        if self._pending is not None:
            event, rows = self._pending
            speed = float(np.abs(event.rates[1] * self._linear.rows.lever[rows]).max())
            self.impacts.append((event.t, self._touching / speed, rows))
        super()._begin_step(t, q, v, integrator)
        if self._X is not self._basis:
            self._tape.append(self._X)

    def _smooth(self, step: RungeKuttaStep) -> None:
        self._tape.append((step, self._closed, self._modes, self.kinks(step)))

    def check_times(self, times: Array, run: Trajectory) -> None:
        """Refuse times at impacts; of fixed steps, times within the steps of impacts."""
        for t, near, rows in self.impacts:
            first, last = t - near, t + near
            if self.approximate:
                k = int(np.searchsorted(run.t, t))
                first, last = run.t[[k - 1, k]].tolist()
            if ((times > first) & (times < last)).any():
                self._refuse("one of the times is that of an impact, where the velocity jumps", rows, t)

    def gradient(self, times: Array, rows: Array) -> Array:
        """Return the gradient, shape (p,), of a number.

        Parameters
        ----------
        times : ndarray, shape (k,)
            The times of the states on which it depends, ascending [s].
        rows : ndarray, shape (k, 2 nv)
            Its derivatives by these states.
        """
        units, n = self._linear.units, rows.shape[1]
        # derivatives of the number by the state, in units of the scene, and by what else the columns vary
        y = np.zeros(n + len(self._given.sizes))
        left = list(zip(times.tolist(), rows, strict=True))
        first = next(part for part in self._tape if not isinstance(part, np.ndarray))
        for part in reversed(self._tape):
            if isinstance(part, np.ndarray):
                back = part.T @ (y[:n] / units)
                y = np.concatenate([units * back[:n], y[n:] + back[n:]])
                continue
            (step, closed, modes, kinks), marks = part, list[tuple[float, Array]]()
            self._linear.choose(modes)
            while left and (left[-1][0] > step.t or part is first):
                t, row = left.pop()
                # how far back from the end of the step
                marks.append((1.0 - min(max((t - step.t) / step.h, 0.0), 1.0), row))
            y = self._back(y, step, closed, kinks, marks)
        return np.asarray(self._given.start.T @ (y[:n] / units) + y[n:]) / self._given.sizes

    def _back(
        self, y: Array, step: RungeKuttaStep, closed: Array, kinks: list[float], marks: list[tuple[float, Array]]
    ) -> Array:
        """Return the derivatives at the start of a step, with rows that are added at shares of the way back."""
        n, units, by_p = len(self._linear.units), self._linear.units, self._given.by_p

        def matrices(shares: Array) -> Array:
            A = self.rates(step, 1.0 - shares, closed) / units[:, None]
            return np.concatenate([A[..., :n] * units, A[..., n:] @ by_p], axis=-1).swapaxes(1, 2)

        def applied(matrices: Array, y: Array) -> Array:
            return matrices @ y[..., :n, :]

        ends = sorted({0.0, 1.0, *(1.0 - share for share in kinks), *(share for share, _ in marks)})
        for before, here in pairwise([0.0, *ends]):
            if here > before:
                y = self.integrated(step, [before, here], matrices, applied, y[:, None], 0.0)[:, 0]
            for share, row in marks:
                if share == here:
                    y = np.concatenate([y[:n] + units * row, y[n:]])
        return y
