"""The report of a run as one HTML page that needs no server and no network."""

from __future__ import annotations

import html
import json
import tempfile
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import InputError, TrajectoryFileError
from ..plots.panel import BLACK, Panel
from ..plots.quantities import Omitted, panels
from ..summary import summary
from .sections import diagnosis_section, impact_section, model_section, rerun_section, version_section

if TYPE_CHECKING:
    from ..diagnosis.diagnosis import Diagnosis
    from ..run_data import RunData

_PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<link rel="icon" href="data:,">
<title>{title}</title>
<style>
{style}</style>
</head>
<body>
<h1>{title}</h1>
{summary}
{above}
{sections}
<script type="application/json" id="plots">{data}</script>
<script>
{script}</script>
</body>
</html>
"""
_BESIDE = """<div class="side">
<div class="left">{frame}<p class="hint">The red line is the time of the replay. Click a plot or an impact to see its
instant. {hint}</p></div>
<div>{charts}</div>
</div>"""
_HINT = "Drag over a plot to enlarge a part of the time; double-click to see all of it."


def write_report(
    run: RunData, path: Path, replay: Callable[[Path], None], diagnosis: Diagnosis | None, no_diagnosis: str
) -> None:
    """Write the page; see `Trajectory.report`.

    Parameters
    ----------
    run : RunData
        The run.
    path : Path
        The page.
    replay : callable
        replay(path) writes the page of its replay, or raises `InputError` where there is nothing to show.
    diagnosis : Diagnosis or None
        Its diagnosis.
    no_diagnosis : str
        Why there is none.

    Raises
    ------
    TrajectoryFileError
        If the page cannot be written.
    """
    # the last line is about notes, which have a section
    title, *lines = (html.escape(line) for line in summary(run).splitlines()[:-1])
    shown, omitted = panels(run, diagnosis, no_diagnosis)
    sections = [
        impact_section(run),
        diagnosis_section(diagnosis, no_diagnosis),
        model_section(run),
        rerun_section(run),
        version_section(),
    ]
    page = _PAGE.format(
        title=title,
        style=_beside("style.css"),
        summary='<ul class="summary">' + "".join(f"<li>{line}</li>" for line in lines) + "</ul>",
        above=_replay_and_charts(replay, f'<div id="charts"></div>{_omitted(omitted)}'),
        sections="\n".join(sections),
        data=_data(run, shown),
        script=_beside("charts.js"),
    )
    try:
        path.write_text(page, encoding="utf-8")
    except OSError as error:
        raise TrajectoryFileError(f"the report {path} cannot be written: {error.strerror or error}") from error


@cache
def _beside(name: str) -> str:
    return Path(__file__).with_name(name).read_text(encoding="utf-8")


def _replay_and_charts(replay: Callable[[Path], None], charts: str) -> str:
    """Return the plots beside a frame with the page of the replay, or why there is none."""
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder, "replay.html")
        try:
            replay(page)
        except InputError as error:
            return f'<p class="hint">No replay: {html.escape(str(error))}. {_HINT}</p>{charts}'
        text = page.read_text(encoding="utf-8")
    # of a quoted attribute only these two characters end or change the text
    text = text.replace("&", "&amp;").replace('"', "&quot;")
    frame = f'<iframe id="replay" title="replay" srcdoc="{text}"></iframe>'
    return _BESIDE.format(frame=frame, hint=_HINT, charts=charts)


def _omitted(omitted: Sequence[Omitted]) -> str:
    if not omitted:
        return ""
    lines = (f"{html.escape(one.title)}: {html.escape(one.reason)}" for one in omitted)
    return f'<p class="hint">Not shown: {"; ".join(lines)}.</p>'


def _shown(color: str) -> str:
    """Return the colour of a curve; a black one has that of text, which is light on a dark page."""
    return "currentColor" if color == BLACK else color


def _data(run: RunData, shown: Sequence[Panel]) -> str:
    """Return the plots as JSON that may stand in a page; numbers have seven digits."""
    made = [
        {
            **panel._asdict(),
            "levels": [level._asdict() for level in panel.levels],
            "curves": [
                {**curve._asdict(), "color": _shown(curve.color), "t": _rounded(curve.t), "y": _rounded(curve.y)}
                for curve in panel.curves
            ],
        }
        for panel in shown
    ]
    data = {"start": float(run.t[0]), "end": max(float(run.t[-1]), float(run.t[0]) + 1e-9), "panels": made}
    return json.dumps(data, separators=(",", ":")).replace("<", "\\u003c")


def _rounded(values: np.ndarray) -> list[Any]:
    return [None if value != value else float(f"{value:.7g}") for value in values.tolist()]
