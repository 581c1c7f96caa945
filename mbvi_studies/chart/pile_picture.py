"""The picture of piles: worst depth against CPU time per simulated second, one panel per scene, and its table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from .pile_runs import PileRecord
from .piles import PICTURES

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# colour and marker of each engine; shades of the colour tell its lines apart
_STYLES = {"mbvi": ("C3", "o"), "MuJoCo": ("0.15", "P"), "PyBullet": ("C0", "X"), "Drake": ("C2", "d")}
_SHADES = (1.0, 0.55, 0.3)
# the depth that costs are compared at, and depths that are drawn no lower [units of the pile]
_COMPARED, _LEAST = 1e-2, 1e-8


def draw_piles(records: Sequence[PileRecord], footnote: str = "") -> Figure:
    """Draw the records of one picture; lines join the points of an engine from its longest step or largest depth.

    Parameters
    ----------
    records : sequence of PileRecord
        Records of one picture.
    footnote : str
        Text below the panels, such as the machine.
    """
    from matplotlib.figure import Figure

    scenes = list(dict.fromkeys(r.scene for r in records))
    figure = Figure(figsize=(4.3 * len(scenes) + 0.4, 5.6), layout="constrained")
    panels = figure.subplots(1, len(scenes), squeeze=False, sharey=True)[0]
    styles = line_styles([r.line for r in records])
    for axes, scene in zip(panels, scenes, strict=True):
        mine = [r for r in records if r.scene == scene]
        lines = list(dict.fromkeys(r.line for r in mine))
        for line in lines:
            _line(axes, [r for r in mine if r.line == line], styles[line], left=line == lines[0])
        _frame(axes, mine[0])
    handles = {
        label: handle for axes in panels for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    note = "Numbers at points: of mbvi the depth that it was given, of other engines the step."
    legend = figure.legend(
        list(handles.values()), list(handles), loc="outside lower center", ncols=min(4, len(handles)), fontsize="small",
        frameon=False, title=f"{note} {footnote}".strip(), title_fontsize="x-small",
    )  # fmt: skip
    legend.get_title().set_color("0.35")
    title = f"{PICTURES[records[0].picture].title}: worst depth against cost, lower left is better"
    figure.suptitle(title, fontsize="medium")
    return figure


def pile_table(records: Sequence[PileRecord]) -> str:
    """Return a Markdown table of all records."""
    lines = [
        "| scene | engine | h [ms] | depth given | CPU [s / s] | worst depth | depth at the end |",
        "|---|---|---|---|---|---|---|",
    ]
    for r in records:
        given = "-" if np.isnan(r.accuracy) else f"{r.accuracy:g}"
        cells = (
            r.pile, r.line.partition(", h =")[0], f"{1e3 * r.step:g}", given, f"{r.cpu:.3g}",
            f"{r.depth:.1e} {r.unit}", f"{r.end:.1e}",
        )  # fmt: skip
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def line_styles(lines: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Return the look of each line by its name, which begins with that of the engine."""
    from matplotlib.colors import to_rgb

    styles: dict[str, dict[str, Any]] = {}
    count: dict[str, int] = {}
    for line in dict.fromkeys(lines):
        engine = line.split()[0].rstrip(",")
        colour, marker = _STYLES.get(engine, ("C4", "s"))
        shade = _SHADES[min(count.get(engine, 0), len(_SHADES) - 1)]
        count[engine] = count.get(engine, 0) + 1
        faded = tuple(1.0 - shade * (1.0 - np.array(to_rgb(colour))))
        styles[line] = {"color": faded, "marker": marker, "linestyle": "-" if engine == "mbvi" else "--"}
    return styles


def _line(axes: Any, records: Sequence[PileRecord], style: dict[str, Any], left: bool) -> None:
    """Draw the points of a line, with their numbers on the left or on the right."""
    ours = not np.isnan(records[0].accuracy)
    points = sorted(records, key=lambda r: -(r.accuracy if ours else r.step))
    depths = [max(r.depth, _LEAST) for r in points]
    axes.loglog([r.cpu for r in points], depths, label=points[0].line, markersize=6, linewidth=1.3, **style)
    for r, depth in zip(points, depths, strict=True):
        text = f"{r.accuracy:.0e}".replace("e-0", "e-") if ours else f"{1e3 * r.step:g} ms"
        place = {"xytext": (-4, -8), "ha": "right"} if left else {"xytext": (5, 4), "ha": "left"}
        axes.annotate(text, (r.cpu, depth), textcoords="offset points", fontsize=6.5, color=style["color"], **place)


def _frame(axes: Any, first: PileRecord) -> None:
    from matplotlib.ticker import LogLocator, NullFormatter

    axes.axhline(_COMPARED, color="0.4", linewidth=1.0, linestyle=":", zorder=0)
    axes.set_title(f"{first.pile}, {first.duration:g} s", fontsize="medium")
    axes.set(xlabel="CPU time per simulated second [s / s]", ylabel=f"worst depth [{first.unit}]")
    axes.tick_params(labelleft=True)
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.grid(True, which="major", color="0.92", zorder=0)
    # room for the numbers at the points
    axes.margins(x=0.16, y=0.08)
