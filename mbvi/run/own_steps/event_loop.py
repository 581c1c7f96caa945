"""Runs `EventDriven`: records its smooth steps with their dense output, and the impacts between them."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from ...arguments import listed
from ...problem import Problem
from ...projection import Projector
from ...results.contacts import ContactLog
from ...results.run_data import Array, Impact, RunRecord
from ...results.trajectory import Trajectory
from ...scene.connected.switched import switched
from ...schemes import EventDriven, Step
from ...schemes.contact_friction import ContactFriction, regime
from ...schemes.event_driven.impact_event import ImpactEvent
from ...schemes.event_driven.integrator import EventDrivenIntegrator
from ...schemes.event_driven.reactions import reactions
from ...schemes.event_driven.runge_kutta import DEGREE, RungeKuttaStep
from ...schemes.observer import Contacts, contacts_of_step
from ...schemes.step import NO_RATES
from ..fixed_steps.switching import Switches, Switching, connected_at
from ..start import closes_none
from .located import LocatedSwitches
from .recorded import recorded

# contacts that a note names
_MOST_NAMED = 3
# exponents of the dense output


class _EventRecorder:
    """States, dense output and impacts of a run of `EventDriven`.

    An impact has two states, before and after the jump of v. One smooth step in `every` is recorded, and in any case
    the last one and those that end at impacts.
    """

    # the timing that files and energies use
    timing = EventDriven.timing

    def __init__(self, problem: Problem, every: int, notes: Sequence[str], contacts: ContactLog | None = None) -> None:
        self._first_problem = self._problem = problem
        self._every, self._made = every, Switches(problem)
        self.switches = self._made.made
        self.contacts = contacts
        if contacts is not None:
            contacts.close()
        self.t, self.q, self.v = [problem.t0], [problem.q0], [problem.v0]
        self.dense: list[Array] = []
        self.penetration, self.limit_violation, self.residual = [0.0], [0.0], [0.0]
        self.impacts: list[Impact] = []
        self.notes = list(notes)
        self._no_motion = np.zeros((2, problem.system.nv, DEGREE))
        # since the last recorded state: the number of steps, the largest residual, the greatest depths of contacts and
        # limits, the first step, and the last step with the state after it (t, q, v)
        self._since, self._worst, self._deepest = 0, 0.0, np.zeros(2)
        self._first: RungeKuttaStep | None = None
        self._last: tuple[RungeKuttaStep, float, Array, Array] | None = None

    def name(self, constraint: int) -> str:
        """Return the name of a constraint."""
        return self._made.name(constraint)

    @property
    def count(self) -> int:
        """Number of recorded states."""
        return len(self.t)

    def add_step(self, step: RungeKuttaStep, integrator: EventDrivenIntegrator) -> None:
        """Add a step and the state after it, from which the drift of closed contacts is removed."""
        self._since += 1
        self._first = self._first or step
        if self.contacts is not None:
            for rows in reactions(integrator, step):
                self.contacts.add(*rows)
        self._last = step, integrator.t, integrator.q, integrator.v
        self._worst = max(self._worst, integrator.residual)
        self._deepest = np.maximum(self._deepest, integrator.depth)
        if self._since >= self._every:
            self.record_state()

    def record_state(self) -> None:
        """Record the state after the last step, if it is not recorded yet."""
        if self._last is None or self._first is None:
            return
        step, t, q, v = self._last
        dense = step.dense if self._since == 1 else self._joined(self._first, step, t, q, v)
        self._append_state(t, q, v, self._deepest, dense)

    def _joined(self, first: RungeKuttaStep, last: RungeKuttaStep, t: float, q: Array, v: Array) -> Array:
        """Return cubics from the last recorded state to (q, v) at t, with the rates at both ends."""
        system, h, v0 = self._problem.system, t - self.t[-1], self.v[-1]
        if h <= 0.0:
            return self._no_motion
        displacement = system.difference(self.q[-1], q)
        ends = np.array(
            [[v0, system.chart_rate(self.q[-1], displacement, v)], [first.acceleration(0.0), last.acceleration(1.0)]]
        )
        mean = np.array([displacement, v - v0]) / h
        start, end = ends[:, 0], ends[:, 1]
        dense = np.zeros_like(self._no_motion)
        dense[:, :, :3] = np.stack([start, 3 * mean - 2 * start - end, start + end - 2 * mean], axis=2)
        return dense

    def add_impact(self, event: ImpactEvent, integrator: EventDrivenIntegrator) -> None:
        """Record an impact and the states before and after it."""
        self.record_state()
        self._worst = integrator.residual
        self._append_state(event.t, event.q, event.after, integrator.depth, self._no_motion)
        percussion, before, after = event.rates
        taking_part = percussion > 0.0
        metric, friction = self._problem.system.metric(event.q), event.friction
        jump, mean = event.after - event.before, event.after + event.before
        names = map(self._problem.constraints.name, event.number[taking_part].tolist())
        self.impacts.append(
            Impact(
                event.t,
                tuple(names),
                percussion[taking_part],
                before[taking_part],
                after[taking_part],
                event.point[taking_part],
                event.normal[taking_part],
                0.5 * float(jump @ metric.apply(mean)),
                *(() if friction is None else _of_impact(friction, percussion, event.restitution, taking_part)),
            )
        )

    def switched(self, problem: Problem, connections: dict[str, bool]) -> None:
        """Go on with a problem whose connections were switched at the last recorded state."""
        before = Step(self.t[-1], self.q[-1], self.v[-1], problem.constraints.empty, NO_RATES, 0.0)
        offset, impacts = self._made.add(problem, connections, before, problem.v0, self.notes)
        self.impacts += impacts
        if self.contacts is not None:
            self.contacts.offset = offset
        self._problem, self.v[-1] = problem, problem.v0

    def _append_state(self, t: float, q: Array, v: Array, depth: Array, dense: Array) -> None:
        """Append a state and the dense output that leads to it."""
        if self.contacts is not None:
            self.contacts.close()
        self.dense.append(dense)
        self.t.append(t)
        self.q.append(q)
        self.v.append(v)
        contacts, limits = depth.tolist()
        self.penetration.append(contacts)
        self.limit_violation.append(limits)
        self.residual.append(self._worst)
        self._since, self._worst, self._deepest, self._first, self._last = 0, 0.0, np.zeros(2), None, None

    def trajectory(self, scheme: EventDriven, *, complete: bool) -> Trajectory:
        """Return the run recorded so far."""
        # an interrupt may have left these lists at different lengths
        n = min(len(self.t), len(self.q), len(self.v), len(self.limit_violation), len(self.residual))
        return Trajectory(
            np.array(self.t[:n]),
            np.array(self.q[:n]),
            np.array(self.v[:n]),
            tuple(self.impacts),
            np.array(self.residual[:n]),
            scheme.name,
            0.0,
            tuple(self.notes),
            self._first_problem,
            complete,
            RunRecord(
                np.array(self.penetration[:n]),
                scheme,
                self.timing,
                np.array(self.dense[: n - 1]).reshape(-1, 2, self._problem.system.nv, DEGREE),
                contacts=None if self.contacts is None else self.contacts.table(self.name, n),
                limit_violation=np.array(self.limit_violation[:n]),
                switches=tuple(self.switches),
            ),
        )


def run_event_driven(
    problem: Problem,
    scheme: EventDriven,
    duration: float,
    every: int,
    projector: Projector,
    notes: Sequence[str],
    out: str | os.PathLike[str] | None,
    progress: bool | None,
    contacts: bool = False,
    watch: Callable[[RungeKuttaStep | ImpactEvent, EventDrivenIntegrator], None] | None = None,
    switching: Switching | None = None,
    projector_for: Callable[[Problem], Projector] | None = None,
) -> Trajectory:
    """Run a problem with `EventDriven`; see `simulate`.

    `watch` is called after each smooth step and impact. Where connections are switched, by `switching`, the run goes on
    with another problem and the projector for it.
    """
    # a contact that stays closed is one contact, however far it slides
    problem.constraints.renew()
    log = ContactLog(np.inf, frictional=problem.constraints.frictional) if contacts else None
    record = _EventRecorder(problem, every, notes, log)
    so_far, end = partial(record.trajectory, scheme, complete=False), problem.t0 + duration
    switches = None if switching is None else LocatedSwitches(switching, problem.t0, duration)
    fallbacks, at_fallbacks = np.zeros(2, np.int64), set[str]()
    with recorded(problem, scheme, duration, record, so_far, out, progress) as poll:
        now = problem
        if switches is not None:
            switches.begin(now.t0, now.q0, now.v0)
            # an impact at the start comes first
            if closes_none(now.constraints.active(now.t0, now.q0, now.tolerance), now.v0):
                switches.at(now.t0, now.q0, now.v0, tuple)
        while True:
            connections = {} if switches is None else switches.take()
            if connections:
                assert switches is not None and projector_for is not None
                t, q, v = record.t[-1], record.q[-1], record.v[-1]
                now = connected_at(
                    switched(now, t, q, connections), t, q, v, scheme, attached=any(connections.values())
                )
                now.constraints.renew()
                projector = projector_for(now)
                record.switched(now, connections)
                switches.begin(t, now.q0, now.v0)
            integrator = scheme.integrator(now, projector, None if switches is None else partial(_stop, switches, now))
            for part in integrator.run(end - now.t0):
                if isinstance(part, ImpactEvent):
                    record.add_impact(part, integrator)
                else:
                    record.add_step(part, integrator)
                if watch is not None:
                    watch(part, integrator)
                poll(integrator.t)
                if switches is not None and (switches.found or _switches_after(switches, part, integrator)):
                    break
            record.record_state()
            fallbacks += integrator.fallbacks, integrator.undetermined
            at_fallbacks.update(map(now.constraints.name, integrator.at_fallbacks))
            if switches is None or switches.found is None:
                break
        record.t[-1] = end
        record.notes += _fallback_notes(int(fallbacks[0]), int(fallbacks[1]), sorted(at_fallbacks))
    return record.trajectory(scheme, complete=True)


def _stop(switches: LocatedSwitches, problem: Problem, step: RungeKuttaStep, contacts: Contacts) -> float | None:
    """Return the time within a smooth step at which connections are switched, None if none are."""

    def at(t: float) -> tuple[Array, Array]:
        return step.at(problem.system, (t - step.t) / step.h)

    return switches.along(step.t, step.t + step.h, at, contacts)


def _switches_after(
    switches: LocatedSwitches, part: RungeKuttaStep | ImpactEvent, integrator: EventDrivenIntegrator
) -> bool:
    """Return whether connections are switched after an impact, or a step of `Paoli`."""
    if isinstance(part, ImpactEvent):
        return switches.at(part.t, part.q, part.after, integrator.observed.of_impact(part))
    # an impact at the end of a step of `Paoli` follows it
    if integrator.fallback is None or integrator.v is not integrator.fallback.v or not part.h > 0.0:
        return False
    name = integrator.problem.constraints.name
    contacts = partial(contacts_of_step, integrator.fallback, part.h, name)
    return switches.at(integrator.t, integrator.q, integrator.v, contacts)


def _of_impact(friction: ContactFriction, percussion: Array, e: Array | None, taking_part: Array) -> tuple[Any, ...]:
    """Return the last six fields of an `Impact`."""
    tangential, before, after, sticks, angular = friction.take(taking_part)
    regimes = tuple(map(regime, sticks.tolist(), percussion[taking_part].tolist()))
    return tangential, before, after, regimes, None if e is None else e[taking_part], angular


def _fallback_notes(fallbacks: int, undetermined: int, names: list[str]) -> list[str]:
    """Return the note on steps of `Paoli`, if there were any; `undetermined` of them were taken because of friction.

    `names` are those of the constraints that were active then.
    """
    if not fallbacks:
        return []
    friction = (
        f"; {undetermined} of them because friction leaves accelerations open, of contacts that depend on each other "
        "or in Painlevé's configuration"
    )
    where = f"; contacts: {listed(names, _MOST_NAMED)}" if names else ""
    return [
        f"{fallbacks} steps of 1e-4 s were taken by the paper's scheme, of order one: where gradients jump, or events "
        f"follow each other without end, the tolerance is not kept{friction if undetermined else ''}{where}"
    ]
