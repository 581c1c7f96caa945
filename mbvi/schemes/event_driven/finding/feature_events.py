"""Finds when other features of two shapes become nearest than those whose rows are closed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ....compiled import kernel
from ....constraints.features.feature_kernels import Surfaces, touch, write_outside
from ....constraints.mechanism.held_rows import RowParts
from ....constraints.mechanism.pairs import PairShapes, place_bodies
from ....geometry.shapes.shape_table import Shapes  # noqa: F401  (a signature names it)
from ....system.mechanisms.mechanism import place
from ....system.system import Array
from ..motion_state import NO_ROWS, MotionState
from ..rows.known_pairs import write_placed_distances
from ..rows.row_sets import members
from ..runge_kutta import RungeKuttaStep
from ..stages import SmoothMotion, state_at

# shares of a step at which features are compared, and how near to the change, in roundings of gaps, the search ends
_NODES, _NEAR = (0.5, 1.0), 3.0
# most evaluations of a search, and the share of a step to which it finds a change
_MOST, _SHORT = 60, 1e-13


@kernel(
    "void(SmoothMotion, RowParts, Tuple(Shapes), PairShapes, i8[::1], i8[::1], i8[::1], Surfaces,"
    " f8[:,:,::1], f8, f8, Array(f8, 1, 'C', True), Array(f8, 1, 'C', True), f8[::1])"
)
def write_differences(
    s: SmoothMotion, parts: RowParts, tables: tuple[Array, ...], shapes: PairShapes, pairs: Array, features: Array,
    which: Array, surfaces: Surfaces, dense: Array, h: float, share: float, q: Array, v: Array, differs: Array,
) -> None:  # fmt: skip
    """Write by how much the features of some pairs are not the nearest ones of both shapes, shape (k,) [m].

    That is how far their least gap is from the pair's distance, or how far contact points are outside the shapes.

    Parameters
    ----------
    s, parts, tables, shapes
        See `earliest_root`.
    pairs : ndarray of int, shape (k,)
        The pairs.
    features, which : ndarray of int, shape (m,)
        Rows of features, and which of the pairs each belongs to.
    surfaces : Surfaces
        Those of the features.
    dense, h, share, q, v
        See `state_at`.
    """
    k, m = len(features), s.mechanism
    state_at(s, dense, h, share, q, v)
    place(m, s.q)
    place_bodies(m, shapes)
    kind, places, along, normal = np.empty(k, np.int64), np.empty((k, 2, 4, 3)), np.empty((2, 3)), np.empty((k, 3))
    radius, gap, point, outside = np.empty(k), np.empty(k), np.empty((k, 3)), np.empty(k)
    distance = np.empty(len(pairs))
    for i in range(k):
        r = features[i]
        kind[i], radius[i] = parts.kind[r], parts.radius[r]
        for side in range(2):
            for c in range(4):
                for d in range(3):
                    places[i, side, c, d] = m.poses[parts.sides[r, side], c, d]
        gap[i] = touch(kind[i], parts.parts[r], radius[i], places[i, 0], places[i, 1], along, point[i], normal[i])
        for c in range(3):
            point[i, c] += parts.shift[r] * normal[i, c]
    write_outside(kind, radius, places, gap, point, normal, surfaces, outside)
    write_placed_distances(tables, shapes, pairs, np.inf, distance)
    for i in range(len(pairs)):
        least, most = np.inf, -np.inf
        for j in range(k):
            if which[j] == i:
                least, most = min(least, gap[j]), max(most, outside[j])
        differs[i] = max(abs(distance[i] - least), most)


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

    known = _by_kernel(state, step, pairs, features, which)

    def excess(x: float) -> Array:
        """Return by how much distances differ from those of the features, in roundings of gaps, less 1."""
        if known is not None:
            return known(x) / allowed - 1.0
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


def _by_kernel(
    state: MotionState, step: RungeKuttaStep, pairs: Array, features: Array, which: Array
) -> Callable[[float], Array] | None:
    """Return what tells at a share of a step what `write_differences` does, or None where kernels know too little."""
    rows, kernels = state.rows, state.flow.kernels
    if kernels is None or rows.searched is None or (rows.searched_pair[pairs] < 0).any():
        return None
    shapes = rows.searched.tables, rows.searched.shapes, rows.searched_pair[pairs]
    fixed = kernels.motion, kernels.rows.parts, *shapes, features, which, rows.surfaces(features)
    way, differs = (step.dense, step.h), np.empty(len(pairs))

    def differences(x: float) -> Array:
        write_differences(*fixed, *way, x, step.q0, step.v0, differs)
        return differs

    return differences


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
