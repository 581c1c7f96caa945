"""Panels and curves: what `Trajectory.plot` and `Trajectory.report` draw, thinned to what a picture can show."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

Array = np.ndarray
# intervals of time of which the least and the greatest value are drawn
BINS = 1000
# cells of time and of value of which one dot is drawn
_CELLS = 400, 120
# a logarithmic axis ends so far below its largest value
_DECADES = 1e-8
# longest name in a legend
_LONGEST = 34
# of curves; on a dark page it is the colour of text
BLACK = "#222222"


class Curve(NamedTuple):
    """One curve of a panel.

    Attributes
    ----------
    name : str
        Entry of the legend; "" for none.
    t, y : ndarray, shape (n,)
        Times [s] and values; a line has a hole at a NaN.
    style : "line", "steps", "dots" or "ticks"
        Steps hold each value since the time before; ticks stand at the lower edge and have no values.
    color : str
        As "#1f77b4".
    """

    name: str
    t: Array
    y: Array
    style: str = "line"
    color: str = BLACK


class Level(NamedTuple):
    """A horizontal line with its label."""

    label: str
    y: float


class Panel(NamedTuple):
    """One plot over time.

    Attributes
    ----------
    title, axis : str
        The quantity, and the label of its axis with the unit.
    curves : list of Curve
        At least one.
    log : bool
        Whether the axis is logarithmic; values that are not positive are not drawn.
    whole : bool
        Whether values are counts.
    note : str
        How values were chosen, where not all are drawn.
    levels : sequence of Level
        Horizontal lines.
    """

    title: str
    axis: str
    curves: list[Curve]
    log: bool = False
    whole: bool = False
    note: str = ""
    levels: Sequence[Level] = ()


def thinned(curve: Curve, start: float, end: float, *, log: bool = False) -> Curve:
    """Return a curve whose picture is that of the given one, with fewer points where it has many.

    Of a line they have the least and the greatest value in each of 1000 intervals of time: its envelope is the same.
    Of dots they are one in each cell of a grid of time and value, and the extremes.

    Parameters
    ----------
    curve : Curve
        The curve.
    start, end : float
        Between which it is drawn [s].
    log : bool
        Whether its axis is logarithmic.
    """
    t, y = curve.t, curve.y
    if len(t) <= 2 * BINS:
        return curve
    if curve.style == "dots":
        kept = _spread_dots(t, np.log(np.where(y > 0.0, y, np.nan)) if log else y, start, end)
        return curve._replace(t=t[kept], y=y[kept])
    place = np.minimum((BINS * (t - start) / (end - start)).astype(np.int64), BINS - 1)
    # values in the order of their size within each interval; NaN come last
    order = np.lexsort((y, place))
    order = order[np.isfinite(y[order])]
    sorted_place = place[order]
    first = np.flatnonzero(np.diff(sorted_place, prepend=-1))
    last = np.append(first[1:], len(order)) - 1
    ends = [0, len(t) - 1]
    holes = np.flatnonzero(np.isnan(y) & ~np.isnan(np.roll(y, 1)))
    kept = np.unique(np.concatenate([order[first], order[last], ends, holes[:BINS]]))
    return curve._replace(t=t[kept], y=y[kept])


def _spread_dots(t: Array, y: Array, start: float, end: float) -> Array:
    """Return the indices of the first dot in each cell, and of the extremes, in ascending order."""
    index = np.flatnonzero(np.isfinite(y))
    if not index.size:
        return index
    t, y = t[index], y[index]
    low, high = float(y.min()), float(y.max())
    column = np.minimum((_CELLS[0] * (t - start) / (end - start)).astype(np.int64), _CELLS[0] - 1)
    row = np.minimum((_CELLS[1] * (y - low) / max(high - low, 1e-300)).astype(np.int64), _CELLS[1] - 1)
    _, first = np.unique(column * _CELLS[1] + row, return_index=True)
    return np.asarray(index[np.unique([*first, y.argmin(), y.argmax()])])


def positive_range(panel: Panel) -> tuple[float, float]:
    """Return the least and the greatest value that a logarithmic axis shows; it spans at most 8 decades."""
    values = np.concatenate([curve.y[curve.y > 0.0] for curve in panel.curves])
    return max(float(values.min()), _DECADES * float(values.max())), float(values.max())


def shortened(name: str) -> str:
    """Return a name as a legend shows it: of a long one the beginning and the end."""
    half = (_LONGEST - 3) // 2
    return name if len(name) <= _LONGEST else f"{name[:half]}...{name[-half:]}"
