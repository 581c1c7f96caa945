"""Records the states of a run of fixed steps, and detects which contact percussions are impacts."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from functools import partial

import numpy as np

from ...compiled import kernel
from ...errors import MbviWarning
from ...problem import Problem
from ...results.contacts import ContactLog
from ...results.run_data import Array, Impact, RunRecord, Switch
from ...results.trajectory import Trajectory
from ...schemes import SchemeBase, Step, Timing
from ...schemes.contact_friction import friction_of
from ...schemes.event_driven.runge_kutta import DEGREE
from ...schemes.step import STILL
from .carried_rows import NO_LAST_ROWS, LastRows, carried_rows, farthest, last_rows, place_of_rows
from .impact_rows import RecentPercussions, friction_of_impact, linked

# contact points of one pair in consecutive steps count as the same point within this distance, which is measured where
# one of both bodies carries the former [lengths of the scene]
SAME_POINT = 0.1
# steps whose percussions are compared with that of a possible impact; several, because in piles many resting contacts
# have a percussion every few steps only
RECENT = 16
# most notes that are kept, because a note may repeat at every step
_MOST_NOTES = 20


@kernel("b1(i8, i8[::1], f8[::1], f8[:,::1], f8, f8[::1], i8, f8, f8[::1], f8[::1], f8[::1])")
def record_depth(
    k: int, number: Array, gap: Array, rates: Array, residual: float, lever: Array, limits: int, still: float,
    penetration: Array, violation: Array, residuals: Array,
) -> bool:  # fmt: skip
    """Record the depths of a step and its residual; return whether an impact is possible.

    An impact is possible if the gap of a row with a percussion falls faster than twice what the forces of one step
    explain.

    Parameters
    ----------
    k : int
        Index of the state that is recorded next.
    number, gap, rates, residual
        Those of a `Step`, `number` the constraints of its rows.
    lever : ndarray, shape (c,)
        Factors from rates of the first c constraints to m/s; that of other constraints is 1.
    limits : int
        How many constraints, the first ones, are limits of joints.
    still : float
        Closing speed below which a row counts as still [m/s].
    penetration, violation, residuals : ndarray, shape (n,)
        Receive the greatest depths of contacts and of joint limits, and the largest residual, since the last recorded
        state; zero before its first step.
    """
    residuals[k] = max(residuals[k], residual)
    deepest, farthest, impact = 0.0, 0.0, False
    for a in range(len(gap)):
        if number[a] < limits:
            farthest = max(farthest, -gap[a])
        else:
            deepest = max(deepest, -gap[a])
        percussion, free, before = rates[0, a], rates[1, a], rates[3, a]
        least = still / lever[number[a]] if number[a] < len(lever) else still
        impact = impact or (percussion > 0.0 and before + 2.0 * abs(free - before) < -least)
    penetration[k], violation[k] = max(penetration[k], deepest), max(violation[k], farthest)
    return impact


@kernel(
    "Tuple((i8, f8))(i8[::1], f8[:,::1], f8[:,::1], f8[::1], i8[::1], f8[:,:,::1], f8[:,::1], f8, f8[::1], f8, i1[::1])"
)
def _choose_rows(
    number: Array, point: Array, rates: Array, e: Array,
    last_number: Array, last_point: Array, last_rates: Array, far: float, lever: Array, still: float, chosen: Array,
) -> tuple[int, float]:  # fmt: skip
    """Choose the rows that may belong to an impact, if there is one, and add up its energy.

    A row closes if it has a percussion, had none in the step before, and its gap falls faster than twice what the
    forces of one step explain. If a row closes, rows whose percussion is more than twice that of the step before may
    take part.

    Parameters
    ----------
    number, point, rates, e
        Constraints, contact points, rates and restitution of a step's rows.
    last_number, last_point, last_rates
        Those of the step before, numbers ascending; points, shape (2, m, 3), as each of both bodies has carried them.
    far : float
        Distance above which two contact points of one constraint count as different [m].
    lever, still
        See `record_depth`.
    chosen : ndarray of int8, shape (k,)
        Receives 2 for rows that close, 1 for those that may take part, 0 for others.

    Returns
    -------
    count : int
        How many rows may take part; 0 if no row closes.
    energy : float
        Kinetic energy gained by the law (8) [J]; see `Impact`.
    """
    count, energy, any_closes = 0, 0.0, False
    for a in range(len(number)):
        percussion, free, after, before = rates[0, a], rates[1, a], rates[2, a], rates[3, a]
        energy += 0.5 * percussion * (before + after + (free - before) * (1.0 - e[a]) / (1.0 + e[a]))
        previous = 0.0
        if percussion > 0.0:
            begin, end = 0, len(last_number)
            while begin < end:
                middle = (begin + end) // 2
                if last_number[middle] < number[a]:
                    begin = middle + 1
                else:
                    end = middle
            for b in range(begin, len(last_number)):
                if last_number[b] != number[a]:
                    break
                if last_rates[0, b] > 0.0:
                    near = False
                    for side in range(2):
                        apart = 0.0
                        for c in range(3):
                            apart += (last_point[side, b, c] - point[a, c]) ** 2
                        # written so that NaN, the point of a joint limit, counts as near
                        near = near or not apart > far * far
                    if near:
                        previous += last_rates[0, b]
        least = still / lever[number[a]] if number[a] < len(lever) else still
        closing = percussion > 0.0 and previous == 0.0 and before + 2.0 * abs(free - before) < -least
        any_closes = any_closes or closing
        chosen[a] = 0
        if percussion > 0.0 and percussion > 2.0 * previous:
            chosen[a] = 2 if closing else 1
            count += 1
    if not any_closes:
        for a in range(len(number)):
            chosen[a] = 0
        return 0, energy
    return count, energy


class Recorder:
    """Records the states of a run in arrays that are allocated before it, and its impacts in a list.

    Parameters
    ----------
    problem : Problem
        The problem that is run.
    count : int
        Number of states.
    timing : Timing
        Timing of the scheme.
    notes : sequence of str
        Notes that are known before the run.
    contacts : bool
        Whether the contacts of all steps are recorded.

    Attributes
    ----------
    contacts : ContactLog or None
        The contacts of all steps, where they are recorded.
    timing_of_rows : Timing
        That of the steps, also where the scheme chooses these.
    before, last : Step or None
        The state before the last step, and that step.
    recent : RecentPercussions
        The percussions of the last steps.
    switches : list of Switch
        Connections that were switched.
    impacts_apart : bool
        Whether percussions of impacts are in `impacts` only, not in `contacts` too.
    """

    impacts_apart = False

    def __init__(
        self, problem: Problem, count: int, timing: Timing, notes: Sequence[str] = (), contacts: bool = False
    ) -> None:
        far = SAME_POINT * problem.length
        self.switches: list[Switch] = []
        self._first = problem
        frictional, resisting = problem.constraints.frictional, problem.constraints.resistance is not None
        self.contacts = ContactLog(far, frictional=frictional, resisting=resisting) if contacts else None
        self.timing = self.timing_of_rows = timing
        self.t = np.empty(count)
        self.q = np.empty((count, problem.system.nq))
        self.v = np.empty((count, problem.system.nv))
        self.penetration = np.zeros(count)
        self.limit_violation = np.zeros(count)
        self.residual = np.zeros(count)
        self.dense: list[Array] | None = None
        self.impacts: list[Impact] = []
        self.notes = list(notes)
        self._warned = False
        self.count = 0
        self.begin(problem)

    def begin(self, problem: Problem) -> None:
        """Record steps of a problem from now on."""
        self.problem = problem
        if self.contacts is not None:
            self.contacts.constraints = problem.constraints
        self._limits = problem.constraints.limits
        self._lever, self._still = problem.constraints.lever, STILL * problem.length
        self._parts = problem.constraints.part
        self.recent = RecentPercussions(RECENT)
        self.before: Step | None = None
        self.last: Step | None = None

    def follow(self, before: Step | None, last: Step) -> None:
        """Take a step as the last one, and the state before it, of which no rows are needed."""
        self.before, self.last = before, last

    def name(self, constraint: int) -> str:
        """Return the name of a constraint in the order in which `contacts` count them."""
        return self.problem.constraints.name(constraint)

    def step(self, step: Step, keep: bool) -> None:
        """Record a step: its impacts always, its state if `keep`."""
        t, q, v, active, rates, residual = step[:6]
        k, gap, impacting = self.count, active.gap, None
        if gap.size and record_depth(
            k, active.constraint, gap, rates, residual, self._lever, self._limits, self._still, self.penetration,
            self.limit_violation, self.residual,
        ):  # fmt: skip
            impacting = self.impact(step)
        if self.contacts is not None:
            # percussions of the law at the initial state belong to no interval between states
            if k:
                friction, before = friction_of(step), step if self.last is None else self.last
                place = partial(place_of_rows, self.problem, self.timing_of_rows, before, step)
                p = rates[0] if impacting is None or not self.impacts_apart else np.where(impacting, 0.0, rates[0])
                self.contacts.add(active.constraint, active.point, active.normal, p, friction, step.correction, place)
            # before the state, so that an interrupt leaves no state without its contacts
            if keep:
                self.contacts.close()
        if keep:
            self.t[k] = t
            self.q[k] = q
            self.v[k] = v
            self.count = k + 1
        self.follow(self.last, step)
        self.recent.add(active.constraint, rates[0], impacting)

    def trajectory(self, scheme: SchemeBase, h: float, *, complete: bool = True) -> Trajectory:
        """Return the run recorded so far."""
        n = self.count
        return Trajectory(
            self.t[:n],
            self.q[:n],
            self.v[:n],
            tuple(self.impacts),
            self.residual[:n],
            scheme.name,
            h,
            tuple(self.notes),
            self._first,
            complete,
            RunRecord(
                self.penetration[:n],
                scheme,
                self.timing,
                None if self.dense is None else np.array(self.dense[: n - 1]).reshape(-1, 2, self.v.shape[1], DEGREE),
                limit_violation=self.limit_violation[:n],
                contacts=None if self.contacts is None else self.contacts.table(self.name, n),
                switches=tuple(self.switches),
            ),
        )

    def impact(self, step: Step) -> Array | None:
        """Record an impact: the rows that closed, and the rows linked to them; return which rows these are."""
        active, rates, last = step.active, step.rates, self.last
        number, point, e = active.constraint, active.point, active.restitution
        candidates = np.empty(len(number), np.int8)
        rows, far = last_rows(last), SAME_POINT * self.problem.length

        def choose(rates: Array, rows: LastRows, far: float) -> tuple[int, float]:
            return _choose_rows(number, point, rates, e, *rows, far, self._lever, self._still, candidates)

        travel = farthest(self.problem, self.timing_of_rows, last, step) if rows.number.size else 0.0
        if step.at_once is not None and last is not None:
            # an impact goes on in the next step, in which its bodies move at another velocity
            h, v = step.t - last.t, last.v if self.before is None else self.before.v
            changes = sum(self.problem.constraints.travel(h * change) for change in (last.v - v, step.v - last.v))
            far += changes + h * float(np.abs(last.before).max(initial=0.0))
        count, energy = choose(rates, rows, far + travel)
        if travel > 0.0 and last is not None:
            # poses are computed only where it matters how far bodies have carried the points
            nearest = candidates.copy()
            count, energy = choose(rates, rows if travel < far else NO_LAST_ROWS, far - travel)
            if not np.array_equal(candidates, nearest):
                rows = carried_rows(self.problem, self.timing_of_rows, self.before, last, rows, step)
                count, energy = choose(rates, rows, far)
        if not count:
            return None
        chosen = self._taking_part(step, candidates)
        if step.at_once is not None:
            own = step.at_once(chosen)
            # rows of sleeping contacts stand behind those of the step
            rates = np.concatenate([own, rates[:, own.shape[1] :]], axis=1)
            # percussions of impacts that began in the step before were counted there
            rates[0, ~chosen] = 0.0
            step = step._replace(rates=rates)
            _, energy = choose(rates, rows, far)
        scale = step.percussion @ (np.abs(step.before) + np.abs(step.after))
        if step.slip is not None:
            energy += 0.5 * float(np.vdot(step.slip[0], step.slip[1] + step.slip[2]))
        if energy > 1e-9 * scale:
            when, gain = f"at t = {step.t:.6g} s", f"raised the energy by {energy:.3g} J: Newton's law with"
            if step.slip is not None and e.max() > 0.0:
                self._note(f"{when} an impact {gain} friction and e > 0 promises no loss (Kane's paradox)")
            elif e.min() < e.max():
                what = "a simultaneous impact with different restitutions"
                self._note(f"{when} {what} {gain} several e promises no loss")
        names = tuple(map(self.problem.constraints.name, number[chosen].tolist()))
        percussion, _, after, speed = rates[:, chosen]
        self.impacts.append(
            Impact(
                step.t, names, percussion, speed, after, point[chosen], active.normal[chosen], energy,
                *friction_of_impact(step, chosen),
            )
        )  # fmt: skip
        return chosen

    def _taking_part(self, step: Step, candidates: Array) -> Array:
        """Return the rows that close, and the candidates linked to them whose percussion exceeds what they carry."""
        closing, others = candidates == 2, np.flatnonzero(candidates == 1)
        if not others.size:
            return closing
        exceeds = self.recent.exceeded(step.active.constraint[others], step.percussion[others])
        chosen = closing.copy()
        chosen[others] = exceeds
        # all rows of a single mechanism are linked
        return (
            linked(step.active.jacobian, chosen, closing, self._parts) if self._parts[-1] and exceeds.any() else chosen
        )

    def _note(self, note: str) -> None:
        """Keep a note; warn of the first one."""
        if not self._warned:
            self._warned = True
            warnings.warn(note, MbviWarning, stacklevel=6)
        if len(self.notes) < _MOST_NOTES:
            self.notes.append(note)
