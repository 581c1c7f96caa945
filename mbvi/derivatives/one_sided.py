"""The derivatives of a run on several sides: one for each order of single impacts that variations bring about."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, cast

import numpy as np

from ..arguments import array
from ..errors import InputError, SensitivityError
from ..problem import Problem
from ..results.trajectory import Trajectory
from ..run.interrupted import run_so_far
from ..system.system import Array
from .directions import Directions
from .orders import Branching

Part = tuple[Trajectory, Branching, Directions]
Follow = Callable[[Problem, float, Callable[[Problem, float, Directions], Branching]], Part]

# most branches of a run
_MOST_BRANCHES = 64


@dataclass(frozen=True, eq=False)
class SensitivityBranch:
    """The derivative of a run along the variations that bring about one order of single impacts.

    Attributes
    ----------
    order : tuple of tuple of str
        The constraints of each single impact where several close at once, one impact after the other.
    times : ndarray, shape (k,)
        When each of them happens [s].
    conditions : ndarray, shape (c, p)
        Combinations x of the columns bring about this order if all of conditions @ x are positive: a constraint closes
        before another one, by as many seconds.
    run : Trajectory
        The run from the last of these times on, after the impacts in this order; from the start where there are none.
    matrix : ndarray, shape (2 nv, p)
        The derivative of the state at the end, with rows and columns as of `Sensitivity`.
    """

    order: tuple[tuple[str, ...], ...]
    times: Array
    conditions: Array
    run: Trajectory
    matrix: Array


@dataclass(frozen=True, eq=False)
class OneSidedSensitivity:
    """The derivatives of a run on several sides, in branches.

    Attributes
    ----------
    branches : tuple of SensitivityBranch
        The orders of single impacts; one without any where the run has a derivative.
    columns : dict of str to slice
        The columns of each name of `wrt`, as `Sensitivity` has them.
    """

    branches: tuple[SensitivityBranch, ...]
    columns: dict[str, slice]

    def branch(self, x: Array) -> SensitivityBranch:
        """Return the branch of a variation.

        Parameters
        ----------
        x : array_like, shape (p,)
            A combination of the columns.

        Returns
        -------
        SensitivityBranch
            The one whose conditions hold; the state at the end changes by `matrix @ x`.

        Raises
        ------
        InputError
            If x has another shape, or keeps impacts simultaneous, which is between the branches.
        """
        x = array(x, "x", (self.branches[0].matrix.shape[1],))
        for one in self.branches:
            if (one.conditions @ x > 0.0).all():
                return one
        raise InputError("x keeps constraints closing at once: it is between the branches")


@dataclass(frozen=True)
class _Part:
    """A part of a run, from the start or from an impact on.

    Attributes
    ----------
    problem : Problem
        That starts with it.
    duration : float
        To the end of the run [s].
    X : ndarray, shape (2 nv, p), or None
        The variations of its start; None at that of the run.
    conditions, order, times
        As of `SensitivityBranch`.
    """

    problem: Problem
    duration: float
    X: Array | None
    conditions: Array | None
    order: tuple[tuple[str, ...], ...]
    times: tuple[float, ...]


def branches(follow: Follow, problem: Problem, duration: float) -> OneSidedSensitivity:
    """Return the derivatives of a run in branches.

    Parameters
    ----------
    follow : callable
        follow(problem, duration, kind) returns a run, what followed its variations, and the columns.
    problem, duration
        As of `sensitivity`.
    """
    pending, found = [_Part(problem, duration, None, None, (), ())], list[SensitivityBranch]()
    columns: dict[str, slice] = {}
    while pending:
        part = pending.pop(0)
        ended = _ended(follow, part)
        if isinstance(ended, _Fork):
            with run_so_far(ended.run):
                pending += _branched(part, ended.variation, _MOST_BRANCHES - len(pending) - len(found))
        else:
            branch, columns = ended
            found.append(branch)
    return OneSidedSensitivity(tuple(found), columns)


class _Fork(NamedTuple):
    """An impact with derivatives on some sides only: what followed the variations to it, and the refusal."""

    variation: Branching
    error: Any

    def run(self) -> Trajectory:
        """Return the run up to there."""
        return cast("Trajectory", self.error.run)


def _ended(follow: Follow, part: _Part) -> _Fork | tuple[SensitivityBranch, dict[str, slice]]:
    """Return the branch that a part of a run ends, with the columns; or the impact at which it forks."""
    made: list[Branching] = []

    def kind(problem: Problem, tolerance: float, varied: Directions) -> Branching:
        varied = varied if part.X is None else replace(varied, start=part.X)
        conditions = np.zeros((0, varied.start.shape[1])) if part.conditions is None else part.conditions
        made.append(Branching(problem, tolerance, varied, conditions))
        return made[0]

    try:
        run, variation, varied = follow(part.problem, part.duration, kind)
    except SensitivityError as error:
        if not made or made[0].fork is None:
            raise
        return _Fork(made[0], error)
    conditions, matrix = (one / varied.sizes for one in (variation.conditions, variation.matrices[-1]))
    return SensitivityBranch(part.order, np.array(part.times), conditions, run, matrix), varied.columns


def _branched(part: _Part, variation: Branching, most: int) -> list[_Part]:
    """Return the parts of a run after an impact, one for each order; refuse more than some."""
    fork, parts = variation.fork, list[_Part]()
    assert fork is not None
    rest = part.problem.t0 + part.duration - fork.t
    for order in variation.orders():
        if len(parts) == most:
            reason = f"several close at once, and there are more than {_MOST_BRANCHES} orders of impacts in the run"
            raise SensitivityError(reason, fork.t, variation.names(fork.rows))
        names = tuple(variation.names(group) for group in order.impacts)
        start, times = part.problem.at(fork.q, order.v, fork.t), (*part.times, *[fork.t] * len(names))
        parts.append(_Part(start, rest, order.X, order.conditions, part.order + names, times))
    return parts
