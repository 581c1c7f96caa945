"""The picture of a chart: error against CPU time and against step, one row of panels per problem."""

from __future__ import annotations

from collections.abc import Sequence
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
# fixed, so that pictures can be compared
_STYLES = {
    "Paoli": ("C0", "o"),
    "MoreauJean": ("C1", "s"),
    "Centered": ("C2", "^"),
    "Centered, projected": ("C5", "<"),
    "SchatzmanPaoli": ("C4", "v"),
    "EventDriven": ("C3", "*"),
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
        for scheme in dict.fromkeys(r.scheme for r in mine):
            _line(left, right, [r for r in mine if r.scheme == scheme])
        _frame(left, right, mine)
    note = "Errors below 1e-12 are drawn there: rounding."
    figure.supxlabel(f"{note} {footnote}".strip(), fontsize="small", color="0.35")
    return figure


def _line(left: Any, right: Any, records: Sequence[Record]) -> None:
    colour, marker = _style(records[0].scheme)
    found = np.maximum([r.error for r in records], ROUNDING)
    peer = records[0].scheme.partition(",")[0] not in _SCHEMES
    look = {"color": colour, "marker": marker, "markersize": 8 if marker == "*" else 5, "linewidth": 1.2}
    look["linestyle"] = "--" if peer else "-"
    left.loglog([r.cpu for r in records], found, **look)
    right.loglog([r.step for r in records], found, **look, label=f"{records[0].scheme}: {slope(records)}")


_SCHEMES = ("Paoli", "MoreauJean", "Centered", "SchatzmanPaoli", "EventDriven", "StewartTrinkle")


def _style(scheme: str) -> tuple[str, str]:
    # the name of an engine ends with its version
    return _STYLES.get(scheme) or _STYLES.get(scheme.split()[0], ("0.6", "."))


def _frame(left: Any, right: Any, records: Sequence[Record]) -> None:
    first = records[0]
    found = np.maximum([r.error for r in records if np.isfinite(r.error)], ROUNDING)
    left.set_ylim(0.4 * found.min(), 2.5 * found.max())
    title = f"{first.problem}, e = {first.e:g}, {first.duration:.3g} s"
    left.set(xlabel="CPU time of a run [s]", ylabel=_LABELS[first.plotted], title=title)
    right.set(xlabel="step [s] (EventDriven: its mean step)", title="error against step")
    right.tick_params(labelleft=True)
    for axes in (left, right):
        axes.grid(True, which="major", color="0.9", zorder=0)
    right.legend(loc="center left", bbox_to_anchor=(1.02, 0.5), fontsize="small", frameon=False)
