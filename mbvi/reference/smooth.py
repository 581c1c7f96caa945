"""Integration of a smooth motion to rounding, by DOP853 in small steps."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from .solution import Array, Times

_RTOL, _ATOL, _LARGEST = 1e-13, 1e-14, 5e-3


class Smooth(NamedTuple):
    """A motion until its end: at(t) -> y, shape (n,) or of several times (n, m), the end [s], and y there."""

    at: Callable[[Times], Array]
    end: float
    last: Array


def integrated(
    flow: Callable[[float, Array], Any],
    start: float,
    y: Array,
    end: float,
    until: Callable[[float, Array], float] | None = None,
) -> Smooth:
    """Return the solution of dy/dt = flow(t, y) from time `start` on.

    Parameters
    ----------
    flow : callable
        flow(t, y) -> (n,).
    start, end : float
        Times [s].
    y : ndarray, shape (n,)
        State at the start.
    until : callable, optional
        until(t, y) -> float; the solution ends where it falls through zero.
    """
    from scipy.integrate import solve_ivp

    options: dict[str, Any] = {"method": "DOP853", "rtol": _RTOL, "atol": _ATOL, "max_step": _LARGEST}
    events = []
    if until is not None:

        def event(t: float, y: Array) -> float:
            return until(t, y)

        event.terminal, event.direction = True, -1  # type: ignore[attr-defined]
        events.append(event)
    run = solve_ivp(flow, (start, end), y, dense_output=True, events=events, **options)
    if run.status != 1 or until is None:
        return Smooth(run.sol, end, run.y[:, -1])
    # integrate the last step again, because the dense output has an error of lower order
    before, last, when = float(run.t[-2]), run.y[:, -2], float(run.t[-1])
    h = 1e-6
    for _ in range(3):
        again = solve_ivp(flow, (before, when), last, **options).y[:, -1]
        rate = np.asarray(flow(when, again))
        slope = (until(when + h, again + h * rate) - until(when - h, again - h * rate)) / (2.0 * h)
        when -= until(when, again) / slope
    return Smooth(run.sol, when, again)
