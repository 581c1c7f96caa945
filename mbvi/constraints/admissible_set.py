"""K = {q : f_a(q) >= 0}: all constraints of a problem stacked, and the active ones at a configuration."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from ..compiled import kernel, plain_array
from ..system import System
from .given import Given
from .joint_limit import JointLimits
from .rebuilt import Rebuilt
from .rows import STILL, Array, Constraint, Rows, stacked

# one bit each; more of them are asked at every step
_MOST_REMEMBERING = 60


@kernel("i8(f8[::1], f8[:,::1], f8[:,::1], f8[::1])")
def _use_up(moved: Array, envelope: Array, travel: Array, spare: Array) -> int:
    """Take what was travelled from what constraints have to spare; return one bit for each that must be asked.

    Parameters
    ----------
    moved : ndarray, shape (nv,)
        Tangent vector between two configurations.
    envelope, travel : ndarray, shape (n, nv)
        How fast each velocity can close each constraint, and what was travelled since it was asked; added to.
    spare : ndarray, shape (n,)
        How far each is from closing; -inf where it must be asked in any case.
    """
    n, nv = envelope.shape
    asked = 0
    for k in range(n):
        used = 0.0
        for i in range(nv):
            far = abs(moved[i])
            travel[k, i] += far
            used += envelope[k, i] * far
        spare[k] -= used
        if not spare[k] >= 0.0:
            asked |= 1 << k
    return asked


class AdmissibleSet(Rebuilt):
    """The stack of constraints.

    Parameters
    ----------
    system : System
        What q belongs to.
    constraints : sequence of Constraint
        Objects with `gap(t, q)` and `gradient(t, q)`; those with `active(t, q, tolerance, travel)` are asked for
        their near rows only.
    restitution : ndarray, shape (len(constraints),)
        e of those constraints that carry none of their own.

    Attributes
    ----------
    lever : ndarray, shape (k,)
        What gaps and rates of the first k constraints are multiplied by to be lengths; those of all others are.

    Notes
    -----
    Constraints are numbered through; `name(k)` is what impacts call number k. The last configuration is remembered so
    that far pairs need not be asked again: answers do not depend on it.
    """

    # how often another set than the last was asked, of all there are
    _epochs = 0

    def __init__(self, system: System, constraints: Sequence[Constraint], restitution: Array) -> None:
        self.system = system
        self.constraints = tuple(constraints)
        self._sizes = [_size(c) for c in self.constraints]
        self._starts = [int(s) for s in np.concatenate([[0], np.cumsum(self._sizes)])]
        # those that choose their rows are the library's own, but for a user's that do so too
        self._given = {
            id(c): Given(system, c, partial(self._named, start))
            for c, start in zip(self.constraints, self._starts[:-1], strict=True)
            if not hasattr(c, "active")
        }
        ask = [getattr(c, "active", None) or self._given[id(c)].active for c in self.constraints]
        # those that remember are asked only when what they had to spare is spent
        remembering: Any = [c for c in self.constraints if hasattr(c, "asked_by")]
        self._remembering: list[Any] = remembering[:_MOST_REMEMBERING]
        number = {id(c): k for k, c in enumerate(self._remembering)}
        turn = [number.get(id(c), -1) for c in self.constraints]
        self._all = list(zip(self.constraints, turn, ask, self._starts[:-1], restitution, strict=True))
        self._plans: dict[int, list[tuple[Any, int, Any, int, float]]] = {}
        self._envelope = np.array([c.envelope for c in self._remembering]).reshape(-1, system.nv)
        self._travel, self._spare = np.zeros(self._envelope.shape), np.empty(len(self._remembering))
        self._travels = list(self._travel)
        # of these, one bit for each that is asked at every step
        self._busy = self._epoch = 0
        # of the constraints up to the last limit of a joint that turns: see `levers`
        self.lever = np.zeros(0)
        for constraint, start in zip(self.constraints, self._starts[:-1], strict=True):
            if isinstance(constraint, JointLimits) and (constraint.lever != 1.0).any():
                before = np.ones(start - len(self.lever))
                self.lever = np.concatenate([self.lever, before, constraint.lever])
        self._names: dict[int, str] = {}
        self._last: Array | None = None
        self.empty = Rows(
            np.zeros(0, dtype=np.intp), np.zeros(0), np.zeros((0, system.nv)), np.zeros(0), *np.zeros((2, 0, 3))
        )

    def __len__(self) -> int:
        return self._starts[-1]

    def name(self, number: int) -> str:
        """Return the name of a constraint: "hopper/foot | floor", "hopper/knee lower limit", "f 0"."""
        known = self._names.get(number)
        if known is None:
            known = self._names[number] = self._name(number)
        return known

    def _name(self, number: int) -> str:
        k = bisect_right(self._starts, number) - 1
        constraint, inner = self.constraints[k], number - self._starts[k]
        if hasattr(constraint, "name"):
            return str(constraint.name(inner))
        names: Any = getattr(constraint, "names", ())
        return str(names[inner]) if inner < len(names) else f"f {number}"

    def _named(self, start: int, row: int) -> str:
        return self.name(start + row)

    @property
    def moving(self) -> bool:
        """Whether some constraint changes with time at a fixed q."""
        return any(hasattr(constraint, "rate") for constraint in self.constraints)

    @property
    def largest_restitution(self) -> float:
        """The largest e there is; of a crowd of shapes, whose pairs are listed as they come near, none is counted."""
        found = [0.0]
        for constraint, _, e in self.numbered():
            if hasattr(constraint, "restitution"):
                found.append(float(np.max(constraint.restitution, initial=0.0)))
            elif not hasattr(constraint, "active"):
                found.append(e)
        return max(found)

    def levers(self, numbers: Array) -> Array | float:
        """Return what gaps and rates of some rows are multiplied by to be lengths, shape (k,), or 1."""
        if not self.lever.size:
            return 1.0
        return np.where(numbers < len(self.lever), self.lever.take(numbers, mode="clip"), 1.0)

    def numbered(self) -> list[tuple[Constraint, int, float]]:
        """Return every constraint, the number of its first row, and e where it carries none of its own."""
        return [(constraint, start, e) for constraint, _, _, start, e in self._all]

    def active(
        self, t: float, q: Array, tolerance: float, origin: Array | None = None, moved: Array | None = None
    ) -> Rows:
        """Return J(q): the rows with f_a(q) <= tolerance.

        Parameters
        ----------
        t : float
            Time [s].
        q : ndarray, shape (nq,)
            Configuration.
        tolerance : float
            Activation tolerance [m or rad].
        origin, moved : ndarray, shapes (nq,) and (nv,), optional
            Where known, another configuration and the tangent vector from there to q: where that is the one asked
            about last, no difference need be taken.
        """
        stale = self._spend(q, origin, moved)
        asked = stale | self._busy
        plan = self._plans.get(asked)
        if plan is None:
            # few sets come again and again
            plan = self._plans[asked] = [one for one in self._all if one[1] < 0 or asked >> one[1] & 1]
        found = []
        for constraint, turn, ask, start, e in plan:
            if turn < 0:
                rows = _own_numbers(ask(t, q, tolerance, None), start, e)
            elif stale >> turn & 1:
                rows = self._ask_anew(turn, t, q, tolerance)
            else:
                rows = ask(t, q, tolerance, STILL)
                if constraint.spare < 0.0 or not constraint.busy:
                    # what it has to spare is to be found out anew
                    self._spare[turn] = -np.inf
            if rows is not None:
                found.append(rows)
        if not found:
            return self.empty
        return stacked(found)

    def near(self, t: float, q: Array, reach: float) -> Rows:
        """Return the rows with f_a(q) <= reach, which may be more than the tolerance asked with before.

        All constraints are asked: those that remember know nothing of a larger tolerance.
        """
        self._take_over(True)
        return self.active(t, q, reach)

    def _ask_anew(self, turn: int, t: float, q: Array, tolerance: float) -> Rows | None:
        constraint = self._remembering[turn]
        rows: Rows | None = constraint.active(t, q, tolerance, self._travels[turn])
        self._spare[turn] = constraint.spare
        self._busy = self._busy & ~(1 << turn) | constraint.busy << turn
        return rows

    def _take_over(self, all_of_them: bool) -> None:
        """Let constraints forget what another set asked: they may be shared."""
        AdmissibleSet._epochs += 1
        self._epoch = AdmissibleSet._epochs
        for turn, constraint in enumerate(self._remembering):
            if constraint.asked_by is not self or all_of_them:
                constraint.asked_by = self
                constraint.first_number = self._starts[self.constraints.index(constraint)]
                constraint.forget()
                self._spare[turn] = -np.inf

    def _spend(self, q: Array, origin: Array | None, moved: Array | None) -> int:
        """Return which of the constraints that remember must be asked at q, one bit each."""
        last = self._last
        # kept as it is where it cannot change, else as a copy
        self._last = q if not q.flags.writeable else q.copy()
        if self._epoch != AdmissibleSet._epochs or last is None:
            self._take_over(last is None)
        if last is None:
            return (1 << len(self._remembering)) - 1
        if moved is None or (origin is not last and (origin is None or origin.tobytes() != last.tobytes())):
            moved = self.system.difference(last, q)
        return _use_up(moved, self._envelope, self._travel, self._spare)

    def gap(self, t: float, q: Array) -> Array:
        """Return every f_a(q), stacked, shape (m,) [m or rad]."""
        given = self._given
        return np.concatenate([
            np.zeros(0),
            *(given[id(c)].gaps(t, q) if id(c) in given else np.atleast_1d(c.gap(t, q)) for c in self.constraints),
        ])  # fmt: skip

    def gradient(self, t: float, q: Array) -> Array:
        """Return every grad f_a(q) in the tangent space, stacked, shape (m, nv)."""
        rows = [np.atleast_2d(c.gradient(t, q)) for c in self.constraints]
        return np.concatenate([np.zeros((0, self.system.nv)), *rows])

    def given(self, constraint: Constraint) -> Given | None:
        """Return a constraint as it is checked, if a user gave it by gaps and gradients."""
        return self._given.get(id(constraint))

    def check(self, t: float, q: Array) -> None:
        """Check what users gave at the start of a run.

        Raises
        ------
        InputError
            If gaps are not finite, or gradients not of shape (nv,), not finite or of the wrong sign.
        """
        for given in self._given.values():
            given.check(t, q)


def _size(constraint: Constraint) -> int:
    size = getattr(constraint, "size", None)
    return int(size) if size is not None else max(1, len(getattr(constraint, "names", ())))


def _own_numbers(rows: Rows | None, start: int, e: float) -> Rows | None:
    """Return rows as of the stack, with the problem's e where they carry none; those that remember do so themselves."""
    if rows is None:
        return None
    own = np.full(len(rows.gap), e) if np.isnan(rows.restitution[0]) else rows.restitution
    number, gap, jacobian, _, point, normal, rate = rows
    # they may come from a user's code
    numbers = np.asarray(number, dtype=np.int64) + start
    gradients = plain_array(jacobian) if isinstance(jacobian, np.ndarray) else jacobian
    moving = None if rate is None else plain_array(rate)
    return Rows(numbers, plain_array(gap), gradients, plain_array(own), plain_array(point), plain_array(normal), moving)
