"""The plots of a run by matplotlib."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import InputError
from .panel import Curve, Panel, positive_range, shortened
from .quantities import panels

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..diagnosis.diagnosis import Diagnosis
    from ..run_data import RunData

# size of a panel [inches], and panels beside each other
_WIDTH, _HEIGHT, _COLUMNS = 5.6, 2.7, 2
_LEVEL = "#888888"
# most entries of a legend beside each other, and the height of a line of them [points]
_ENTRIES, _LINE = 4, 11.0
# room for a legend, of which a character takes so much and the mark before a name as much as some [points]
_ROOM, _CHARACTER, _MARK = 335.0, 3.9, 5.0
# an axis begins at zero if the least value is below this part of the greatest
_NEAR_ZERO = 0.7


def figure(run: RunData, diagnosis: Diagnosis | None, no_diagnosis: str) -> Figure:
    """Return the plots of a run as a figure; see `Trajectory.plot`.

    Raises
    ------
    InputError
        If matplotlib is not installed, or there is nothing to plot.
    """
    try:
        from .notebook import NotebookFigure
    except ImportError as error:
        raise InputError("run.plot() needs matplotlib: pip install 'mbvi[charts]'") from error
    shown, omitted = panels(run, diagnosis, no_diagnosis)
    if not shown:
        raise InputError(f"there is nothing to plot: {omitted[0].reason}")
    columns = min(_COLUMNS, len(shown))
    rows = -(-len(shown) // columns)
    made = NotebookFigure(figsize=(_WIDTH * columns, _HEIGHT * rows + 0.4), layout="constrained")
    axes = made.subplots(rows, columns, squeeze=False, sharex=True).ravel()
    for axis, panel in zip(axes, shown, strict=False):
        _draw(axis, panel)
    for axis in axes[len(shown) :]:
        axis.set_axis_off()
    # the lowest of each column, also where the last row is not full
    for axis in axes[max(len(shown) - columns, 0) : len(shown)]:
        axis.set_xlabel("time [s]")
        axis.tick_params(labelbottom=True)
    axes[0].set_xlim(run.t[0], run.t[-1])
    step = f", h = {run.step:g} s" if run.step else ""
    made.suptitle(f"{run.scheme}{step}", fontsize="medium")
    return made


def _draw(axis: Any, panel: Panel) -> None:
    for level in panel.levels:
        axis.axhline(level.y, color=_LEVEL, linewidth=0.8, linestyle="--" if level.label else "-", zorder=1)
        if level.label:
            axis.annotate(
                level.label,
                (1.0, level.y),
                xycoords=axis.get_yaxis_transform(),
                xytext=(-3, 2),
                textcoords="offset points",
                ha="right",
                fontsize="x-small",
                color=_LEVEL,
            )
    for curve in panel.curves:
        _curve(axis, curve)
    if panel.log:
        axis.set_yscale("log")
        low, high = positive_range(panel)
        axis.set_ylim(0.6 * low, 1.7 * high)
    if panel.whole:
        from matplotlib.ticker import MaxNLocator

        axis.yaxis.set_major_locator(MaxNLocator(integer=True))
    axis.set_ylabel(panel.axis)
    least, greatest = _extremes(panel)
    near = least < _NEAR_ZERO * greatest or least == greatest
    if not panel.log and axis.get_ylim()[0] > -0.1 * axis.get_ylim()[1] and least >= 0.0 and near:
        axis.set_ylim(bottom=0.0)
    named = [curve for curve in panel.curves if curve.name]
    # the legend lies between title and plot, where it covers nothing
    entries = _beside([shortened(curve.name) for curve in named])
    pad = 5.0 + _LINE * -(-len(named) // entries)
    axis.set_title(panel.title, loc="left", pad=pad, fontsize="medium", fontweight="bold")
    if panel.note:
        axis.set_title(panel.note, loc="right", pad=pad, fontsize="x-small", color=_LEVEL)
    axis.grid(alpha=0.25, linewidth=0.6)
    axis.spines[["top", "right"]].set_visible(False)
    if named:
        look = {
            "fontsize": "x-small",
            "frameon": False,
            "borderaxespad": 0.2,
            "handlelength": 1.2,
            "columnspacing": 1.2,
        }
        shown = axis.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=entries, **look)
        # long names must not change the widths of the columns
        shown.set_in_layout(False)


def _beside(names: list[str]) -> int:
    """Return how many entries of a legend have room beside each other; a column of them is as wide as its longest."""
    for count in range(min(len(names), _ENTRIES), 1, -1):
        longest = [max(map(len, column)) for column in np.array_split(names, count)]
        if _CHARACTER * sum(width + _MARK for width in longest) <= _ROOM:
            return count
    return 1


def _extremes(panel: Panel) -> tuple[float, float]:
    """Return the least value of a panel, and the greatest of values and levels."""
    values = [curve.y[np.isfinite(curve.y)] for curve in panel.curves if curve.style != "ticks"]
    found = np.concatenate([*values, [level.y for level in panel.levels]])
    least = min((float(y.min()) for y in values if len(y)), default=0.0)
    return least, float(found.max(initial=least))


def _curve(axis: Any, curve: Curve) -> None:
    name, color = shortened(curve.name) or None, curve.color
    if curve.style == "ticks":
        look = {"marker": "|", "linestyle": "", "markersize": 7, "transform": axis.get_xaxis_transform()}
        strong = 1.0 if len(curve.t) < 100 else 0.3
        axis.plot(curve.t, np.full(len(curve.t), 0.02), color=color, label=name, alpha=strong, **look)
    elif curve.style == "dots":
        size = 3.5 if len(curve.t) < 300 else 2.0
        axis.plot(curve.t, curve.y, "o", color=color, label=name, markersize=size, markeredgewidth=0, alpha=0.8)
    else:
        steps = {"drawstyle": "steps-pre"} if curve.style == "steps" else {}
        axis.plot(curve.t, curve.y, color=color, label=name, linewidth=1.1, **steps)
