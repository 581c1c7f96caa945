"""`gradient`: the derivative of one number that depends on a run, at a cost that hardly grows with the columns."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arguments import array, finite, function, optional, positive, shown
from ..errors import InputError
from ..problem import Problem
from ..results.trajectory import Trajectory
from ..run.interrupted import run_so_far
from ..run.simulate import check_problem
from ..schemes import EventDriven, Scheme
from ..system.system import Array
from .reverse import Reverse
from .sensitivity import followed


@dataclass(frozen=True, eq=False)
class Gradient:
    """The gradient of a number that depends on the states of a run at some times.

    Attributes
    ----------
    run : Trajectory
        The run, the same as that of `simulate`.
    value : float
        The number.
    gradient : ndarray, shape (p,)
        Its derivatives by the columns; the unit of each is that of the number over that of the column.
    columns : dict of str to slice
        The columns of each name of `wrt`, as `Sensitivity` has them.
    """

    run: Trajectory
    value: float
    gradient: Array
    columns: dict[str, slice]


def gradient(
    problem: Problem,
    of: Callable[[Array, Array], tuple[float, Any]],
    scheme: Scheme | EventDriven | None = None,
    *,
    duration: float,
    step: float | None = None,
    wrt: Iterable[str] = ("state",),
    bodies: Iterable[str] | None = None,
    times: Any = None,
) -> Gradient:
    """Run a problem and differentiate one number, by one pass back over the steps and impacts of the run.

    Parameters
    ----------
    problem : Problem
        The problem to run.
    of : callable
        of(q, v) -> (number, row): the number, of the state at the end, and its derivatives by variations of q, which
        are tangent vectors, then of v, shape (2 nv,). With k times q and v have shapes (k, nq) and (k, nv), as
        `run.at(times)` returns them, and the derivatives have (k, 2 nv), a row by the state at each time.
    scheme, duration, step, wrt, bodies
        As `sensitivity`.
    times : array_like, shape (k,), optional
        The times of the states on which the number depends, ascending [s], none at an impact; of fixed steps none
        within the step of an impact. By default the end.

    Returns
    -------
    Gradient
        The run, the number and its derivatives.

    Raises
    ------
    InputError
        As `sensitivity`; or if of returns something else than a finite number and as many more as there are rows, or
        times do not ascend within the run.
    SensitivityError, UnsuitableError, DivergedError, ProjectionError
        As `sensitivity`; also at a time of an impact.

    Notes
    -----
    The result is row @ `sensitivity(...).matrix`, to the tolerance; with times the sum of these at all of them.
    """
    function(of, "of", "of(q, v) -> (number, row)")
    chosen = optional(_times, times, problem, duration)
    run, reverse, varied = followed(problem, scheme, duration, step, wrt, bodies, Reverse)
    state = run.q[-1].copy(), run.v[-1].copy()
    if chosen is not None:
        with run_so_far(lambda: run):
            reverse.check_times(chosen, run)
        # the last time of a run has the rounding of all its steps
        state = run.at(chosen.clip(run.t[0], run.t[-1]))
    found = of(*state)
    if not isinstance(found, tuple) or len(found) != 2:
        raise InputError("of must return a number and its derivatives, (number, row)")
    width = 2 * problem.system.nv
    rows = array(found[1], "the row that of returns", (width,) if chosen is None else (len(chosen), width))
    at = run.t[-1:] if chosen is None else chosen
    slopes = reverse.gradient(at, rows.reshape(-1, width))
    return Gradient(run, finite(found[0], "the number that of returns"), slopes, varied.columns)


def _times(given: Any, problem: Problem, duration: float) -> Array:
    """Return times that ascend within a run."""
    check_problem(problem)
    times, end = array(given, "times", ("k",)), problem.t0 + positive(duration, "duration")
    if (np.diff(times) <= 0.0).any() or not problem.t0 <= times[0] <= times[-1] <= end:
        raise InputError(f"times must ascend within the run, [{problem.t0:g}, {end:g}] s; got {shown(given)}")
    return times
