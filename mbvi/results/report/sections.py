"""The sections of a report below its plots: impacts, diagnosis, model, how to run it again, versions."""

from __future__ import annotations

import base64
import html
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...scene.saved.given_again import functions_to_give
from ..error_estimate import recorded_every
from ..files.hdf5 import save
from ..files.versions import versions
from ..run_data import arriving
from ..summary import regimes

if TYPE_CHECKING:
    from ..diagnosis.diagnosis import Diagnosis
    from ..run_data import Impact, RunData

# impacts in the table, and rows of each
_MOST_IMPACTS, _MOST_ROWS = 30, 6
_ROUNDING = 1e-12


def impact_section(run: RunData) -> str:
    """Return the table of the strongest impacts."""
    if not run.impacts:
        return "<h2>Impacts</h2><p>None.</p>"
    strongest = sorted(run.impacts, key=lambda impact: -float(impact.percussion.max()))[:_MOST_IMPACTS]
    friction = any(impact.regime is not None for impact in strongest)
    heads = ["time [s]", "p [N s, N m s]", "before [m/s, rad/s]", "after [m/s, rad/s]"]
    heads += ["p_t [N s]", "regime"] if friction else []
    row = "".join(f"<th>{head}</th>" for head in [*heads, "energy change [J]"]) + '<th class="text">constraint</th>'
    lines = [line for impact in sorted(strongest, key=lambda i: i.time) for line in _rows(impact, friction)]
    left = len(run.impacts) - len(strongest)
    more = f'<p class="hint">The {len(strongest)} strongest of {len(run.impacts)} impacts.</p>' if left else ""
    return f'<h2>Impacts</h2>{more}<div class="wide"><table><tr>{row}</tr>{"".join(lines)}</table></div>'


def _rows(impact: Impact, friction: bool) -> list[str]:
    """Return the rows of one impact, the strongest if there are many; the first has the time."""
    order = np.argsort(-impact.percussion, kind="stable")
    lines = []
    for place, k in enumerate(order[:_MOST_ROWS].tolist()):
        cells = [f"{impact.time:.6g}" if place == 0 else ""]
        cells += [_written(values[k]) for values in (impact.percussion, impact.before, impact.after)]
        if friction:
            known = impact.tangential is not None and regimes(impact)[k]
            cells += [_written(float(np.linalg.norm(impact.tangential[k]))), known] if known else ["", ""]  # type: ignore[index]
        cells.append(_written(impact.energy_change) if place == 0 else "")
        name = html.escape(impact.constraints[k])
        if place == 0 and len(order) > _MOST_ROWS:
            name += f' <span class="note">and {len(order) - 1} more, of which {_MOST_ROWS - 1} follow</span>'
        body = "".join(f"<td>{cell}</td>" for cell in cells)
        lines.append(f'<tr data-time="{impact.time!r}">{body}<td class="text">{name}</td></tr>')
    return lines


def _written(value: float) -> str:
    """Return a number in four digits, 0 where it is rounding."""
    return "0" if abs(value) < _ROUNDING else f"{value:.4g}"


def diagnosis_section(diagnosis: Diagnosis | None, reason: str) -> str:
    """Return the diagnosis: sentences, then its table."""
    if diagnosis is None:
        return f"<h2>Diagnosis</h2><p>{html.escape(reason[:1].upper() + reason[1:])}.</p>"
    lines = diagnosis.report().splitlines()
    table = next((k for k, line in enumerate(lines) if line.lstrip().startswith("time [s]")), len(lines))
    sentences = "".join(f"<p>{html.escape(line)}</p>" for line in lines[:table])
    text = html.escape("\n".join(lines[table:]))
    return f"<h2>Diagnosis</h2>{sentences}" + (f"<pre>{text}</pre>" if text else "")


def model_section(run: RunData) -> str:
    """Return the notes of the run and the report of its problem."""
    notes = "".join(f"<li>{html.escape(note)}</li>" for note in run.notes)
    model = "the file of this run could not bring its problem back" if run.problem is None else run.problem.report()
    return (f"<h2>Notes</h2><ul>{notes}</ul>" if notes else "") + f"<h2>Model</h2><pre>{html.escape(model)}</pre>"


def rerun_section(run: RunData) -> str:
    """Return how to run it again, with a file of its start where the problem can be kept."""
    scheme = f"mbvi.{run.record.scheme!r}" if run.record.scheme is not None else f"mbvi.{run.scheme}()"
    simulated = f"run = mbvi.simulate(problem, {', '.join((scheme, *_options(run)))})"
    problem = run.problem
    if problem is None or problem.scene is None:
        code = f"import mbvi\n\nproblem = ...  # as in the program that made this run\n{simulated}"
        return f"<h2>Run it again</h2><pre>{html.escape(code)}</pre>"
    functions = functions_to_give(problem.scene.items)
    lost = bool(functions or problem.not_kept)
    loaded = ", ".join(('"start.h5"', *functions))
    code = f"import mbvi\n\nproblem = mbvi.load({loaded}).problem\n{simulated}"
    said = "This page holds the scene and the initial state as a file: "
    what = " Functions, such as controls, are not in it and are given again." if lost else ""
    data = base64.b64encode(_start(run)).decode()
    link = f'<a download="start.h5" href="data:application/x-hdf5;base64,{data}">start.h5</a>.'
    return f"<h2>Run it again</h2><p>{said}{link}{what}</p><pre>{html.escape(code)}</pre>"


def _options(run: RunData) -> Iterator[str]:
    """Yield the options of `simulate` that made a run."""
    if run.step:
        yield f"step={float(run.step)!r}"
    yield f"duration={_duration(run)!r}"
    every = recorded_every(run) if run.step and len(run.t) > 1 else 1
    if every > 1:
        yield f"every={every}"
    given = getattr(run.record.again, "keywords", {})
    yield from (f"{name}={given[name]!r}" for name in ("residual", "depth") if given.get(name) is not None)
    if given.get("solver") is not None:
        yield f"solver=mbvi.{given['solver']!r}"
    if run.record.contacts is not None:
        yield 'record="contacts"'
    if run.record.switches:
        yield "switch=..."


def _duration(run: RunData) -> float:
    """Return the duration with the fewest digits that ends the run when it ended [s]."""
    first, last = float(run.t[0]), float(run.t[-1])
    short = (float(f"{last - first:.{digits}g}") for digits in range(1, 17))
    return next((found for found in short if first + found == last), last - first)


def _start(run: RunData) -> bytes:
    """Return the file of a run that holds the problem and the first state only."""
    assert run.problem is not None
    depths = {name: getattr(run.record, name)[:1].copy() for name in ("penetration", "limit_violation")}
    record = replace(run.record, energies=None, contacts=None, dense=None, switches=(), **depths)
    first = {name: getattr(run, name)[:1].copy() for name in ("t", "q", "residual")} | {"v": arriving(run)[:1].copy()}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "start.h5")
        save(replace(run, impacts=(), record=record, **first), path)
        return path.read_bytes()


def version_section() -> str:
    """Return the versions of the packages that computed."""
    lines = (f"{name} {value}" for name, value in versions().items())
    return f"<h2>Versions</h2><p>{html.escape(', '.join(lines))}</p>"
