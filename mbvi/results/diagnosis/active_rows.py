"""The active rows at the states of a run, with full gradients."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ...errors import InputError
from ...schemes import Adaptive
from ...schemes.adaptive.measure import Measure
from ...system.free.sparse_rows import dense

if TYPE_CHECKING:
    from ...constraints import Rows
    from ...problem import Problem
    from ..run_data import RunData
    from .diagnosis import Array

# most numbers of all gradients and angles at one instant
_MOST_ENTRIES = 30_000_000


class ActiveRows:
    """The active rows of a problem; those of the last configuration are kept, for bodies that rest.

    Parameters
    ----------
    problem : Problem
        The problem.
    gap : float, optional
        Gap below which a constraint is active, by default the activation tolerance [m].
    """

    def __init__(self, problem: Problem, gap: float | None = None) -> None:
        self._constraints, self._tolerance = problem.constraints, problem.tolerance if gap is None else gap
        self._moving = self._constraints.moving
        self._q, self._last = b"", self._constraints.empty

    def at(self, t: float, q: Array) -> Rows:
        """Return the rows that are active at a time and a configuration."""
        known = q.tobytes()
        if known != self._q or self._moving:
            found = self._constraints.active(t, q, self._tolerance)
            self._q = known
            self._last = with_full_gradients(found) if len(found.gap) or found.rate is not None else found
        return self._last


def rows_of_impacts(run: RunData, problem: Problem) -> ActiveRows:
    """Return the rows that located impacts act on: of `Adaptive` contacts are open by a part of its tolerance there."""
    scheme = run.record.scheme
    return ActiveRows(problem, Measure(problem, scheme.tolerance).gap if isinstance(scheme, Adaptive) else None)


def with_full_gradients(active: Rows) -> Rows:
    """Return rows with full gradients."""
    rows, columns = active.jacobian.shape
    if rows * (rows + columns) > _MOST_ENTRIES:
        raise InputError(f"the diagnosis compares every active row with every other, and {rows} at once are too many")
    tangents = active.tangents
    if tangents is not None:
        tangents = tangents._replace(jacobian=dense(tangents.jacobian))
    return active._replace(jacobian=dense(active.jacobian), tangents=tangents)
