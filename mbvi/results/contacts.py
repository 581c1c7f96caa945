"""The contacts of a run: points, normals and percussions in each interval between recorded states."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..constraints import AdmissibleSet
from ..constraints.carried import Place, carried_along
from ..constraints.contact import Contact
from ..constraints.rows import Rows, match_contacts
from ..schemes.contact_friction import ContactFriction, with_friction

Array = np.ndarray
# rows allocated at first
_ROOM = 64
# where the columns of friction begin
_FRICTION = 7, 10, 11, 14


@dataclass(frozen=True)
class CorrectionTable:
    """What the percussions of a run leave out of the momentum of free bodies; see `Step.correction`.

    Attributes
    ----------
    starts : ndarray of int, shape (n + 2,)
        As of `ContactTable`.
    constraint : ndarray of int, shape (c,)
        Index of each row's constraint in `ContactTable.names`, each once in an interval.
    wrench : ndarray, shape (c, 6)
        Force and moment about the origin, on the body that the normal points to, over the whole interval [N s, N m s].
    """

    starts: Array
    constraint: Array
    wrench: Array

    def __post_init__(self) -> None:
        for array in (self.starts, self.constraint, self.wrench):
            array.setflags(write=False)

    def part(self, first: int, end: int) -> CorrectionTable:
        """Return those of the intervals that end at some of the states."""
        starts = self.starts[first : end + 1]
        rows = slice(int(starts[0]), int(starts[-1]))
        return CorrectionTable(starts - starts[0], self.constraint[rows], self.wrench[rows])


@dataclass(frozen=True)
class ContactTable:
    """The contacts of a run, in the order of the intervals between recorded states.

    Attributes
    ----------
    starts : ndarray of int, shape (n + 2,)
        Rows starts[i] to starts[i + 1] are those of (t_{i-1}, t_i]; before t_0 there are none.
    constraint : ndarray of int, shape (k,)
        Index of each row's constraint in `names`.
    names : tuple of str
        Names of constraints.
    point, normal : ndarray, shape (k, 3)
        As `Contact`.
    percussion : ndarray, shape (k,)
        Over the whole interval [N s, N m s].
    tangential, slip : ndarray, shape (k, 3), or None
        As `Contact`, the percussion over the whole interval and the mean velocity after its steps, weighted by their
        percussions; None in problems without friction.
    sticks : ndarray of bool, shape (k,), or None
        Which rows stick in all steps of the interval.
    angular : ndarray, shape (k, 3), or None
        As `ContactFriction`, over the whole interval.
    corrections : CorrectionTable or None
        What the percussions leave out; None in files of earlier versions.
    """

    starts: Array
    constraint: Array
    names: tuple[str, ...]
    point: Array
    normal: Array
    percussion: Array
    tangential: Array | None = None
    slip: Array | None = None
    sticks: Array | None = None
    angular: Array | None = None
    corrections: CorrectionTable | None = None

    def __post_init__(self) -> None:
        for array in (self.starts, self.constraint, *self.columns):
            if array is not None:
                array.setflags(write=False)

    @property
    def columns(self) -> tuple[Array | None, ...]:
        """Points, normals and percussions, and the attributes of friction."""
        return self.point, self.normal, self.percussion, self.tangential, self.slip, self.sticks, self.angular

    def part(self, first: int, end: int) -> ContactTable:
        """Return the contacts of the intervals that end at some of the states."""
        starts = self.starts[first : end + 1]
        rows = slice(int(starts[0]), int(starts[-1]))
        columns = (None if values is None else values[rows] for values in self.columns)
        corrections = None if self.corrections is None else self.corrections.part(first, end)
        table = ContactTable(starts - starts[0], self.constraint[rows], self.names, *columns)  # type: ignore[arg-type]
        return replace(table, corrections=corrections)

    def interval(self, i: int, duration: float) -> tuple[Contact, ...]:
        """Return the contacts of an interval of the given duration [s]."""
        rows = slice(int(self.starts[i]), int(self.starts[i + 1]))
        names, p = self.names, self.percussion
        found = tuple(
            Contact(names[self.constraint[a]], self.point[a], self.normal[a], float(p[a]), float(p[a]) / duration)
            for a in range(rows.start, rows.stop)
        )
        if self.tangential is None or self.slip is None or self.sticks is None:
            return found
        friction = ContactFriction(self.tangential, self.slip, self.slip, self.sticks, self.angular)
        return with_friction(found, friction.take(rows), duration)


class _Whereabouts(NamedTuple):
    """The constraints of rows, what was added to their numbers, and what returns where the rows are."""

    constraints: AdmissibleSet | None
    offset: int
    place: Callable[[], Place] | None


class ContactLog:
    """Collects the contacts of a run in arrays that grow.

    A contact with percussions in several steps between two recorded states is one row: the sum of its percussions as
    vectors, at the mean of its points weighted by them. The force of the row is then its mean over the interval.

    Parameters
    ----------
    same : float
        A contact that moves by more than this from one step to the next is sought among all of its constraint, where
        bodies have carried them [m].
    frictional : bool
        Whether the problem has friction.
    resisting : bool
        Whether it has torsional or rolling friction.

    Attributes
    ----------
    number : ndarray of int, shape (room,)
        Constraint of each row; the first `starts[-1]` are filled.
    values : ndarray, shape (room, 7), with friction (room, 14) or (room, 17)
        Point, normal and percussion of each row; with friction its velocity, the part of the percussion with which it
        slips, the tangential percussion, and that of torsional and rolling friction.
    starts : list of int
        As `ContactTable.starts`, of the intervals that have ended.
    offset : int
        What is added to numbers of constraints: after a switch these are others.
    constraints : AdmissibleSet or None
        The constraints of the rows that are added; without them, points are compared where they are.
    """

    def __init__(self, same: float, *, frictional: bool = False, resisting: bool = False) -> None:
        self._same, self._frictional, self.offset = same, frictional, 0
        width = 17 if resisting else 14 if frictional else 7
        self.number, self.values = np.empty(_ROOM, np.int64), np.empty((_ROOM, width))
        self.starts = [0]
        self.constraints: AdmissibleSet | None = None
        # of the steps of the present interval the first rows and where they are, and the end of the last one
        self._begins: list[int] = []
        self._places: list[_Whereabouts] = []
        self._end = 0
        # what percussions leave out of the present interval, and of those that have ended, by constraint
        self._left_out: dict[int, Array] = {}
        self._corrected, self._corrections, self._corrected_starts = list[int](), list[Array](), [0]

    def add(
        self, number: Array, point: Array, normal: Array, percussion: Array, friction: ContactFriction | None = None,
        correction: Array | None = None, place: Callable[[], Place] | None = None,
    ) -> None:  # fmt: skip
        """Add the rows of a step that have a percussion, and `Step.correction`; `place` returns where rows are."""
        if correction is not None:
            for a in np.flatnonzero(correction.any(axis=1)).tolist():
                name = int(number[a]) + self.offset
                self._left_out[name] = self._left_out.get(name, 0.0) + correction[a]
        index = (percussion > 0.0).nonzero()[0]
        if not index.size:
            return
        begin, end = self._end, self._end + index.size
        if end > len(self.number):
            room = max(2 * len(self.number), end)
            number_of, values_of = np.empty(room, np.int64), np.empty((room, self.values.shape[1]))
            number_of[:begin], values_of[:begin] = self.number[:begin], self.values[:begin]
            self.number, self.values = number_of, values_of
        values = self.values[begin:end]
        self.number[begin:end] = number[index] + self.offset
        values[:, :3], values[:, 3:6], values[:, 6] = point[index], normal[index], percussion[index]
        if self._frictional:
            values[:, 7:] = 0.0
            values[:, 10] = 1.0
        if friction is not None:
            values[:, 7:10], values[:, 11:14] = friction.after[index], friction.tangential[index]
            values[:, 10] = ~friction.sticks[index]
            if friction.angular is not None:
                values[:, 14:] = friction.angular[index]
        self._begins.append(begin)
        self._places.append(_Whereabouts(self.constraints, self.offset, place))
        self._end = end

    def close(self) -> None:
        """End an interval: a state is recorded."""
        if len(self._begins) > 1:
            self._merge()
        self._begins.clear()
        self._places.clear()
        self.starts.append(self._end)
        self._corrected += self._left_out.keys()
        self._corrections += self._left_out.values()
        self._corrected_starts.append(len(self._corrected))
        self._left_out.clear()

    def table(self, name: Callable[[int], str], states: int) -> ContactTable:
        """Return the contacts of the intervals up to as many recorded states."""
        return self.piece(name, 0, states)

    def piece(self, name: Callable[[int], str], first: int, end: int) -> ContactTable:
        """Return the contacts of the intervals that end at some of the recorded states."""
        starts = np.array(self.starts[first : end + 1])
        rows = slice(int(starts[0]), int(starts[-1]))
        corrected = np.array(self._corrected_starts[first : end + 1])
        others = slice(int(corrected[0]), int(corrected[-1]))
        numbers = np.concatenate([self.number[rows], np.array(self._corrected[others], np.int64)])
        known, constraint = np.unique(numbers, return_inverse=True)
        constraint, of_corrections = np.split(constraint, [rows.stop - rows.start])
        wrench = np.array(self._corrections[others]).reshape(-1, 6)
        corrections = CorrectionTable(corrected - corrected[0], of_corrections, wrench)
        point, normal, percussion, *friction = np.split(self.values[rows].copy(), [3, 6, *_FRICTION], axis=1)
        names = tuple(map(name, known.tolist()))
        more: tuple[Array | None, ...] = ()
        if self._frictional:
            slip, slides, tangential, angular = friction
            more = tangential, slip, slides[:, 0] == 0.0, angular if angular.shape[1] else None
        table = ContactTable(starts - starts[0], constraint, names, point, normal, percussion[:, 0], *more)  # type: ignore[arg-type]
        return replace(table, corrections=corrections)

    def _merge(self) -> None:
        """Merge the rows of each contact of the present interval into one."""
        first = self._begins[0]
        ends = [*self._begins[1:], self._end]
        number = self.number[first : ends[0]].copy()
        total = _moments(self.values[first : ends[0]])
        # of each contact its point in the last step that had it, and which one that was
        point, seen = self.values[first : ends[0], :3].copy(), np.zeros(len(number), np.int64)
        for j, (begin, end) in enumerate(zip(self._begins[1:], ends[1:], strict=True), 1):
            other, values = self.number[begin:end], self.values[begin:end]
            at, more = values[:, :3].copy(), _moments(values)
            owner = self._owner(other, at, number, point, seen, j)
            known = owner >= 0
            # every contact is the owner of one row at most
            total[owner[known]] += more[known]
            point[owner[known]], seen[owner[known]] = at[known], j
            if known.all():
                continue
            number, total = np.concatenate([number, other[~known]]), np.concatenate([total, more[~known]])
            point, seen = np.concatenate([point, at[~known]]), np.append(seen, np.full(int((~known).sum()), j))
        length = np.sqrt(np.vecdot(total[:, 3:6], total[:, 3:6]))
        left = length != 0.0
        number, total, length = number[left], total[left], length[left]
        # joint limits have no normal: their percussions are added as numbers
        length = np.where(np.isnan(length), total[:, 6], length)
        self._end = first + len(number)
        self.number[first : self._end] = number
        values = self.values[first : self._end]
        values[:, :3], values[:, 3:6], values[:, 6] = (
            total[:, :3] / total[:, 6:7],
            total[:, 3:6] / length[:, None],
            length,
        )
        if self._frictional:
            values[:, 7:11], values[:, 11:] = total[:, 7:11] / total[:, 6:7], total[:, 11:]

    def _owner(self, number: Array, point: Array, others: Array, known: Array, seen: Array, step: int) -> Array:
        """Return the contact that each row of a step continues, -1 where it begins a new one.

        The contacts have the numbers `others`, and had the points `known` in the steps `seen`.
        """
        if len(number) == len(others) and (number == others).all():
            apart = point - known
            if not (np.vecdot(apart, apart) > self._same**2).any():
                return np.arange(len(number))
        return match_contacts(_rows(number, point), _rows(others, self._carried(others, known, seen, step)))

    def _carried(self, number: Array, point: Array, seen: Array, step: int) -> Array:
        """Return where bodies have carried the points that contacts had in the steps `seen`."""
        point, now = point.copy(), self._places[step]
        for k in np.unique(seen).tolist():
            then, some = self._places[k], np.flatnonzero(seen == k)
            if now.constraints is None or then.constraints is not now.constraints or not (then.place and now.place):
                continue
            rows = _rows(number[some] - now.offset, point[some])
            point[some] = carried_along(now.constraints, rows, then.place(), now.place()).point
        return point


def _moments(values: Array) -> Array:
    """Return p x, p n and p of rows, then p times their velocity and slipping part, p_t and torques: these add up."""
    moments = values.copy()
    moments[:, :6] *= values[:, 6:7]
    moments[:, 7:11] *= values[:, 6:7]
    return moments


def _rows(number: Array, point: Array) -> Rows:
    none = np.zeros(len(number))
    return Rows(number, none, none, none, point, point)
