"""Finds when other features of two shapes become nearest than those whose rows are closed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ....system.system import Array
from ..motion_state import NO_ROWS, MotionState
from ..rows.row_sets import members
from ..runge_kutta import RungeKuttaStep

# shares of a step at which features are compared, and how near to the change, in roundings of gaps, the search ends
_NODES, _NEAR = (0.5, 1.0), 3.0
# most evaluations of a search, and the share of a step to which it finds a change
_MOST, _SHORT = 60, 1e-13


def first_feature_change(state: MotionState, step: RungeKuttaStep, share: float) -> tuple[float, Array]:
    """Return the share of a step at which the features of closed pairs first change, and of which pairs.

    The features of a pair are those of its closed rows. Others have taken their place where the distance of the pair is
    no more the least of their gaps, or where a contact point is no more on both shapes. If that does not happen before
    `share`, that and no rows are returned.
    """
    pairs = state.feature_pairs()
    if not pairs.size:
        return share, NO_ROWS
    rows, features = state.rows, state.closed[state.closed >= len(state.rows.all)]
    which, allowed = np.searchsorted(pairs, rows.pair[features]), rows.rounding[pairs]

    def excess(x: float) -> Array:
        """Return by how much distances differ from those of the features, in roundings of gaps, less 1."""
        t, q = step.t + x * step.h, step.at(state.system, x)[0] if x < 1.0 else step.q
        least = np.full(len(pairs), np.inf)
        np.minimum.at(least, which, rows.gaps(t, q, features))
        differs = np.abs(rows.gaps(t, q, pairs) - least)
        np.maximum.at(differs, which, rows.features_outside(q, features))
        return np.asarray(differs / allowed - 1.0)

    low = 0.0
    for node in _NODES:
        high = node * share
        found = excess(high)
        if (found > 0.0).any():
            return _narrowed(excess, low, high, found, pairs)
        low = high
    return share, NO_ROWS


def _narrowed(
    excess: Callable[[float], Array], low: float, high: float, found: Array, pairs: Array
) -> tuple[float, Array]:
    """Return where the features change between two shares of a step, and of which pairs; `found` is that at `high`."""
    # beyond a change the difference of distances grows about in proportion: a secant leads to it, or bisection
    top, before = float(found.max()), None
    for turn in range(_MOST):
        if top <= _NEAR or high - low <= _SHORT:
            break
        middle = 0.5 * (low + high)
        if before is not None and turn % 3:
            secant = high - top * (before[0] - high) / (before[1] - top) if before[1] > top else middle
            middle = secant if low < secant < high else middle
        values = excess(middle)
        if (values > 0.0).any():
            before, high, found, top = (high, top), middle, values, float(values.max())
        else:
            low = middle
    return high, pairs[found > 0.0]


def drop_features(state: MotionState, pairs: Array) -> None:
    """Let the features of pairs go that have come apart, or slid off, while others became the nearest ones."""
    rows, closed = state.rows, state.closed
    own = members(rows.pair[closed], pairs) & (closed >= len(rows.all))
    if own.any():
        features = closed[own]
        apart = rows.gaps(state.t, state.q, pairs)[np.searchsorted(pairs, rows.pair[features])]
        beside = rows.features_outside(state.q, features) > rows.rounding[features]
        own[own] = beside | (rows.gaps(state.t, state.q, features) < apart)
        state.closed = closed[~own]
