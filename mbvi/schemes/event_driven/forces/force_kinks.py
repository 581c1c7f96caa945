"""Finds where the slopes of forces jump within a step: where one reaches or leaves a limit, and at known times."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ....system.actuators import Actuators, DrivenActuators
from ....system.controls import PDControl
from ....system.mechanisms.articulated import ArticulatedSystem
from ....system.mechanisms.loop_margin import with_equalities
from ....system.system import Array, System, located_parts
from ..finding.root_finding import first_root
from ..runge_kutta import RungeKuttaStep
from .limited_forces import RowLimits
from .limits import State
from .tracking import TrackingLimits

# a step holds forces on the sides of their limits where they are this part of it later; where one leaves its side at
# once all the same, a later place decides, up to the last one
_AHEAD, _LATER, _LAST_AHEAD = 1e-6, 100.0, 1e-2
# how far beyond its end a step may be prolonged, relative to its length
_MOST_LATE = 1.1
# error of the velocity by jumps of slopes within a step, relative to the error that is allowed
_ALLOWED = 0.2
# times nearer than this are the same, relative to the time or to 1 s
_SAME = 1e-12
# error of the time at which a force leaves its side, relative to the step; the same force acts on both sides to first
# order
_NEAR = 1e-9
# distance of places from which a rate is computed
_APART = 1e-4


class ForceKinks:
    """Forces with limits, which a step holds on one side of these, so that they are smooth along it.

    Parameters
    ----------
    system : System
        The system.
    units : ndarray, shape (nv,)
        See `velocity_units`.
    allowed : float
        The error that is allowed in a step.

    Attributes
    ----------
    found : bool
        Whether the last step ends where a force reaches or leaves a limit.
    """

    def __init__(self, system: System, units: Array, allowed: float) -> None:
        self._system, self._units, self._allowed = system, units, _ALLOWED * allowed
        # laws with the places of their mechanisms in q and v
        self._laws, self._trajectories = list[tuple[_Law, slice, slice]](), list[tuple[TrackingLimits, slice]]()
        for part in located_parts(system):
            if isinstance(part.system, ArticulatedSystem):
                own = slice(part.q, part.q + part.system.nq), slice(part.v, part.v + part.system.nv)
                laws = _laws(part.system)
                self._laws += [(law, *own) for law in laws if law.active]
                self._trajectories += [(x, own[1]) for x in laws if isinstance(x, TrackingLimits) and x.has_breaks]
        self.found, self._ahead = False, _AHEAD
        # equalities move joints by more than their velocities say
        self._held = bool(with_equalities(system))

    def before_break(self, t: float, q: Array, v: Array, length: float) -> float:
        """Return the length of a step from (t, q, v), at most the given one, in which slopes jump little by themselves.

        It ends at a time where they jump, if it is not the given one.
        """
        if not self._trajectories:
            return length
        when, jumps = list[Array](), list[Array]()
        for law, own in self._trajectories:
            times, of_mechanism = law.breaks(t + _SAME * max(1.0, abs(t)), t + length)
            when.append(times - t)
            jumps.append(np.zeros((len(times), len(v))))
            jumps[-1][:, own] = of_mechanism
        lengths = np.concatenate(when)
        count, order = len(lengths), np.argsort(lengths, kind="stable")
        if not count:
            return length
        faster = self._system.metric(q).solve_rows(np.concatenate(jumps)[order]) / self._units
        lengths = np.append(lengths[order], length)
        allowed = self._allowed * float(np.abs(v / self._units).max(initial=1.0))
        # fewer and fewer jumps within the step: it may always end at the first one
        while count:
            longest = lengths[count]
            error = longest**2 * jump_errors(lengths[:count] / longest) @ faster[:count]
            if np.abs(error).max() <= allowed:
                break
            count //= 2
        return float(lengths[count])

    def hold(self, t: float, q: Array, v: Array, a: Array, length: float) -> bool:
        """Hold forces on the sides of their limits on which a step begins; return whether some have just changed.

        `a` is dv/dt at the start; `release` must follow.
        """
        self.found, changed = False, False
        if not self._laws:
            return False
        time, end = self._ahead * length, t + _MOST_LATE * length
        ahead = np.array([t + time]), self._system.integrate(q, time * v)[None], (v + time * a[: len(v)])[None]
        for law, of_q, of_v in self._laws:
            now = State(np.array([t]), q[None, of_q], v[None, of_v])
            changed |= law.hold(now, State(ahead[0], ahead[1][:, of_q], ahead[2][:, of_v]), end)
        return changed

    def release(self) -> None:
        """Let the limits of all forces act."""
        for law, *_ in self._laws:
            law.release()

    def first(self, step: RungeKuttaStep, share: float) -> tuple[float, Crossing | None]:
        """Return the share of a step at which a force first leaves its side, and the margin that vanishes there.

        The share is 1 if none does before `share`; it is 0 if sides must be chosen again.
        """
        start = np.array([step.t]), step.q0[None], step.v0[None]
        states = ((law, State(start[0], start[1][:, q], start[2][:, v]), v) for law, q, v in self._laws)
        if not self._laws or (not self._held and all(law.stays(step, state, v) for law, state, v in states)):
            self._ahead = _AHEAD
            return 1.0, None

        def along(x: Array, of: Array) -> Array:
            shares = share * x
            q, v = zip(*(step.at(self._system, each) for each in shares.tolist()), strict=True)
            return self._margins(step.t + shares * step.h, np.array(q), np.array(v))[:, of]

        count = self._margins(*start).shape[1]
        x, which = first_root(along, np.full(count, np.inf))
        at_once = x * share <= 2.0 * _AHEAD
        if x < 1.0 and at_once and self._ahead < _LAST_AHEAD:
            self._ahead *= _LATER
            return 0.0, None
        self._ahead, self.found = _AHEAD, x < 1.0 and not at_once
        if not self.found:
            return 1.0, None
        around = along(np.array([x - _APART, x + _APART]), np.array([which]))[:, 0]
        rate = float(around[1] - around[0]) / (2.0 * _APART * share * step.h)

        def margin(t: float, q: Array, v: Array) -> tuple[float, float, float]:
            return float(self._margins(np.array([t]), q[None], v[None])[0, which]), rate, _NEAR * step.h * abs(rate)

        return x * share, margin

    def _margins(self, t: Array, q: Array, v: Array) -> Array:
        """Return what becomes negative where forces leave their sides, in p states, shape (p, k)."""
        return np.hstack([law.margins(State(t, q[:, of_q], v[:, of_v])) for law, of_q, of_v in self._laws])


def jump_errors(shares: Array) -> Array:
    """Return errors of v after a step of length h where the slope of the acceleration jumps by s, over s h^2.

    Parameters
    ----------
    shares : ndarray, shape (k,)
        The shares of the step at which it jumps.
    """
    # imported here because it is slow to import
    from scipy.integrate import DOP853

    after = (DOP853.C[: DOP853.n_stages] - shares[:, None]).clip(0.0)
    return np.asarray(after @ DOP853.B - 0.5 * (1.0 - shares) ** 2)


# (t, q, v) -> a value, its rate and its rounding
Crossing = Callable[[float, Array, Array], tuple[float, float, float]]
_Law = TrackingLimits | RowLimits


def _laws(system: ArticulatedSystem) -> list[_Law]:
    """Return the forces of a mechanism that may have limits."""
    control, found = system.control, list[_Law]()
    if isinstance(control, PDControl):
        found.append(TrackingLimits(system, control))
    if isinstance(control, Actuators | DrivenActuators):
        found.append(RowLimits(system, control))
    return [*found, RowLimits(system, None)] if system.springs else found
