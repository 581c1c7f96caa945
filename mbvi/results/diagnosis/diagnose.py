"""Computes the diagnosis of a run from its states and the instants with several active constraints."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np
from scipy.sparse import csr_array

from ...arguments import shown, watched
from ...constraints.rows import take
from ...errors import InputError, ProjectionError
from ...impacts import Forks, condition_12_violation, cosines_between, follow, independent, unit_gradients
from ...projection import Projector
from ...schemes.observer import observer
from ..run_data import Impact, RunData, legs
from .active_rows import ActiveRows, rows_of_impacts, with_full_gradients
from .dead_centres import dead_centres
from .diagnosis import Array, Diagnosis, Instant
from .energies import energy_of_projection
from .error_growth import error_growth
from .frictional_orders import orders_with_friction
from .jumps import Jump, Jumps

if TYPE_CHECKING:
    from ...constraints import Rows
    from ...problem import Problem
    from ...projection import Metric
    from ...schemes import Scheme, Step

# most single impacts followed at one instant
_MOST_IMPACTS = 2_000
# a gradient depends on others if the sine of its angle to their span is below this
_DEPENDENT = 1e-6
# differences of times, in steps, and of velocities, relative to the speed, that count as zero
_INSTANT, _ROUNDING = 1e-6, 1e-10
# energies relative to the sum of percussions times speeds that count as zero
_ENERGY_ROUNDING = 1e-9
# most constraints in one impact of a run that is diagnosed without being asked
_MOST_AT_ONCE = 32
# length below which a gradient counts as zero
_VANISHING = 1e-12


class State(NamedTuple):
    """A state of a run, the velocity before it, and the step that led there.

    `step` is None, and q the state's own, where the law acts at the end of a step; else q is where it acted. `again`
    takes the step once more; None where that is not known.
    """

    t: float
    q: Array
    before: Array
    v: Array
    h: float
    step: Step | None = None
    again: Callable[[], Step | None] | None = None


def diagnose(run: RunData, tolerance: float = 1e-3) -> Diagnosis:
    """Return the diagnosis of a run; see `Trajectory.diagnosis`."""
    if run.problem is None:
        raise InputError("this run carries no problem to look at; simulate it again, or build its problem by a Scene")
    if not (isinstance(tolerance, (int, float)) and 0.0 < tolerance < 1.0):
        raise InputError(f"tolerance must lie between 0 and 1; got {tolerance!r}")
    found, sums, jumps, centres = _Instants(tolerance), _Sums(run.lacks_functions), list[Jump](), set[float]()
    for number, (first, leg) in enumerate(legs(run)):
        assert leg.problem is not None
        if number:
            sums.add_attaching(leg.problem, run.record.switches[number - 1].before)
        jumps += _look_at(leg, found, sums)
        dense = run.record.dense
        centres |= set(dead_centres(leg, None if dense is None else dense[first : first + len(leg.t) - 1]))
    unseen = run.step > 0.0 and _stepping_scheme(run) is None and bool((np.diff(run.t) > 1.5 * run.step).any())
    return Diagnosis(
        tuple(found.instants),
        np.nan if (unseen or found.not_followed) and np.isinf(found.horizon) else found.horizon,
        tolerance,
        sums.variation,
        max((float(i.percussion.max()) for i in run.impacts), default=0.0),
        sums.excess,
        tuple(sums.vanishing),
        unseen,
        found.not_followed,
        tuple((impact.time, impact.energy_change) for impact in run.impacts if _gains_by_friction(impact)),
        tuple(jumps),
        sums.raised,
        tuple(sorted(centres)),
        tuple(one.time for one in run.record.switches),
        run.problem.not_kept,
        error_growth(run),
    )


def _look_at(run: RunData, found: _Instants, sums: _Sums) -> list[Jump]:
    """Add the states of a run without switches to what is found, and return its jumps."""
    assert run.problem is not None
    problem, system = run.problem, run.problem.system
    struck = np.array([impact.time for impact in run.impacts])
    jumps, rows, struck_rows = Jumps(problem), ActiveRows(problem), rows_of_impacts(run, problem)
    found.problem = problem
    for number, state in enumerate(states(run)):
        t, q, before, v, h, step, again = state
        metric = system.metric(q)
        # with torsional and rolling friction a second solution is not looked for
        if again is not None and problem.constraints.frictional and problem.constraints.resistance is None:
            jumps.add(t, before, v, metric, h * system.force(t, q, before), (1.0 - run.record.timing.jump) * h, again)
        change, twice = v - before, v + before
        sums.variation += math.sqrt(change.dot(change))
        if step is not None:
            rest = (1.0 - run.record.timing.jump) * h
            sums.raised += energy_of_projection(problem, t, q, step.q, step.v, rest)
            gained = 0.5 * float(step.percussion @ (step.before + step.after))
            lengths = problem.constraints.levers(step.active.constraint) * step.active.gap
            # rows near enough to close within the step join the law; those that stay open are no contacts
            active = with_full_gradients(take(step.active, (step.percussion > 0.0) | (lengths <= problem.tolerance)))
            if step.slip is not None:
                gained += 0.5 * float(np.vdot(step.slip[0], step.slip[2] + step.slip[3]))
        else:
            # the same by the balance of percussions, less the work of the forces within the step
            gained = 0.5 * float(change @ metric.apply(twice))
            if run.step > 0.0:
                gained -= 0.5 * h * float(system.force(t, q, before) @ twice)
            elif h > 0.0:
                # located impacts take no time: between two states there are none
                gained = 0.0
            # the law at the start is that of every scheme
            active = (struck_rows if number and h == 0.0 else rows).at(t, q)
            if active.rate is not None:
                percussions = metric.apply(change) - h * system.force(t, q, before)
                gained += float(np.linalg.lstsq(active.jacobian.T, percussions)[0] @ active.rate)
        gained = sums.add_energy(gained)
        if len(active.gap):
            lost = np.linalg.norm(active.jacobian, axis=1) < _VANISHING
            sums.vanishing |= dict.fromkeys(map(problem.constraints.name, active.constraint[lost].tolist()))
        if len(active.gap) > 1:
            k = int(np.searchsorted(struck, t - _INSTANT * run.step))
            impact = k < len(struck) and bool(struck[k] <= t + _INSTANT * run.step)
            found.add(state, active, metric, gained, impact and (run.step > 0.0 or h == 0.0))
        else:
            found.end()
    found.end()
    return jumps.found


class _Sums:
    """What a diagnosis adds up over the states of a run; energies are not known where functions are lost."""

    def __init__(self, unknown: bool) -> None:
        self._unknown, self._energy = unknown, 0.0
        self.variation = self.raised = 0.0
        self.excess = np.nan if unknown else 0.0
        self.vanishing: dict[str, None] = {}

    def add_energy(self, gained: float) -> float:
        """Add an energy and return it, as far as it is known."""
        if self._unknown:
            return np.nan
        self._energy += gained
        self.excess = max(self.excess, self._energy)
        return gained

    def add_attaching(self, problem: Problem, before: Array) -> None:
        """Add the jump from a velocity to the initial one of a problem, in which other connections are on."""
        system, q, v = problem.system, problem.q0, problem.v0
        self.variation += float(np.linalg.norm(v - before))
        self.add_energy(system.kinetic_energy(q, v) - system.kinetic_energy(q, before))


def given_or_computed(run: RunData, diagnosis: Diagnosis | None) -> tuple[Diagnosis | None, str]:
    """Return a diagnosis for plots and pages, or None and why there is none: many constraints at once cost too much."""
    if diagnosis is not None:
        if not isinstance(diagnosis, Diagnosis):
            raise InputError(f"diagnosis must be what run.diagnosis() returned; got {shown(diagnosis)}")
        return diagnosis, ""
    if run.problem is None:
        return None, "the file of this run could not bring its problem back"
    most = max((len(impact.constraints) for impact in run.impacts), default=0)
    if most > _MOST_AT_ONCE:
        return None, f"{most} constraints take part in one impact; give diagnosis=run.diagnosis(), which may take long"
    return diagnose(run), ""


def _gains_by_friction(impact: Impact) -> bool:
    """Return whether an impact with friction raised the kinetic energy beyond rounding."""
    if impact.regime is None:
        return False
    scale = impact.percussion @ (np.abs(impact.before) + np.abs(impact.after))
    return bool(impact.energy_change > _ENERGY_ROUNDING * scale)


def _stepping_scheme(run: RunData) -> Scheme | None:
    """Return the scheme that can take the steps of a run again, None where there is none."""
    if run.step <= 0.0 or run.record.scheme is None or run.lacks_functions:
        return None
    return cast("Scheme", run.record.scheme)


def states(run: RunData) -> Iterator[State]:
    """Yield every state of a run; states that a thinned run did not record are computed again from the last recorded.

    So is every state of a scheme that applies the law within its steps or projects positions. Where a file names an
    unknown scheme, the law is taken to act where the velocity jumps, on the rows that are active there. Until the last
    state has been taken the inputs and torques of the run act.
    """
    with run.record.as_set():
        yield from _states(run)


def _states(run: RunData) -> Iterator[State]:
    assert run.problem is not None
    problem, timing, scheme = run.problem, run.record.timing, _stepping_scheme(run)
    # Coulomb's law for many contacts is solved as exactly as in the run
    projector = Projector(friction_residual=max(1e-6, float(np.max(run.residual, initial=0.0))))
    # a control may look at the contacts of the step before, and only that step gives them
    observe = observer(problem)
    # only the step separates the work of moving walls and of projected positions from that of the impact
    again = scheme is not None and (
        timing.jump < 1.0 or scheme.project_positions or problem.constraints.moving or observe is not None
    )
    problem.system.start()
    yield State(float(run.t[0]), run.q[0], problem.v0, run.v[0], 0.0)
    for i in watched(range(1, len(run.t)), "diagnosis"):
        t, q, v, end = float(run.t[i - 1]), run.q[i - 1], run.v[i - 1], float(run.t[i])
        while scheme is not None and end - t > (1.0 + _INSTANT) * run.step:
            step = scheme.step(problem, t, q, v, run.step, projector)
            acted = timing.place_of_law(problem.system, q, v, run.step) if again else step.q
            yield State(step.t, acted, v, step.v, run.step, step if again else None, partial(_as_it_is, step))
            if observe is not None:
                observe(step, run.step)
            t, q, v = step.t, step.q, step.v
        h = end - t
        acted = timing.place_of_law(problem.system, q, v, h) if timing.jump < 1.0 or again else run.q[i]
        take = None if scheme is None else partial(_taken, scheme, problem, t, q, v, h, projector)
        last = take() if again and take is not None else None
        yield State(end, acted, v, run.v[i], h, last, take if last is None else partial(_as_it_is, last))
        if observe is not None and last is not None:
            observe(last, h)


def _as_it_is(step: Step) -> Step:
    return step


def _taken(scheme: Scheme, *arguments: Any) -> Step | None:
    """Return a step, None if it cannot be solved: the run has then retaken it in parts, which its notes say."""
    try:
        return scheme.step(*arguments)
    except ProjectionError:
        return None


class _Instants:
    """Collects instants of a `problem`; consecutive ones with the same rows and no impact become one stretch."""

    problem: Problem

    def __init__(self, tolerance: float) -> None:
        self._tolerance = tolerance
        self.instants: list[Instant] = []
        self.horizon, self.not_followed = np.inf, 0
        # the present stretch: its rows, its instant so far, its largest violation of (12)
        self._stretch: tuple[bytes, Instant, float] | None = None

    def end(self) -> None:
        """End the present stretch."""
        if self._stretch is not None:
            self.instants.append(self._stretch[1])
            self._stretch = None

    def add(self, state: State, active: Rows, metric: Metric, gained: float, impact: bool) -> None:
        """Add an instant with several active rows."""
        columns, _ = unit_gradients(metric, active.jacobian)
        cosines, e = cosines_between(columns), active.restitution
        worst = float(condition_12_violation(cosines, e, self._tolerance).max())
        found, frictional = None, active.tangents is not None and bool(active.tangents.friction.any())
        if impact and frictional:
            found = None if np.isfinite(self.horizon) else orders_with_friction(metric, active, state.before)
            if found is not None and not self._is_fork(found, state, metric):
                found = None
            self.not_followed += found is None
        elif impact and worst and not np.isfinite(self.horizon):
            before = state.before
            if active.rate is not None:
                # relative to moving walls, in the sense of least squares where they move apart
                before = before + np.linalg.lstsq(active.jacobian, active.rate)[0]
            found = follow(metric, active.jacobian, before, e, _MOST_IMPACTS)
            self._is_fork(found, state, metric)
        names = tuple(map(self.problem.constraints.name, active.constraint.tolist()))
        free = independent(columns, cosines, _DEPENDENT)
        free_slip = not frictional or _independent_tangents(metric, active)
        kept = csr_array(cosines)
        new = Instant(state.t, state.t, names, e, impact, not worst, free, gained, found, kept, free_slip)
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

    def _is_fork(self, found: Forks, state: State, metric: Metric) -> bool:
        """Return whether outcomes of an impact differ, which is then the horizon."""
        moved, speed = (np.sqrt(w @ metric.apply(w)) for w in (state.v - state.before, state.before))
        # a spread of outcomes within rounding is no fork
        differ = bool(found.spread > max(self._tolerance * moved, _ROUNDING * speed))
        self.horizon = state.t if differ else self.horizon
        return differ


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
        first.friction_independent and second.friction_independent,
    )


def _independent_tangents(metric: Metric, active: Rows) -> bool:
    """Return whether gradients, and tangents where there is friction, are linearly independent."""
    tangents = active.tangents
    assert tangents is not None
    tangents = tangents.sliding()
    rows = np.concatenate([active.jacobian, tangents.jacobian[np.repeat(tangents.friction > 0.0, 2)]])
    columns, _ = unit_gradients(metric, rows)
    return independent(columns, cosines_between(columns), _DEPENDENT)
