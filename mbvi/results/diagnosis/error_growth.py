"""How an error of the start grows along a run, and until when that leaves digits of its states."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..run_data import Array, RunData

# of a double, and digits that are to be left of its states
ROUNDING, DIGITS = 2.0**-52, 3


@dataclass(frozen=True)
class ErrorGrowth:
    """How an error of the start grows along a run.

    Attributes
    ----------
    growth : float
        The largest factor, in lengths of the scene, rad and seconds.
    until : float
        The time from which a start known to rounding leaves fewer than three digits of the states [s]; inf if that does
        not come.
    followed : float
        The time up to which this is known [s]: the end, or where the run has no derivative.
    """

    growth: float
    until: float
    followed: float

    def __str__(self) -> str:
        left = "and more are left there" if np.isinf(self.until) else f"are left until t = {self.until:.6g} s"
        return (
            f"Followed up to t = {self.followed:.6g} s, an error of the start grows at most {self.growth:.3g} times: "
            f"of a start known to rounding {DIGITS} digits {left}."
        )


def error_growth(run: RunData) -> ErrorGrowth | None:
    """Return how an error of the start grows, None where that is not known."""
    factors = run.record.growth
    if factors is None:
        return None
    times = run.t[: len(factors)]
    return ErrorGrowth(float(factors.max()), trusted_until(times, factors, DIGITS, ROUNDING), float(times[-1]))


def trusted_until(times: Array, factors: Array, digits: float, start: float) -> float:
    """Return the first time from which fewer digits are left of a start that is known to a relative error [s]."""
    lost = np.maximum.accumulate(factors) * start > 10.0**-digits
    return float(times[lost.argmax()]) if lost.any() else np.inf
