"""Turns a run of fixed steps into smooth steps and located impacts, along which variations are carried."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..errors import SensitivityError
from ..projection import Projector, impact
from ..results.run_data import Impact
from ..results.trajectory import Trajectory
from ..schemes import EventDriven
from ..schemes.event_driven.friction.modes import ContactModes
from ..schemes.event_driven.impact_event import ImpactEvent
from ..schemes.event_driven.motion_state import NO_ROWS, certain_rates
from ..schemes.event_driven.runge_kutta import DEGREE, RungeKuttaStep, least_percussion
from ..system.system import Array

# accelerations and jumps that the motion between two states does not explain, relative to the largest
_UNEXPLAINED = 0.3
_UNFOLLOWED = (
    "the step does not follow the contacts that are known here: impacts accumulate, or several at once depend on each "
    "other, or the step is too long"
)
# impacts are refused whose speed forces change within so many steps
_SLOW = 2.0
# rows that close within this part of a step close at once
_TOGETHER = 1e-6
# steps of Newton's method that find when a gap closes
_NEWTON = 4


class LocatedSteps:
    """The motion that a run of fixed steps approximates, in parts that end at impacts.

    Parameters
    ----------
    run : Trajectory
        A run with every step recorded.
    tolerance : float
        That with which `EventDriven` would follow the same contacts.

    Attributes
    ----------
    t, q, v, rows, closed, held, event_rows, touching, fallbacks
        As of `EventDrivenIntegrator`.

    Notes
    -----
    A step without an impact goes from one recorded state to the next. In a step with one, the gaps of the constraints
    that took part are followed from the state before, with its acceleration; where the first closes, the law (8) is
    applied, and the rest leads to the next recorded state. A contact that an impact of e = 0 closes stays closed as
    long as its force is positive. All of this is off by O(h).
    """

    def __init__(self, run: Trajectory, tolerance: float) -> None:
        assert run.problem is not None
        self._run, self.problem, self.fallbacks = run, run.problem, 0
        start = EventDriven(tolerance).integrator(run.problem, Projector())
        self.rows, self.touching, self._flow, self._units = start.rows, start.touching, start.flow, start.units
        self.t, self.q, self.v = float(run.t[0]), run.q[0], run.v[0]
        self.held = self.event_rows = NO_ROWS
        # of contacts with friction no variations are known along fixed steps
        self.modes: ContactModes | None = None
        gap = self.rows.gaps(self.t, self.q, self.rows.all)
        rate = self.rows.gradients(self.t, self.q, self.rows.all) @ self.v
        still = np.abs(rate) <= certain_rates(self.rows.gradients(self.t, self.q, self.rows.all), self.v, 1e-12)
        self.event_rows = np.flatnonzero(np.abs(gap) * self.rows.lever <= self.problem.tolerance)
        self.closed = self._pressed(np.intersect1d(self.event_rows, np.flatnonzero(still)), self.t, self.q, self.v)

    def parts(self) -> Iterator[tuple[RungeKuttaStep | ImpactEvent, bool]]:
        """Yield the parts in order, each with whether a recorded step ends there; attributes are those at its end."""
        run, impacts = self._run, list(self._run.impacts)
        if impacts and impacts[0].time <= run.t[0]:
            raise self._none("the run starts with an impact", impacts[0].constraints)
        for k in range(len(run.t) - 1):
            end, here = float(run.t[k + 1]), []
            while impacts and impacts[0].time <= end + 1e-9 * (end - self.t):
                here.append(impacts.pop(0))
            target = run.q[k + 1], run.v[k + 1]
            event = self._located(end, here) if here else None
            if event is not None:
                yield self._moved(event.t, event.q, event.before), False
                # the step before it has the contacts before it
                self.event_rows, closed = self._involved, self._after
                self.v = event.after
                yield event, False
                self.closed = closed
                jump = float(np.abs((event.after - event.before) / self._units).max())
            part = self._moved(end, *target)
            self._check(part, 0.0 if event is None else jump)
            yield part, True
            self.closed = self._pressed(self.closed, self.t, self.q, self.v)

    def _moved(self, t: float, q: Array, v: Array) -> RungeKuttaStep:
        """Return the smooth step from here to a state, and move there."""
        h, dq = t - self.t, self._flow.system.difference(self.q, q)
        a = self._flow.acceleration(self.t, self.q, self.v, self.closed)[: len(v)]
        dense = np.zeros((2, len(v), DEGREE))
        if h > 0.0:
            dense[:, :, 0] = dq / h, (v - self.v) / h
        none, rates = np.zeros(len(v)), np.concatenate([self.v, a])[None]
        part = RungeKuttaStep(self.t, h, self.q, self.v, q, v, a, np.abs(dq), rates, none, dense)
        self.t, self.q, self.v = t, q, v
        return part

    def _check(self, part: RungeKuttaStep, jump: float) -> None:
        """Refuse a step whose change of velocity is not that of the contacts that are followed."""
        expected = part.h * part.a / self._units
        off = float(np.abs((part.v - part.v0) / self._units - expected).max())
        free = self._flow.system.acceleration(part.t, part.q0, part.v0) / self._units
        step = self._run.step * max(float(np.abs(free).max()), float(np.abs(part.a / self._units).max()))
        least = _UNEXPLAINED * (step if jump == 0.0 else jump + step)
        if off <= least:
            return
        # where an acceleration passes through zero, it changes by more than its size
        end = self._flow.acceleration(self.t, self.q, self.v, self.closed)[: len(part.v)]
        if off > least + part.h * float(np.abs((end - part.a) / self._units).max()):
            raise self._none(_UNFOLLOWED, ())

    def _located(self, end: float, impacts: list[Impact]) -> ImpactEvent | None:
        """Return the impact of this step, None where nothing closes."""
        t, q, v, rows, system = self.t, self.q, self.v, self.rows, self._flow.system
        names = {name for one in impacts for name in one.constraints}
        numbers = [k for k in np.unique(rows.number).tolist() if self.problem.constraints.name(k) in names]
        some = np.setdiff1d(np.flatnonzero(np.isin(rows.number[: len(rows.all)], numbers)), self.closed)
        h = end - t
        a = self._flow.acceleration(t, q, v, self.closed)[: len(v)]
        gap, J = rows.gaps(t, q, some), rows.gradients(t, q, some)
        rate, bend = J @ v, J @ a + rows.bias(t, q, v, some)
        # to the end of the next step, because a scheme may see a gap one step ahead
        closes = (gap + 2.0 * h * rate + 2.0 * h * h * np.minimum(bend, 0.0) <= 0.0) & (rate + h * bend < 0.0)
        some, gap, rate, bend = some[closes], gap[closes], rate[closes], bend[closes]
        if not some.size:
            return None
        time = np.clip(-gap / np.minimum(rate, -1e-300), 0.0, h)
        for _ in range(_NEWTON):
            slope = np.minimum(rate + time * bend, -1e-300)
            time = np.clip(time - (gap + time * rate + 0.5 * time**2 * bend) / slope, 0.0, h)
        s = float(time.min())
        there, before = system.integrate(q, s * v + 0.5 * s * s * a), v + s * a
        first, metric = some[time <= s + _TOGETHER * h], system.metric(there)
        for struck in (first, some):
            involved = np.union1d(struck, self.closed)
            J = rows.gradients(t + s, there, involved)
            after = impact(before, metric, J, rows.restitution[involved])
            left = np.setdiff1d(some, struck)
            reached = rows.gaps(t + s, there, left) + (h - s) * (rows.gradients(t + s, there, left) @ after)
            # others of which the impact leaves none that closes within this step did not take part
            if (reached > 0.0).all():
                break
        p = least_percussion(J @ metric.solve_rows(J).T, J @ (after - before))
        rates, slow = np.array([p, J @ before, J @ after]), certain_rates(J, before, 1e-9)
        stays = (np.abs(rates[2]) <= slow) & ((rows.restitution[involved] == 0.0) | np.isin(involved, self.closed))
        fast = self._run.step * np.abs(J @ a)
        grazes = ~np.isin(involved, self.closed) & (rates[1] < -slow) & (-rates[1] < _SLOW * fast)
        if grazes.any():
            reason = "it grazes: forces change the rate of the gap by as much within two steps"
            raise self._none(reason, tuple(sorted(names)))
        self._involved = involved
        self._after = self._pressed(involved[stays], t + s, there, after)
        nowhere = np.full((len(involved), 3), np.nan)
        return ImpactEvent(t + s, there, before, after, rows.number[involved], rates, nowhere, nowhere)

    def _pressed(self, closed: Array, t: float, q: Array, v: Array) -> Array:
        """Return which of some closed rows keep a positive force."""
        while closed.size:
            free, metric, J, wanted, scale = self._flow.contact_equations(t, q, v, closed)
            G = J @ metric.solve_rows(J).T
            force = least_percussion(G, wanted - J @ free) * G.diagonal()
            if (force >= -1e-12 * scale).all():
                break
            closed = np.delete(closed, int(force.argmin()))
        return closed

    def _none(self, reason: str, names: tuple[str, ...]) -> SensitivityError:
        return SensitivityError(reason, self.t, tuple(names))
