"""The picture of a chart: error against CPU time and against step, one row of panels per problem."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from .costs import ROUNDING, slope
from .records import Record

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_LABELS = {
    "q": "largest error of q [m, rad]",
    "energy": "mean error of energy [J]",
    "penetration": "deepest penetration [m, rad]",
}
# lines of a problem that have colors
_BEST = 8
_OTHERS = "0.78"
# height of a line of names [points]
_LINE = 10.0
# fixed, so that pictures can be compared
_STYLES = {
    "Paoli": ("C0", "o"),
    "MoreauJean": ("C1", "s"),
    "Centered": ("C2", "^"),
    "Centered, projected": ("C5", "<"),
    "SchatzmanPaoli": ("C4", "v"),
    "EventDriven": ("C3", "*"),
    "Adaptive": ("crimson", "H"),
    "StewartTrinkle": ("C7", "D"),
    "MuJoCo": ("0.25", "P"),
    "PyBullet": ("C6", "X"),
    "Drake": ("C8", "d"),
    "DART": ("C9", "p"),
    "Siconos": ("indigo", "h"),
    "jiminy": ("darkgreen", "1"),
}


def draw(records: Sequence[Record], footnote: str = "") -> Figure:
    """Draw records, a row of two panels for each problem: error against CPU time, and against step.

    The eight lines with the least product of error and CPU time have colors, the others are grey.

    Parameters
    ----------
    records : sequence of Record
        Records of one or more problems.
    footnote : str
        Text below the panels, such as the machine.

    Returns
    -------
    matplotlib.figure.Figure
        The figure.
    """
    from matplotlib.figure import Figure

    problems = list(dict.fromkeys((r.problem, r.e) for r in records))
    figure = Figure(figsize=(12, 3.5 * len(problems) + 0.3), layout="constrained")
    rows = figure.subplots(len(problems), 2, squeeze=False, sharey="row")
    for (left, right), key in zip(rows, problems, strict=True):
        mine = [r for r in records if (r.problem, r.e) == key]
        lines = {name: [r for r in mine if r.scheme == name] for name in dict.fromkeys(r.scheme for r in mine)}
        best = set(sorted(lines, key=lambda name: _product(lines[name]))[:_BEST])
        for scheme, found in sorted(lines.items(), key=lambda line: line[0] in best):
            _line(left, right, found, colored=scheme in best)
        _frame(left, right, mine)
        _names(figure, right, lines, best)
    note = "Errors below 1e-12 are drawn there: rounding."
    if len({r.scheme for r in records}) > _BEST:
        note += f" Colors: the {_BEST} lines of each problem with the least error times CPU time."
    figure.supxlabel(f"{note} {footnote}".strip(), fontsize="small", color="0.35")
    return figure


def _product(records: Sequence[Record]) -> float:
    """Return the least product of error and CPU time on a line; infinite without a finite one."""
    found = [r.cpu * max(r.error, ROUNDING) for r in records]
    return min((x for x in found if np.isfinite(x)), default=np.inf)


def _line(left: Any, right: Any, records: Sequence[Record], *, colored: bool) -> None:
    colour, marker = _style(records[0].scheme)
    if not colored:
        colour = _OTHERS
    found = np.maximum([r.error for r in records], ROUNDING)
    peer = records[0].scheme.partition(",")[0] not in _SCHEMES
    look = {"color": colour, "marker": marker, "markersize": 8 if marker == "*" else 5, "linewidth": 1.2}
    look["linestyle"] = "--" if peer else "-"
    left.loglog([r.cpu for r in records], found, **look)
    right.loglog([r.step for r in records], found, **look)


_SCHEMES = ("Paoli", "MoreauJean", "Centered", "SchatzmanPaoli", "EventDriven", "Adaptive", "StewartTrinkle")


def _style(scheme: str) -> tuple[str, str]:
    # the name of an engine ends with its version
    return _STYLES.get(scheme) or _STYLES.get(scheme.split()[0], ("0.6", "."))


def _frame(left: Any, right: Any, records: Sequence[Record]) -> None:
    first = records[0]
    found = np.maximum([r.error for r in records if np.isfinite(r.error)], ROUNDING)
    left.set_ylim(0.4 * found.min(), 2.5 * found.max())
    title = f"{first.problem}, e = {first.e:g}, {first.duration:.3g} s"
    left.set(xlabel="CPU time of a run [s]", ylabel=_LABELS[first.plotted], title=title)
    right.set(xlabel="step [s] (EventDriven, Adaptive: their mean step)", title="error against step")
    right.tick_params(labelleft=True)
    for axes in (left, right):
        axes.grid(True, which="major", color="0.9", zorder=0)


def _names(figure: Any, axes: Any, lines: Mapping[str, Sequence[Record]], best: Collection[str]) -> None:
    """Write the name and the order of each line beside its right end, one below the other where ends are close."""
    ends = dict[str, tuple[float, float]]()
    low, high = np.log(axes.get_ylim())
    for name, records in lines.items():
        seen = [(r.step, max(r.error, ROUNDING)) for r in records if np.isfinite(r.error)]
        if seen:
            ends[name] = max(seen)
    order = sorted(ends, key=lambda name: -ends[name][1])
    # as a part of the height of the panel
    apart = _LINE / (72.0 * figure.get_figheight() / len(figure.axes) * 2.0 * 0.78)
    wanted = [(np.log(ends[name][1]) - low) / (high - low) for name in order]
    for name, height in zip(order, _spread(wanted, apart), strict=True):
        colour = _style(name)[0] if name in best else "0.55"
        axes.annotate(
            f"{name}: {slope(lines[name])}", xy=ends[name], xycoords="data", xytext=(1.03, height),
            textcoords="axes fraction", va="center", fontsize="small", color=colour, annotation_clip=False,
            # to the left end of the name, not through other names to its middle
            arrowprops={"arrowstyle": "-", "color": colour, "linewidth": 0.5, "alpha": 0.6, "shrinkA": 1, "shrinkB": 4,
                        "relpos": (0.0, 0.5)},
        )  # fmt: skip


def _spread(heights: Sequence[float], apart: float) -> list[float]:
    """Return places that descend by at least a distance from 1, each group about the mean of what it wants."""
    groups = [[height, 1.0] for height in heights]
    k = 0
    # a group is its middle and its number of names; two that overlap become one
    while k < len(groups) - 1:
        (a, n), (b, m) = groups[k], groups[k + 1]
        if a - b < 0.5 * (n + m) * apart - 1e-12:
            groups[k : k + 2] = [[(n * a + m * b) / (n + m), n + m]]
            k = max(k - 1, 0)
        else:
            k += 1
    places, most = list[float](), 1.0
    for middle, n in groups:
        for j in range(int(n)):
            # none above the panel
            places.append(min(middle + apart * (0.5 * (n - 1) - j), most))
            most = places[-1] - apart
    return places
