"""The final state of a run as a function of its start and of parameters, and the way back, in numpy."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from ..arguments import function, optional, positive, several_names
from ..derivatives import gradient
from ..derivatives.directions import directions
from ..derivatives.motion.differences import STEP, along
from ..derivatives.sensitivity import TOLERANCE
from ..errors import InputError
from ..problem import Problem
from ..results.loop_forces import without_equalities
from ..run.given_scheme import checked_scheme
from ..run.simulate import simulate
from ..schemes import EventDriven, Scheme
from ..system import System
from ..system.system import Array


class FinalState:
    """The state at the end of a run, by that at its start and by parameters.

    Parameters
    ----------
    problem, scheme, duration, step, wrt
        As `jax_rollout`.

    Raises
    ------
    InputError
        On wrong types and numbers.
    """

    def __init__(
        self,
        problem: Problem | Callable[[Any], Problem],
        scheme: Scheme | EventDriven | None,
        duration: float,
        step: float | None,
        wrt: Iterable[str],
    ) -> None:
        self._names = several_names(wrt, "wrt")
        if self._names and isinstance(problem, Problem):
            raise InputError("with wrt give problem as a function of the parameters that returns a Problem")
        if not self._names and not isinstance(problem, Problem):
            raise InputError("problem must be a Problem, or with wrt a function of the parameters that returns one")
        self._make = (lambda p: problem) if isinstance(problem, Problem) else function(problem, "problem", "problem(p)")
        # what is no scheme of a derivative is refused by `gradient`
        self._scheme: Any = EventDriven(TOLERANCE) if scheme is None else checked_scheme(scheme)
        self._duration, self._step = positive(duration, "duration"), optional(positive, step, "step")

    def run(self, q: Array, v: Array, p: Array) -> tuple[Array, Array]:
        """Return q and v at the end."""
        problem = self._at(q, v, p)
        run = simulate(problem, self._scheme, duration=self._duration, step=self._step, progress=False)
        return run.q[-1].copy(), run.v[-1].copy()

    def back(self, q: Array, v: Array, p: Array, by_q: Array, by_v: Array) -> tuple[Array, Array, Array]:
        """Return the derivatives of a number by q, v and p at the start, from those by q and v at the end."""
        problem = self._at(q, v, p)
        # variations keep loops; a retraction that closes them would make the columns of the tangent space dependent
        system, n = without_equalities(problem.system), problem.system.nv

        def number(q: Array, v: Array) -> tuple[float, Array]:
            return 0.0, np.concatenate([_tangent(system, q).T @ by_q, by_v])

        wrt = ["state", *self._names]
        row = gradient(problem, number, self._scheme, duration=self._duration, step=self._step, wrt=wrt).gradient
        D = _tangent(system, problem.q0)
        return D @ np.linalg.solve(D.T @ D, row[:n]), row[n : 2 * n], row[2 * n :].reshape(p.shape)

    def _at(self, q: Array, v: Array, p: Array) -> Problem:
        problem = self._make(p)
        if not isinstance(problem, Problem):
            raise InputError(f"the function given as problem must return a Problem, and returned a {type(problem)}")
        count = len(directions(problem, self._names, None).sizes) if self._names else 0
        if p.size != count:
            raise InputError(f"wrt has {count} numbers, {', '.join(self._names) or 'none'}, and {p.size} are given")
        return problem.at(q, v, problem.t0, check=True)


def _tangent(system: System, q: Array) -> Array:
    """Return the derivative of the numbers in q along the tangent space, shape (nq, nv); columns are independent."""
    return along(lambda dq: system.integrate(q, dq), np.full(system.nv, STEP))
