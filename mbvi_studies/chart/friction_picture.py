"""The picture of scenes with friction: error against CPU time, one panel per scene, and its table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from .friction_runs import FrictionRecord
from .pile_picture import line_styles

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# errors are drawn no lower
_LEAST = 1e-16
_COLUMNS = 3


def draw_friction(records: Sequence[FrictionRecord], footnote: str = "") -> Figure:
    """Draw all records; lines join the points of an engine from its longest step.

    Parameters
    ----------
    records : sequence of FrictionRecord
        At least one.
    footnote : str
        Text below the panels, such as the machine.
    """
    from matplotlib.figure import Figure

    scenes, styles = list(dict.fromkeys(r.scene for r in records)), line_styles([r.line for r in records])
    columns = min(_COLUMNS, len(scenes))
    count = -(-len(scenes) // columns)
    figure = Figure(figsize=(4.3 * columns + 0.4, 3.9 * count + 1.2), layout="constrained")
    panels = figure.subplots(count, columns, squeeze=False).ravel()
    for axes in panels[len(scenes) :]:
        axes.remove()
    for axes, scene in zip(panels, scenes, strict=False):
        mine = [r for r in records if r.scene == scene]
        for line in dict.fromkeys(r.line for r in mine):
            points = sorted((r for r in mine if r.line == line), key=lambda r: -r.step)
            errors = [max(r.error, _LEAST) for r in points]
            axes.loglog([r.cpu for r in points], errors, label=line, markersize=6, linewidth=1.3, **styles[line])
        axes.set_title(mine[0].title, fontsize="medium")
        axes.set(xlabel="CPU time per simulated second [s / s]", ylabel=mine[0].what)
        axes.grid(True, which="major", color="0.92", zorder=0)
    handles = {k: h for axes in figure.axes for h, k in zip(*axes.get_legend_handles_labels(), strict=True)}
    steps = ", ".join(f"{1e3 * h:g}" for h in sorted({r.step for r in records}, reverse=True))
    legend = figure.legend(
        list(handles.values()), list(handles), loc="outside lower center", ncols=min(4, len(handles)), fontsize="small",
        frameon=False, title=f"Steps of {steps} ms, the longest first. {footnote}".strip(), title_fontsize="x-small",
    )  # fmt: skip
    legend.get_title().set_color("0.35")
    figure.suptitle("Friction: error against cost, lower left is better", fontsize="medium")
    return figure


def friction_table(records: Sequence[FrictionRecord]) -> str:
    """Return a Markdown table of all records."""
    lines = ["| scene | engine | h [ms] | CPU [s / s] | error |", "|---|---|---|---|---|"]
    for r in records:
        unit = r.what.rpartition(" ")[2].strip("[]")
        lines.append(f"| {r.title} | {r.line} | {1e3 * r.step:g} | {r.cpu:.3g} | {r.error:.1e} {unit} |")
    return "\n".join(lines)


def friction_summary(records: Sequence[FrictionRecord], step: float) -> str:
    """Return a Markdown table of the errors at one step, engines down and scenes across."""
    some = [r for r in records if r.step == step]
    scenes = list(dict.fromkeys(r.scene for r in some))
    found = {(r.line, r.scene): f"{r.error:.0e}" for r in some}
    lines = [f"| engine | {' | '.join(scenes)} |", f"|---{'|---' * len(scenes)}|"]
    for line in dict.fromkeys(r.line for r in some):
        lines.append(f"| {line} | {' | '.join(found.get((line, scene), '-') for scene in scenes)} |")
    return "\n".join(lines)
