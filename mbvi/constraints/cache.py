"""The cache of an admissible set: skips families whose bodies have not moved far enough to touch."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..compiled import kernel
from ..system import System, independent_parts
from .families.candidates import PairCandidates
from .family import ConstraintFamily
from .rows import Array, Rows

# families with a bit of their own in a mask; all others are queried at every step
_MOST_CACHED = 60
# queries in a row in which some candidate had no row, after which candidates are listed again: to list them costs more
# than to measure a few that have no row
IDLE = 8


@kernel("i8(f8[::1], f8[:,::1], f8[:,::1], f8[::1], f8)")
def consume_clearance(moved: Array, envelope: Array, travel: Array, clearance: Array, tolerance: float) -> int:
    """Take a displacement from the clearances of families; return a mask of those that are used up.

    Parameters
    ----------
    moved : ndarray, shape (nv,)
        Tangent vector between two configurations.
    envelope : ndarray, shape (n, nv)
        The envelope of each family: a gap falls by no more than envelope . |moved|.
    travel : ndarray, shape (n, nv)
        Sum of |moved| since each family was last updated; added to.
    clearance : ndarray, shape (n,)
        Lower bound of the gaps of each family that are not measured at every step, -inf where it must be queried in
        any case; subtracted from [m].
    tolerance : float
        A bound below this is used up [m].
    """
    n, nv = envelope.shape
    exhausted = 0
    for k in range(n):
        used = 0.0
        for i in range(nv):
            far = abs(moved[i])
            travel[k, i] += far
            used += envelope[k, i] * far
        clearance[k] -= used
        if not clearance[k] >= tolerance:
            exhausted |= 1 << k
    return exhausted


class _Entry:
    """One family in the cache, and how its rows become rows of the problem.

    Attributes
    ----------
    slot : int
        Its row in the arrays of the cache; -1 for a family that is queried at every step.
    candidates : PairCandidates or None
        Of a family of pairs.
    idle : int
        How many queries in a row had a candidate without a row.
    """

    def __init__(self, family: ConstraintFamily, start: int, e: float, slot: int) -> None:
        self.family, self.slot, self.idle = family, slot, 0
        self.candidates: PairCandidates | None = None if slot < 0 else family.pair_candidates()
        self.query: Any = family.contacts if self.candidates is None else family.contacts_among
        self._start, self._e, self._own_e = start, e, not np.isnan(family.restitution).any()
        # the family's numbers are those of the problem, and every row has its own e
        self.as_is = start == 0 and self._own_e
        # constraint numbers of the last rows, counted in the family and in the problem
        self._number = self._shifted = np.zeros(0, np.int64)

    def numbered(self, rows: Rows) -> Rows:
        """Return the rows of the family as rows of the problem: with its numbers, and its e where they have none."""
        number, gap, jacobian, e, point, normal, rate, _ = rows
        if number is not self._number:
            # the same array means the same numbers: a family does not write to it
            self._number, self._shifted = number, number + self._start
        if not self._own_e:
            e = np.where(np.isnan(e), self._e, e)
        return Rows(self._shifted, gap, jacobian, e, point, normal, rate)


class _Saved(NamedTuple):
    """The state of a cache: of each family how often it was idle, and its candidates."""

    last: Array | None
    always_query: int
    travel: Array
    clearance: Array
    entries: list[tuple[int, tuple[Array, Array, bool] | None]]


class ClearanceCache:
    """Skips the families that cannot have a row within the tolerance yet; each `AdmissibleSet` has one of its own.

    After a query the cache knows the clearance of a family: the least gap of the rows that the query did not return.
    From one configuration to the next a gap falls by no more than envelope . |difference|, which is taken from the
    clearance. Once the clearance is below the tolerance of a query the family is queried again. The tolerance may
    differ from query to query.

    A family of pairs (`PairCandidates`) has a second level. While the other pairs have clearance left, only the
    candidates are measured, at every step. Once the least of it is used up, the travel since the last update
    is taken from the clearance of every pair, and the candidates are listed again.

    Parameters
    ----------
    system : System
        The system whose configurations q are.
    numbered : sequence of (ConstraintFamily, int, float)
        Each family, the number of its first constraint, and e where it has none of its own.

    Notes
    -----
    State lies in flat arrays, one row for each family that can be skipped: `envelope` and `travel` (n, nv), `clearance`
    (n,). Sets of families are masks with bit k for row k. Families have no such state: several sets may share them.
    `squares` are those of the envelope, also of walls that move, for `travel`, and `turn_squares` those of angles only,
    for bends of gaps, also of families that are always queried; `searched` (nv,) are the velocities that move bodies of
    families without an envelope at one time, and `part` (nv,) is as of `independent_parts`. While the compiled loop has
    the state, `reclaim` is the function that takes it back; it is called where functions of the user query the
    constraints.
    """

    def __init__(self, system: System, numbered: Sequence[tuple[ConstraintFamily, int, float]]) -> None:
        self._system, self.part = system, independent_parts(system)
        self._entries: list[_Entry] = []
        envelopes: list[Array] = []
        travelling: list[Array] = []
        bending: list[Array] = []
        self.searched = np.zeros(system.nv, bool)
        for family, start, e in numbered:
            envelope = None if family.moving or len(envelopes) == _MOST_CACHED else family.envelope()
            self._entries.append(_Entry(family, start, e, -1 if envelope is None else len(envelopes)))
            if envelope is not None:
                envelopes.append(envelope)
            bends = family.bending_envelope() if envelope is None else envelope
            # at one time a wall that moves is as one at rest
            at_one_time = envelope if family.at_rest is None else family.at_rest.envelope()
            if at_one_time is None:
                self.searched |= True if bends is None else bends > 0.0
            else:
                travelling.append(at_one_time)
            if bends is not None and len(bending) < _MOST_CACHED:
                bending.append(bends)
        # those with a place in the arrays
        self._skipped = [entry for entry in self._entries if entry.slot >= 0]
        self._envelope = np.array(envelopes, dtype=float).reshape(-1, system.nv)
        self.squares = np.array(travelling, dtype=float).reshape(-1, system.nv) ** 2
        squares = np.array(bending, dtype=float).reshape(-1, system.nv) ** 2
        self.turn_squares = np.where(system.are_lengths(), 0.0, squares)
        self._travel, self._clearance = np.zeros(self._envelope.shape), np.full(len(envelopes), -np.inf)
        self._travels = list(self._travel)
        # mask of the families whose candidates are measured at every step
        self._always_query = 0
        # the entries to be queried for each mask; a run has few different masks
        self._plans: dict[int, list[_Entry]] = {}
        self._last: Array | None = None
        self.reclaim: Callable[[], None] | None = None

    def start(self, q: Array) -> None:
        """Let the compiled loop begin at q, before any query."""
        self._last = q.copy()

    def travel(self, displacement: Array) -> float:
        """Return the largest displacement of a body in any family; see `AdmissibleSet.travel`.

        The parts of independent velocities are added as if they were orthogonal.
        """
        return float((self.squares @ (displacement * displacement)).max(initial=0.0)) ** 0.5

    def forget(self) -> None:
        """Query every family, and measure every pair, at the next configuration."""
        self._reclaim()
        self._clearance[:] = -np.inf
        for entry in self._entries:
            if entry.candidates is not None:
                entry.candidates.forget()

    def _reclaim(self) -> None:
        if self.reclaim is not None:
            self.reclaim()

    def save(self) -> _Saved:
        """Return the state, for `restore`."""
        self._reclaim()
        entries = [
            (entry.idle, None if one is None else (one.clearance.copy(), one.index, one.any_empty))
            for entry in self._entries
            for one in (entry.candidates,)
        ]
        return _Saved(self._last, self._always_query, self._travel.copy(), self._clearance.copy(), entries)

    def restore(self, saved: _Saved) -> None:
        """Go back to a state that was saved, here or in the cache of a copy of the constraints."""
        self._reclaim()
        self._last, self._always_query = saved.last, saved.always_query
        self._travel[:], self._clearance[:] = saved.travel, saved.clearance
        for entry, (idle, candidates) in zip(self._entries, saved.entries, strict=True):
            entry.idle = idle
            if entry.candidates is not None and candidates is not None:
                entry.candidates.clearance[:], entry.candidates.index, entry.candidates.any_empty = candidates

    @property
    def arrays(self) -> tuple[Array, Array, Array]:
        """Envelopes, travels and clearances of the families that have them, which the compiled loop shares."""
        return self._envelope, self._travel, self._clearance

    @property
    def slots(self) -> list[int]:
        """The row of each family in these arrays; -1 for a family that is queried at every step."""
        return [entry.slot for entry in self._entries]

    def candidates(self, slot: int) -> PairCandidates | None:
        """Return the candidates of one of these families, if it is one of pairs."""
        return self._skipped[slot].candidates

    def lend(self, q: Array, always: Array, listed: Sequence[Array | None]) -> bool:
        """Write the rest of the state for the compiled loop; return False if there was no query yet.

        Parameters
        ----------
        q : ndarray, shape (nq,)
            Receives the configuration of the last query.
        always : ndarray of bool, shape (n,)
            Receives the families of which some candidates are measured at every step.
        listed : sequence of ndarray
            Of each family of pairs receive how many candidates there are, and for how many queries one had no row.
        """
        if self._last is None:
            return False
        q[:] = self._last
        for k, entry in enumerate(self._skipped):
            always[k] = self._always_query >> k & 1
            one = listed[k]
            if entry.candidates is not None and one is not None:
                one[:] = len(entry.candidates.index), entry.idle
        return True

    def take_back(self, q: Array, always: Array, listed: Sequence[Array | None], candidates: Sequence[Array]) -> None:
        """Read the state that the compiled loop left: the arguments of `lend`, and the candidates of each family."""
        self._last, self._always_query = q.copy(), 0
        for k, entry in enumerate(self._skipped):
            self._always_query |= int(always[k]) << k
            one = listed[k]
            if entry.candidates is not None and one is not None:
                count, entry.idle = one.tolist()
                entry.candidates.index = candidates[k][:count].copy()

    def rows_of(self, k: int, t: float, q: Array, tolerance: float) -> Rows | None:
        """Return the rows of family number k, which is queried at every step, within the tolerance [m]."""
        entry = self._entries[k]
        rows: Rows | None = entry.query(t, q, tolerance)
        return rows if rows is None else entry.numbered(rows)

    def contacts(
        self, t: float, q: Array, tolerance: float, origin: Array | None = None, moved: Array | None = None
    ) -> list[Rows]:
        """Return the rows within the tolerance, family by family; see `AdmissibleSet.active`."""
        if self.reclaim is not None:
            self.reclaim()
        exhausted = self._consume(q, tolerance, origin, moved)
        found = []
        mask = exhausted | self._always_query
        plan = self._plans.get(mask)
        if plan is None:
            plan = self._plans[mask] = [one for one in self._entries if one.slot < 0 or mask >> one.slot & 1]
        for entry in plan:
            slot, candidates = entry.slot, entry.candidates
            if candidates is None:
                rows = entry.query(t, q, tolerance)
                if slot >= 0:
                    self._clearance[slot] = entry.family.clearance() + tolerance
            else:
                if exhausted >> slot & 1:
                    self._clearance[slot] = candidates.update(self._travels[slot], tolerance) + tolerance
                    self._always_query = self._always_query & ~(1 << slot) | (candidates.index.size > 0) << slot
                rows = entry.query(q, tolerance, candidates)
                entry.idle = entry.idle + 1 if candidates.any_empty else 0
                if entry.idle == IDLE:
                    # a candidate without a row may be skipped: list the candidates again at the next query
                    self._clearance[slot], entry.idle = -np.inf, 0
            if rows is not None:
                found.append(rows if entry.as_is else entry.numbered(rows))
        return found

    def _consume(self, q: Array, tolerance: float, origin: Array | None, moved: Array | None) -> int:
        """Take the displacement to q from the clearances; return the mask of those that are used up."""
        last = self._last
        # an array that may be written to can change later: keep a copy of it
        self._last = q if not q.flags.writeable else q.copy()
        if last is None:
            return (1 << len(self._clearance)) - 1
        if moved is None and (q is last or q.tobytes() == last.tobytes()):
            # the start of a step is the end of the last one
            moved = np.zeros(self._system.nv)
        elif moved is None or (origin is not last and (origin is None or origin.tobytes() != last.tobytes())):
            moved = self._system.difference(last, q)
        return consume_clearance(moved, self._envelope, self._travel, self._clearance, tolerance)
