"""What of a run may be trusted: condition (12), (H4), energy, variation, and where another answer is as good."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.sparse import csr_array

from .errors import InputError
from .projection import Forks, Projector, against_condition_12, cosines_between, follow, independent, unit_gradients

if TYPE_CHECKING:
    from .constraints import Rows
    from .problem import Problem
    from .projection import Metric
    from .trajectory import Trajectory

Array = np.ndarray

# single impacts followed at one instant
_MOST_IMPACTS = 2_000
# sines of the angle between a gradient and the span of others below this: dependent
_DEPENDENT = 1e-6
# gradients shorter than this are none
_VANISHING = 1e-12
# names and rows that a report spells out
_MOST_NAMES, _MOST_ROWS = 3, 12


@dataclass(frozen=True)
class Instant:
    """One instant with several active constraints, or a stretch of them with the same ones and no impact.

    Attributes
    ----------
    time, until : float
        The first and the last instant [s]; the same at an impact.
    constraints : tuple of str, length k
        Names, one a contact point or limit.
    restitution : ndarray, shape (k,)
        e of each.
    impact : bool
        Whether the velocity jumped.
    condition_12 : bool
        Whether the angles meet condition (12), throughout a stretch.
    independent : bool
        Whether the gradients are linearly independent, assumption (H4), throughout a stretch.
    energy_change : float
        Kinetic energy gained, measured from the states: v+' M v+ / 2 - v-' M v- / 2 less the work of the forces
        within the step, summed over a stretch [J].
    forks : Forks or None
        The outcomes of an impact where (12) fails; None elsewhere and after the horizon.
    """

    time: float
    until: float
    constraints: tuple[str, ...]
    restitution: Array
    impact: bool
    condition_12: bool
    independent: bool
    energy_change: float
    forks: Forks | None
    _cosines: csr_array = field(repr=False)

    @property
    def angles(self) -> Array:
        """Kinetic angles between the gradients, shape (k, k) [rad]; in a stretch, where (12) is met worst."""
        cosines = self._cosines.toarray()
        np.fill_diagonal(cosines, 1.0)
        return np.arccos(cosines)


@dataclass(frozen=True)
class Diagnosis:
    """What of a run may be trusted.

    Attributes
    ----------
    instants : tuple of Instant
        Every instant with several active constraints, in order.
    horizon : float
        First time at which outcomes of one impact differ by more than the tolerance [s]; inf if none does.
    tolerance : float
        Largest cosine that counts as a right angle, and largest spread of outcomes relative to the jump that counts
        as none.
    variation : float
        Total variation of the velocity, sum of |v_i - v_{i-1}| (Lemma 3.4) [m/s, rad/s].
    largest_percussion : float
        Largest percussion of an impact (Lemma 3.3) [N s, N m s].
    energy_excess : float
        Largest excess of the kinetic energy over its value at the start, the work of the forces and the part of a
        changing M: at most rounding where the energy estimate holds (before Proposition 3.1) [J].
    vanishing : tuple of str
        Constraints whose gradient vanished while they were active, against assumption (H3): nothing holds those.
    unseen : bool
        Whether states between the recorded ones could not be brought back: the run was thinned and comes from a file.
    """

    instants: tuple[Instant, ...]
    horizon: float
    tolerance: float
    variation: float
    largest_percussion: float
    energy_excess: float
    vanishing: tuple[str, ...]
    unseen: bool

    def __str__(self) -> str:
        return self.report()

    def report(self) -> str:
        """Return in words what may be trusted, then the instants as a table, impacts first."""
        lines = [self._verdict()]
        if self.unseen:
            lines.append("The file keeps only some of the steps: instants between them were not looked at.")
        if self.vanishing:
            names = ", ".join(self.vanishing[:_MOST_NAMES])
            lines.append(
                f"(H3) fails: the gradient of {names} vanishes where it is active, and nothing holds it there."
            )
        if not self.instants:
            lines.append("Never were several constraints active at once.")
        else:
            dependence = _failing("condition (12), for a run to depend continuously on data,", self, "condition_12")
            independence = _failing("the independence of active gradients (H4)", self, "independent")
            several = _count(len(self.instants), "instant or stretch", "instants and stretches")
            lines.append(f"Several constraints were active at {several}; {dependence}; {independence}.")
        lines.append(
            f"Total variation of the velocity {self.variation:.6g}, largest percussion {self.largest_percussion:.6g}, "
            f"energy above its estimate {self.energy_excess:.2g} J."
        )
        return "\n".join(lines + self._table())

    def _verdict(self) -> str:
        asked = [(i.time, i.forks) for i in self.instants if i.forks is not None]
        if np.isfinite(self.horizon):
            return (
                f"Beyond t = {self.horizon:.6g} s this run is one of several answers: there arbitrarily small changes "
                f"of the data lead to velocities {asked[-1][1].spread:.3g} J^(1/2) apart in the kinetic norm."
            )
        cut = [(time, forks.reason) for time, forks in asked if not forks.complete]
        if cut:
            return (
                f"No impact was found to have several outcomes, but at {_count(len(cut), 'impact', 'impacts')}, first "
                f"at t = {cut[0][0]:.6g} s, {cut[0][1]}."
            )
        return "No impact has several outcomes: nothing in this run depends on the order of simultaneous impacts."

    def _table(self) -> list[str]:
        if not self.instants:
            return []
        chosen = sorted(self.instants, key=lambda i: (i.condition_12, not i.impact, i.time))[:_MOST_ROWS]
        lines = [
            f"{'time [s]':>19}  {'(12)':>5}  {'(H4)':>5}  {'angles [deg]':>14}  {'dE [J]':>10}  active constraints"
        ]
        for i in sorted(chosen, key=lambda i: i.time):
            when = f"{i.time:.4f}" + (f" - {i.until:.4f}" if i.until > i.time else "")
            pairs = np.degrees(i.angles[np.triu_indices(len(i.constraints), 1)])
            angles = f"{pairs.min():.1f} - {pairs.max():.1f}" if np.ptp(pairs) > 0.05 else f"{pairs[0]:.1f}"
            names = ", ".join(i.constraints[:_MOST_NAMES])
            names += f" and {len(i.constraints) - _MOST_NAMES} more" if len(i.constraints) > _MOST_NAMES else ""
            verdicts = ["holds" if holds else "fails" for holds in (i.condition_12, i.independent)]
            lines.append(f"{when:>19}  {verdicts[0]}  {verdicts[1]}  {angles:>14}  {i.energy_change:10.3g}  {names}")
        left = len(self.instants) - len(chosen)
        return lines + ([f"and {left} more"] if left else [])


class _State(NamedTuple):
    """A state of a run, the velocity before it, and the step that led there."""

    t: float
    q: Array
    before: Array
    v: Array
    h: float


def diagnose(run: Trajectory, tolerance: float = 1e-3) -> Diagnosis:
    """Return what of a run may be trusted; see `Trajectory.diagnosis`."""
    if run.problem is None:
        raise InputError("this run carries no problem to look at; simulate it again, or build its problem by a Scene")
    if not (isinstance(tolerance, (int, float)) and 0.0 < tolerance < 1.0):
        raise InputError(f"tolerance must lie between 0 and 1; got {tolerance!r}")
    problem, system = run.problem, run.problem.system
    struck = np.array([impact.time for impact in run.impacts])
    found = _Instants(problem, tolerance)
    variation = energy = excess = 0.0
    vanishing: dict[str, None] = {}
    for state in _states(run):
        t, q, before, v, h = state
        metric = system.metric(q)
        variation += float(np.linalg.norm(v - before))
        change = 0.5 * float((v - before) @ metric.apply(v + before))
        # the work of the forces within the step is no impact's doing
        gained = change - 0.5 * h * float(system.force(t, q, before) @ (v + before))
        energy += gained
        excess = max(excess, energy)
        active = problem.constraints.active(t, q, problem.tolerance)
        lost = np.linalg.norm(active.jacobian, axis=1) < _VANISHING
        vanishing |= dict.fromkeys(map(problem.constraints.name, active.constraint[lost].tolist()))
        if len(active.gap) > 1:
            k = int(np.searchsorted(struck, t - 0.5 * run.step))
            found.add(state, active, metric, gained, k < len(struck) and struck[k] < t + 0.5 * run.step)
        else:
            found.end()
    found.end()
    return Diagnosis(
        tuple(found.instants),
        found.horizon,
        tolerance,
        variation,
        max((float(i.percussion.max()) for i in run.impacts), default=0.0),
        excess,
        tuple(vanishing),
        run._scheme is None and bool((np.diff(run.t) > 1.5 * run.step).any()),
    )


def _states(run: Trajectory) -> Iterator[_State]:
    """Yield every state of a run; those a thinned run did not record are stepped to again from the last recorded."""
    assert run.problem is not None
    problem, projector = run.problem, Projector()
    if hasattr(problem.system, "start"):
        problem.system.start()
    yield _State(float(run.t[0]), run.q[0], problem.v0, run.v[0], 0.0)
    for i in range(1, len(run.t)):
        t, q, v, end = float(run.t[i - 1]), run.q[i - 1], run.v[i - 1], float(run.t[i])
        while run._scheme is not None and end - t > 1.5 * run.step:
            step = run._scheme.step(problem, t, q, v, run.step, projector)
            yield _State(step.t, step.q, v, step.v, run.step)
            t, q, v = step.t, step.q, step.v
        yield _State(end, run.q[i], v, run.v[i], end - t)


class _Instants:
    """Collects instants; those in a row with the same rows and no impact become one."""

    def __init__(self, problem: Problem, tolerance: float) -> None:
        self._problem, self._tolerance = problem, tolerance
        self.instants: list[Instant] = []
        self.horizon = np.inf
        # the stretch that goes on: the rows, the instant so far, how far from (12) it was at its worst
        self._stretch: tuple[bytes, Instant, float] | None = None

    def end(self) -> None:
        """Let the stretch end."""
        if self._stretch is not None:
            self.instants.append(self._stretch[1])
            self._stretch = None

    def add(self, state: _State, active: Rows, metric: Metric, gained: float, impact: bool) -> None:
        """Take an instant with several active rows."""
        columns, _ = unit_gradients(metric, active.jacobian)
        cosines, e = cosines_between(columns), active.restitution
        worst = float(against_condition_12(cosines, e, self._tolerance).max())
        found = None
        if impact and worst and not np.isfinite(self.horizon):
            found = follow(metric, active.jacobian, state.before, e, _MOST_IMPACTS)
            jump = state.v - state.before
            if found.spread > self._tolerance * np.sqrt(jump @ metric.apply(jump)):
                self.horizon = state.t
        names = tuple(map(self._problem.constraints.name, active.constraint.tolist()))
        free = independent(columns, cosines, _DEPENDENT)
        new = Instant(state.t, state.t, names, e, impact, not worst, free, gained, found, csr_array(cosines))
        if impact:
            self.end()
            self.instants.append(new)
            return
        rows, so_far = active.constraint.tobytes(), self._stretch
        if so_far is None or so_far[0] != rows:
            self.end()
            self._stretch = rows, new, worst
        else:
            self._stretch = rows, _joined(so_far[1], new, worst > so_far[2]), max(worst, so_far[2])


def _joined(first: Instant, second: Instant, worse: bool) -> Instant:
    return Instant(
        first.time,
        second.until,
        first.constraints,
        first.restitution,
        False,
        first.condition_12 and second.condition_12,
        first.independent and second.independent,
        first.energy_change + second.energy_change,
        None,
        (second if worse else first)._cosines,
    )


def _failing(what: str, of: Diagnosis, holds: str) -> str:
    bad = [i for i in of.instants if not getattr(i, holds)]
    return f"{what} fails at {len(bad)} of them, first at t = {bad[0].time:.6g} s" if bad else f"{what} holds"


def _count(n: int, one: str, many: str) -> str:
    return f"{n} {one if n == 1 else many}"
