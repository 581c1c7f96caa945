"""`gradient`: the derivative of one number at the end of a run, at a cost that hardly grows with the columns."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from ..arguments import array, finite, function
from ..errors import InputError
from ..problem import Problem
from ..results.trajectory import Trajectory
from ..schemes import EventDriven, Scheme
from ..system.system import Array
from .reverse import Reverse
from .sensitivity import followed


@dataclass(frozen=True, eq=False)
class Gradient:
    """The gradient of a number at the end of a run.

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
) -> Gradient:
    """Run a problem and differentiate one number at the end of the run, by one pass back over its steps and impacts.

    Parameters
    ----------
    problem : Problem
        The problem to run.
    of : callable
        of(q, v) -> (number, row): the number at the end, and its derivatives by variations of q, which are tangent
        vectors, then of v, shape (2 nv,).
    scheme, duration, step, wrt, bodies
        As `sensitivity`.

    Returns
    -------
    Gradient
        The run, the number and its derivatives.

    Raises
    ------
    InputError
        As `sensitivity`; or if of returns something else than a finite number and as many more as there are rows.
    SensitivityError, UnsuitableError, DivergedError, ProjectionError
        As `sensitivity`.

    Notes
    -----
    The result is row @ `sensitivity(...).matrix`, to the tolerance.
    """
    function(of, "of", "of(q, v) -> (number, row)")
    run, reverse, varied = followed(problem, scheme, duration, step, wrt, bodies, Reverse)
    found = of(run.q[-1].copy(), run.v[-1].copy())
    if not isinstance(found, tuple) or len(found) != 2:
        raise InputError("of must return a number and its derivatives, (number, row)")
    row = array(found[1], "the row that of returns", (2 * problem.system.nv,))
    return Gradient(run, finite(found[0], "the number that of returns"), reverse.gradient(row), varied.columns)
