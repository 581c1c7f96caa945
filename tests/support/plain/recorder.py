"""Plain numpy forms of the kernels in mbvi/run/recording/recorder.py."""

from __future__ import annotations

import numpy as np

from mbvi.arguments import Array
from mbvi.schemes.step import closes


def _still(number: Array, lever: Array, still: float) -> Array:
    """Return the rate below which each row does not close; arguments as of `_note`."""
    known = number < len(lever)
    return np.asarray(still / np.where(known, np.append(lever, 1.0)[np.where(known, number, -1)], 1.0))


def _note_plain(
    k: int, number: Array, gap: Array, rates: Array, residual: float, lever: Array, limits: int, still: float,
    penetration: Array, violation: Array, residuals: Array,
) -> bool:  # fmt: skip
    """Note the greatest depths since the last kept step and the largest residual; tell if an impact is possible."""
    residuals[k] = max(residuals[k], residual)
    of_limits = number < limits
    penetration[k] = (-gap[~of_limits]).max(initial=penetration[k])
    violation[k] = (-gap[of_limits]).max(initial=violation[k])
    return bool(closes(rates, _still(number, lever, still)).any())


def _struck_plain(
    number: Array, point: Array, rates: Array, e: Array,
    last_number: Array, last_point: Array, last_rates: Array, far: float, lever: Array, still: float, chosen: Array,
) -> tuple[int, float]:  # fmt: skip
    """Choose the rows that may belong to an impact, if there is one, and add up its energy."""
    percussion, free, after, before = rates
    # every row now beside every row of the same constraint that pressed then
    then = np.flatnonzero(last_rates[0] > 0.0)
    then = then[np.argsort(last_number[then], kind="stable")]
    first, end = (np.searchsorted(last_number[then], number, side) for side in ("left", "right"))
    row = np.repeat(np.arange(len(number)), end - first)
    other = then[np.arange(len(row)) + np.repeat(first - np.cumsum(end - first) + end - first, end - first)]
    shift = last_point[:, other] - point[row]
    # limits have no points: NaN is near
    near = (~(np.vecdot(shift, shift) > far**2)).any(axis=0)
    pressed = np.bincount(row[near], last_rates[0, other[near]], minlength=len(number))
    closing = closes(rates, _still(number, lever, still)) & (pressed == 0.0)
    chosen[:] = (percussion > 0.0) & (percussion > 2.0 * pressed) & closing.any()
    chosen[closing] = 2
    pushed = (free - before) * (1.0 - e) / (1.0 + e)
    return int(np.count_nonzero(chosen)), 0.5 * float(percussion @ (before + after + pushed))
