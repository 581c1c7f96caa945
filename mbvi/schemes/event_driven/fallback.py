"""Steps of `Paoli` where the event-driven integrator cannot go on: gradients that jump, events without end."""

from __future__ import annotations

from collections.abc import Generator, Iterator

import numpy as np

from ...constraints.rows import match_contacts, take
from ...errors import ProjectionError
from ...projection.positions.travel import MOST_LINEARISATIONS
from ...system.system import Array
from ..contact_friction import friction_of
from ..paoli import Paoli
from ..step import Step, closes, still_rates
from .contact_changes import change_contacts, touching_rows
from .friction.changes import strike
from .impact_event import ImpactEvent
from .motion_state import NO_ROWS, MotionState, certain_rates
from .rows.few_rows import few_rows
from .runge_kutta import DEGREE, RungeKuttaStep

# length of a step [s], and the number of steps after which the smooth motion is tried again
STEP, _MOST_STEPS = 1e-4, 50
# the smooth motion continues after an impact if contacts with jumping gradients then stay open for this time [s]
_OPEN_TIME = 1e-3
# a contact whose percussion is no more than so many times that in the step before bears load, as in runs of fixed steps
_AS_BEFORE = 2.0
# time between two steps of `Paoli` in which the smooth motion was tried, in lengths of a step
_SOON = 1e-2


def bounce(state: MotionState) -> Generator[RungeKuttaStep | ImpactEvent, None, bool]:
    """Apply the law (8) where a gradient jumps; return whether such contacts then stay open for `_OPEN_TIME`."""
    q, v = state.q, state.v
    active = state.problem.constraints.active(state.t, q, state.problem.tolerance)
    number, _, J, *_ = active
    before = J @ v
    if (before < -certain_rates(J, v, state.slow_constraints(number))).any():
        yield state.observed.impact(strike(state, active, state.system.metric(q)))
    pull = np.abs(J @ state.flow.acceleration(state.t, q, state.v, state.closed)[: len(v)])
    jumping = np.isin(number, state.rows.number[~state.rows.smooth])
    return bool((2.0 * (J @ state.v) > _OPEN_TIME * pull)[jumping].all())


def fall_back(state: MotionState, end: float) -> Iterator[RungeKuttaStep | ImpactEvent]:
    """Take steps of `Paoli` while contacts with jumping gradients are active, then remove their penetration."""
    jumping = np.unique(state.rows.number[~state.rows.smooth])
    for _ in range(_MOST_STEPS):
        h = min(STEP, end - state.t)
        if h <= 0.0:
            return
        state.fallbacks += 1
        active = yield from _paoli_step(state, h, end)
        at_jumps = active[np.isin(active, jumping)]
        state.at_fallbacks.update((at_jumps if len(at_jumps) else active).tolist())
        if not len(active if state.modes is not None else at_jumps):
            break
    state.depth = _move_out(state)
    if state.depth.any():
        yield _straight(state.t, 0.0, state.q, state.v, state.q)
    state.closing.forget()
    yield from change_contacts(state, touching_rows(state, NO_ROWS, NO_ROWS))


def _move_out(state: MotionState) -> Array:
    """Move the configuration out of penetration by the smallest displacement; return the greatest depths before."""
    rows, depth, still = state.rows, np.zeros(2), np.zeros(state.system.nv)
    for _ in range(MOST_LINEARISATIONS):
        gap = rows.gaps(state.t, state.q, rows.all)
        inside = np.flatnonzero(gap < 0.0)
        depth = np.maximum(depth, rows.depths(rows.all, gap))
        if (gap[inside] >= -rows.rounding[inside]).all():
            break
        inside = few_rows(rows, state.t, state.q, inside, NO_ROWS)
        J, metric = rows.gradients(state.t, state.q, inside), state.system.metric(state.q)
        try:
            out = state.projector.project(still, metric, J, -gap[inside]).velocity
        except ProjectionError:
            # bodies that are wedged in stay as they are
            break
        state.q = state.system.integrate(state.q, out)
    return depth


def _paoli_step(state: MotionState, h: float, end: float) -> Generator[RungeKuttaStep | ImpactEvent, None, Array]:
    """Take one step of `Paoli`; return which constraints were active."""
    q, v, last = state.q, state.v, state.last_fallback
    if last is not None and state.t - last.t > _SOON * STEP:
        last = None
    step = Paoli().step(state.problem, state.t, q, v, h, state.projector)
    straight = _straight(state.t, h, q, v, step.q)
    state.t = end if end - step.t < 1e-12 * max(1.0, abs(end)) else step.t
    state.q, state.residual = step.q, step.residual
    state.depth = state.problem.constraints.depths(step.active.constraint, step.active.gap)
    state.observed.step(step, h)
    percussion, state.strikes = step.percussion, _strikes(state, step, last)
    state.v = v if state.strikes else step.v
    state.fallback = state.last_fallback = step
    yield straight
    state.v = step.v
    if state.strikes:
        number, _, _, e, point, normal, *_ = take(step.active, percussion > 0.0)
        rates = step.rates[[0, 3, 2]][:, percussion > 0.0]
        friction = friction_of(step)
        more = () if friction is None else (friction.take(percussion > 0.0), e)
        yield state.observed.impact(ImpactEvent(state.t, step.q, v, step.v, number, rates, point, normal, *more))
    return step.active.constraint


def _strikes(state: MotionState, step: Step, last: Step | None) -> bool:
    """Return whether a step holds an impact; `last` is the step of `Paoli` just before it, None if there is none."""
    closing = closes(step.rates, still_rates(state.problem, step.active.constraint))
    if closing.any() and last is not None:
        # a contact that stays on a curved surface closes in each step, under its load
        owner = match_contacts(step.active, last.active)
        closing &= step.percussion > _AS_BEFORE * np.append(last.percussion, 0.0)[owner]
    return bool(closing.any())


def _straight(t: float, h: float, q0: Array, v: Array, q: Array) -> RungeKuttaStep:
    """Return a step from q0 to q at constant velocity."""
    dense, nothing = np.zeros((2, len(v), DEGREE)), np.zeros((2, len(v)))
    dense[0, :, 0] = v
    return RungeKuttaStep(t, h, q0, v, q, v, nothing[0], h * np.abs(v), nothing, nothing, dense)
