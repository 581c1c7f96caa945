"""The heat map of a sweep: scenes down, schemes or engines and steps across."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from .scenes import SCENES
from .sweep import Cell

_COLOURS = {"held": "#b7dfb0", "degraded": "#ffe08a", "failed": "#f1a7a0", "too slow": "#d9d9d9",
            "refused": "#eef1f5", "not run": "#ffffff"}  # fmt: skip
_WORDS = {"too slow": "slow", "refused": "-", "not run": ""}
_WIDTH, _HEIGHT, _MARGIN, _HEAD = 0.62, 0.34, 2.9, 2.2
_NOTE = (
    "The number of a cell is what stands below the name of its scene; each scene has its own two bounds of it.   "
    "error: the run ended with one.   slow: it reached its limit of CPU time.   -: not for this scheme."
)


def draw(cells: Sequence[Cell], paths: Sequence[Path]) -> None:
    """Draw the cells, each with its number, and what the numbers are, and write the picture to every path.

    Parameters
    ----------
    cells : sequence of Cell
        Cells of a sweep.
    paths : sequence of Path
        Files; the suffix gives the format.
    """
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch, Rectangle

    scenes = list(dict.fromkeys(cell.scene for cell in cells))
    columns = list(dict.fromkeys((cell.scheme, cell.step) for cell in cells))
    figure = Figure(figsize=(_MARGIN + _WIDTH * len(columns), _HEAD + _HEIGHT * len(scenes)), layout="constrained")
    axes = figure.subplots()
    for cell in cells:
        x, y = columns.index((cell.scheme, cell.step)), scenes.index(cell.scene)
        axes.add_patch(Rectangle((x, y), 1, 1, facecolor=_COLOURS[cell.verdict], edgecolor="white"))
        axes.text(x + 0.5, y + 0.5, number(cell), ha="center", va="center", fontsize=6.5)
    axes.set(xlim=(0, len(columns)), ylim=(len(scenes), 0))
    axes.set_xticks([k + 0.5 for k in range(len(columns))], [f"{step:.0e}".replace("e-0", "e-") for _, step in columns])
    axes.set_yticks([k + 0.5 for k in range(len(scenes))], [""] * len(scenes))
    axes.tick_params(length=0, labelsize=7.5)
    numbers = {scene.name: scene.number for scene in SCENES}
    for k, name in enumerate(scenes):
        axes.text(-0.12, k + 0.36, name, ha="right", va="center", fontsize=7.5)
        axes.text(-0.12, k + 0.72, numbers.get(name, ""), ha="right", va="center", fontsize=5.5, color="0.4")
    for name in dict.fromkeys(scheme for scheme, _ in columns):
        own = [k for k, (scheme, _) in enumerate(columns) if scheme == name]
        axes.text(0.5 * (own[0] + own[-1] + 1), -0.25, name.replace(", ", ",\n"), ha="center", va="bottom", fontsize=8)
        axes.axvline(own[0], color="black", lw=1.2)
    axes.set_xlabel("time step [s]; for EventDriven its tolerance", fontsize=8)
    for spine in axes.spines.values():
        spine.set_visible(False)
    legend = figure.legend(
        handles=[Patch(facecolor=colour, label=verdict) for verdict, colour in _COLOURS.items()],
        loc="outside lower center", ncols=len(_COLOURS), fontsize=8, frameon=False, title=_NOTE, title_fontsize=6.5,
    )  # fmt: skip
    legend.get_title().set_color("0.35")
    for path in paths:
        figure.savefig(path, dpi=150)


def number(cell: Cell) -> str:
    """Return the number of a cell in few characters, or the reason why it has none."""
    if cell.verdict in _WORDS:
        return _WORDS[cell.verdict]
    if cell.value == float("inf"):
        return "error"
    return "0" if cell.value == 0.0 else f"{cell.value:.0e}".replace("e-0", "e-").replace("e+0", "e").replace("e+", "e")
