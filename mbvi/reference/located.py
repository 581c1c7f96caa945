"""Reference motions under few constraints: integration and event times accurate to rounding, at any cost.

DOP853 integrates between events, with its tightest tolerances and a small largest step. At impacts the law is solved
by enumeration.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from ..errors import InputError
from .law import complementary, law
from .solution import Array, Motion, Pieces, State, Times, from_start, times

_RTOL, _ATOL = 1e-13, 1e-14
# first step after an event, so short that a contact that opens cannot close again within it [s]
_FIRST_STEP = 1e-7
_MOST_EVENTS = 200
# impacts closer in time than the first count as an accumulation; a motion that may be shortened ends where impacts are
# closer than the second [s]
_NEAREST, _NEAR = 1e-4, 1e-2
# gaps below the first count as closed, normal speeds below the second as zero
_TOUCHING, _STILL = 1e-10, 1e-11


@dataclass(frozen=True)
class Mechanism:
    """A system and its constraints as plain functions, all constraints at once.

    Attributes
    ----------
    mass : callable
        mass(q) -> (nv, nv).
    force : callable
        force(t, q, v) -> (nv,).
    gap, gradient : callable
        gap(q) -> (m,), gradient(q) -> (m, nv).
    bias : callable
        bias(q, v) -> (dJ/dt) v, shape (m,).
    rate : callable
        rate(q, v) -> dq/dt, shape (nq,).
    normalise : callable
        normalise(q) -> q, with rounding off the manifold removed, for one configuration or rows of them.
    """

    mass: Callable[[Array], Array]
    force: Callable[[float, Array, Array], Array]
    gap: Callable[[Array], Array]
    gradient: Callable[[Array], Array]
    bias: Callable[[Array, Array], Array]
    rate: Callable[[Array, Array], Array] = lambda q, v: v
    normalise: Callable[[Array], Array] = lambda q: q

    def multipliers(self, t: float, q: Array, v: Array, closed: list[int], choose: bool = False) -> Array:
        """Return the forces that keep contacts closed; with `choose`, only nonnegative ones, by complementarity."""
        J = self.gradient(q)[closed]
        M = self.mass(q)
        response = np.linalg.solve(M, J.T)
        opening = response.T @ self.force(t, q, v) + self.bias(q, v)[closed]
        return complementary(J @ response, opening) if choose else np.linalg.solve(J @ response, -opening)

    def acceleration(self, t: float, q: Array, v: Array, closed: list[int]) -> Array:
        """Return dv/dt with the given contacts kept closed."""
        generalised_force = self.force(t, q, v)
        if closed:
            generalised_force = generalised_force + self.gradient(q)[closed].T @ self.multipliers(t, q, v, closed)
        return np.linalg.solve(self.mass(q), generalised_force)


@dataclass(frozen=True)
class Located:
    """A motion with its events: at(t) -> (q, v) until the end, times of impacts and of releases [s]."""

    at: Pieces
    end: float
    impacts: Array
    releases: Array


def locate(
    mechanism: Mechanism,
    q0: Array,
    v0: Array,
    e: float,
    duration: float,
    shorten: bool = False,
    largest_step: float = 5e-3,
) -> Located:
    """Return the motion from (q0, v0) at time 0, free of contacts.

    Parameters
    ----------
    mechanism : Mechanism
        System and constraints; gaps must be positive at q0.
    q0, v0 : ndarray, shapes (nq,) and (nv,)
        Start.
    e : float
        Restitution.
    duration : float
        [s].
    shorten : bool
        Whether to end the motion before impacts accumulate.
    largest_step : float
        Largest step of the integrator [s]. A gap that closes and opens within one step is not found.

    Raises
    ------
    InputError
        If impacts accumulate before the end and `shorten` is false.

    Notes
    -----
    Contacts that an impact at e = 0 leaves closed stay closed while their multipliers are positive. The complementarity
    problem of accelerations selects them.
    """
    nq = len(q0)
    t, y, closed = 0.0, np.concatenate([q0, v0]), list[int]()
    starts: list[float] = []
    states: list[Motion] = []
    struck: list[float] = []
    released: list[float] = []
    while t < duration:
        if len(starts) == _MOST_EVENTS or (len(struck) > 1 and struck[-1] - struck[-2] < _NEAREST):
            if not shorten:
                raise InputError(f"impacts accumulate near {t:g} s: choose a duration that ends before")
            # in the middle between two impacts
            first = int(np.argmax(np.diff(struck) < _NEAR))
            duration = 0.5 * (sum(struck[first - 1 : first + 1]) if first else struck[0])
            break
        start = t
        solution, t, y, event = _integrate_to_event(mechanism, t, y, closed, duration, largest_step, nq)
        starts.append(start)
        states.append(partial(_state, mechanism, solution, nq))
        if event is None:
            break
        if event in closed:
            released.append(t)
        else:
            struck.append(t)
        y, closed = _apply_event(mechanism, t, y, closed, event, e, nq)
    states[0] = partial(from_start, states[0], q0, v0)
    return Located(Pieces(starts, states, duration), duration, times(struck, duration), times(released, duration))


def _integrate_to_event(
    mechanism: Mechanism, t: float, y: Array, closed: list[int], end: float, largest_step: float, nq: int
) -> tuple[Any, float, Array, int | None]:
    """Integrate until the first event; return the dense solution, time and state there, and which constraint it is."""
    from scipy.integrate import solve_ivp

    def flow(time: float, state: Array) -> Array:
        q, v = state[:nq], state[nq:]
        return np.concatenate([mechanism.rate(q, v), mechanism.acceleration(time, q, v, closed)])

    events, numbers = [], list(range(len(mechanism.gap(y[:nq]))))
    for a in numbers:
        event = partial(_contact_force, mechanism, closed, a, nq) if a in closed else partial(_gap, mechanism, a, nq)
        event.terminal, event.direction = True, -1  # type: ignore[attr-defined]
        events.append(event)
    options: dict[str, Any] = {"method": "DOP853", "rtol": _RTOL, "atol": _ATOL, "max_step": largest_step}
    first = min(_FIRST_STEP, end - t)
    run = solve_ivp(flow, (t, end), y, dense_output=True, events=events, first_step=first, **options)
    if run.status != 1:
        return run.sol, end, run.y[:, -1], None
    number = next(a for a in numbers if len(run.t_events[a]))
    # integrate the last step again, because the dense output has an error of lower order
    before, state, when = float(run.t[-2]), run.y[:, -2], float(run.t[-1])
    for _ in range(3):
        again = solve_ivp(flow, (before, when), state, **options).y[:, -1]
        # the rate of a multiplier is not available
        value, rate = _slope(mechanism, flow, events[number], closed, number, when, again, nq)
        if abs(value / rate) < 1e-16 or when - value / rate <= before:
            break
        when -= value / rate
    return run.sol, when, again, number


def _slope(
    mechanism: Mechanism, flow: Any, event: Any, closed: list[int], number: int, t: float, y: Array, nq: int
) -> tuple[float, float]:
    """Return the value of an event function and its rate."""
    if number not in closed:
        return event(t, y), float(mechanism.gradient(y[:nq])[number] @ y[nq:])
    h, dy = 1e-5, flow(t, y)
    return event(t, y), (event(t + h, y + h * dy) - event(t - h, y - h * dy)) / (2 * h)


def _apply_event(
    mechanism: Mechanism, t: float, y: Array, closed: list[int], event: int, e: float, nq: int
) -> tuple[Array, list[int]]:
    """Return the state after an event and the contacts that are closed from then on."""
    q, v = mechanism.normalise(y[:nq]), y[nq:]
    if event in closed:
        stay = [a for a in closed if a != event]
        return np.concatenate([q, v]), stay
    touching = [int(a) for a in np.flatnonzero(mechanism.gap(q) < _TOUCHING)]
    J = mechanism.gradient(q)
    v = law(mechanism.mass(q), J[touching], v, e)
    resting = [a for a in touching if J[a] @ v < _STILL]
    if resting:
        forces_at_rest = mechanism.multipliers(t, q, v, resting, choose=True)
        resting = [a for a, p in zip(resting, forces_at_rest, strict=True) if p > 0]
    return np.concatenate([q, v]), resting


def _gap(mechanism: Mechanism, number: int, nq: int, t: float, y: Array) -> float:
    return float(mechanism.gap(y[:nq])[number])


def _contact_force(mechanism: Mechanism, closed: list[int], number: int, nq: int, t: float, y: Array) -> float:
    return float(mechanism.multipliers(t, y[:nq], y[nq:], closed)[closed.index(number)])


def _state(mechanism: Mechanism, solution: Any, nq: int, t: Times) -> State:
    y = solution(t).T
    return mechanism.normalise(y[..., :nq]), y[..., nq:]
