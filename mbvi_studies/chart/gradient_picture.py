"""The picture of derivatives through an impact, and its table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from .gradients import DURATION, HEIGHT, GradientRecord, exact

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# colour and marker of each line, in their order
_STYLES = (("C1", "v"), ("C3", "o"), ("C3", "*"), ("0.15", "P"))
# errors are drawn no lower
_LEAST = 1e-14
# slopes are drawn in proportion up to this size, and by their logarithm beyond
_LINEAR = 2.0


def draw_gradients(records: Sequence[GradientRecord], footnote: str = "") -> Figure:
    """Draw all records: the derivative against the step, and the error of what it differentiates.

    Parameters
    ----------
    records : sequence of GradientRecord
        At least one.
    footnote : str
        Text below the panels, such as the machine.
    """
    from matplotlib.figure import Figure

    height, slope = exact()
    figure = Figure(figsize=(10.4, 4.9), layout="constrained")
    left, right = figure.subplots(1, 2)
    for line, (color, marker) in zip(dict.fromkeys(r.line for r in records), _STYLES, strict=False):
        points = sorted((r for r in records if r.line == line), key=lambda r: -r.step)
        steps, look = [r.step for r in points], {"color": color, "marker": marker, "markersize": 6, "linewidth": 1.2}
        left.plot(steps, [r.slope for r in points], label=line, **look)
        right.plot(steps, [max(abs(r.height - height), _LEAST) for r in points], label=line, **look)
    left.axhline(slope, color="0.3", linewidth=0.8, linestyle=":")
    left.text(
        0.99, slope, f"exact: {slope:.4f}", transform=left.get_yaxis_transform(), ha="right", va="bottom",
        fontsize="small",
    )  # fmt: skip
    left.set_yscale("symlog", linthresh=_LINEAR)
    left.set(ylabel="dz(T) / dz(0)", title="derivative of the height at the end by that at the start")
    right.set_yscale("log")
    right.set(ylabel="error of z(T) [m]", title="error of that height itself")
    for axes in (left, right):
        axes.set_xscale("log")
        axes.set_xlabel("time step [s] (EventDriven: its mean step)")
        axes.grid(True, which="major", color="0.92", zorder=0)
        axes.title.set_fontsize("medium")
    handles, names = left.get_legend_handles_labels()
    legend = figure.legend(
        handles, names, loc="outside lower center", ncols=2, fontsize="small", frameon=False,
        title=f"A ball falls from {HEIGHT:g} m onto a floor, e = 1, T = {DURATION:g} s. {footnote}".strip(),
        title_fontsize="x-small",
    )  # fmt: skip
    legend.get_title().set_color("0.35")
    return figure


def gradient_table(records: Sequence[GradientRecord]) -> str:
    """Return a Markdown table of the longest and the shortest step of each line, and some between."""
    height, slope = exact()
    lines = ["| by | h [ms] | dz(T) / dz(0) | error of z(T) [m] |", "|---|---|---|---|"]
    lines.append(f"| exact | | {slope:.4f} | |")
    for line in dict.fromkeys(r.line for r in records):
        points = sorted((r for r in records if r.line == line), key=lambda r: -r.step)
        some = sorted({0, len(points) // 3, 2 * len(points) // 3, len(points) - 1})
        for r in (points[k] for k in some):
            lines.append(f"| {line} | {1e3 * r.step:.3g} | {r.slope:.4f} | {abs(r.height - height):.1e} |")
    return "\n".join(lines)
