"""A run as text: its summary in five lines, and the table of its impacts."""

from __future__ import annotations

import html
from collections import Counter
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arguments import integer
from ..scene.overview import things_of
from .diagnosis.energies import end_energies
from .run_data import Impact, RunData

if TYPE_CHECKING:
    from ..problem import Problem

# characters of a note that are shown
_NOTE = 100
_ROUNDING = 1e-12
# impacts that a notebook shows
_SHOWN = 12


def summary(run: RunData) -> str:
    """Return five lines: the problem and scheme, impacts, energy, accuracy, and notes.

    The cost does not depend on the length of the run, except for the largest penetration, residual and percussion.
    """
    return "\n".join((_what(run), _impacts(run), _energy(run), _accuracy(run), _notes(run)))


def _what(run: RunData) -> str:
    step = f", h = {run.step:g} s" if run.step else ""
    times = f"t = {run.t[0]:.6g} to {run.t[-1]:.6g} s" if len(run.t) else "no time"
    cut = "" if run.complete else ", cut off before its end"
    count, dofs = len(run.t), run.v.shape[1]
    freedom = f"{dofs} degree{'s' * (dofs != 1)} of freedom"
    states = f"{times} in {count} state{'s' * (count != 1)}{cut}"
    return f"Run of {things_of(run.problem)}, {freedom}, by {run.scheme}{step}: {states}"


def _impacts(run: RunData) -> str:
    found = run.impacts
    if not found:
        return "No impacts"
    strongest = max(found, key=lambda impact: float(impact.percussion.max(initial=0.0)))
    k = int(strongest.percussion.argmax())
    when = f"at t = {found[0].time:.6g} s"
    if len(found) > 1:
        when = f"from t = {found[0].time:.6g} to {found[-1].time:.6g} s"
    # a joint limit has no normal; its unit depends on the joint
    unit = " N s" if np.isfinite(strongest.normal[k]).all() else ""
    where = f"{strongest.percussion[k]:.4g}{unit} at t = {strongest.time:.6g} s, {strongest.constraints[k]}"
    return f"{len(found)} impact{'s' * (len(found) > 1)} {when}{_regimes(run)}; the strongest percussion is {where}"


def _regimes(run: RunData) -> str:
    """Return how many contacts with friction stick and slip in impacts; nothing without friction."""
    found = Counter(word for impact in run.impacts for word in regimes(impact))
    return f", where {found['stick']} contacts stick and {found['slip']} slip" if found else ""


def regimes(impact: Impact) -> list[str]:
    """Return "stick", "slip" or "open" of each row, "" where it has no friction; an empty list without friction."""
    if impact.regime is None or impact.tangential is None:
        return []
    # the tangential percussion of a contact that slips is mu p
    pairs = zip(impact.regime, impact.tangential, strict=True)
    return [word if word == "stick" or percussion.any() else "" for word, percussion in pairs]


def _energy(run: RunData) -> str:
    known = end_energies(run)
    if known is None or not np.isfinite(known).all():
        return "Energy not known"
    first, last = known
    return f"Energy {first:.6g} J at the start, {last:.6g} J at the end: {last - first:+.4g} J"


def _accuracy(run: RunData) -> str:
    depth, residual = run.record.penetration, run.residual
    if not len(depth):
        return "No step was taken"
    k = int(depth.argmax())
    deepest = "No penetration"
    if depth[k] > 0.0:
        deepest = f"Deepest penetration {depth[k]:.3g} m at t = {run.t[k]:.6g} s"
    beyond = run.record.limit_violation
    farthest = int(beyond.argmax())
    if beyond[farthest] > _ROUNDING:
        unit = limit_unit(run.problem)
        deepest += f"; joint limits violated by {beyond[farthest]:.3g} {unit} at t = {run.t[farthest]:.6g} s"
    worst = float(residual.max())
    # smaller residuals are rounding
    return f"{deepest}; largest residual {f'{worst:.2g}' if worst > _ROUNDING else f'below {_ROUNDING:.0e}'}"


def limit_unit(problem: Problem | None) -> str:
    """Return the unit of violations of joint limits."""
    found = set[bool]()
    if problem is not None:
        slides = problem.system.are_lengths()
        limits: Any = [family for family in problem.constraints.families if family.of_joints]
        found = {bool(slides[k]) for family in limits for k in family.arrays[4]}
    if len(found) == 1:
        return "m" if found.pop() else "rad"
    return "rad or m"


def _notes(run: RunData) -> str:
    scene = run.problem is not None and run.problem.scene is not None
    further = f"run.impact_table(), run.diagnosis(){' and run.replay()' * scene} say more"
    if not run.notes:
        return f"No notes; {further}"
    first, others = run.notes[0], len(run.notes) - 1
    # a note may be a paragraph
    shown = first if len(first) <= _NOTE else f"{first[:_NOTE].rsplit(' ', 1)[0]} ..."
    more = f" (and {others} more in run.notes)" if others else ""
    return f"{shown}{more}; {further}".replace("\n", " ")


def impact_table(run: RunData, most: int) -> str:
    """Return the impacts as a table, the `most` strongest if there are more."""
    most = integer(most, "most")
    strongest = sorted(run.impacts, key=lambda i: -float(i.percussion.max()))[:most]
    friction = any(impact.regime is not None for impact in strongest)
    head = f"  {'p_t [N s]':>10}  {'regime':>6}" if friction else ""
    lines = [f"{'time [s]':>10}  {'p [N s]':>10}  {'before':>9}  {'after':>9}{head}  constraint"]
    for impact in sorted(strongest, key=lambda i: i.time):
        for k, name in enumerate(impact.constraints):
            time, more = f"{impact.time:10.4f}" if k == 0 else " " * 10, ""
            p, before, after = rounded(impact, k)
            if impact.tangential is not None:
                more = f"  {np.linalg.norm(impact.tangential[k]):10.4g}  {regimes(impact)[k]:>6}"
            lines.append(f"{time}  {p:10.4g}  {before:9.4g}  {after:9.4g}{more}  {name}")
    left = len(run.impacts) - len(strongest)
    return "\n".join(lines + ([f"and {left} weaker ones"] if left else []))


def rounded(impact: Impact, k: int) -> tuple[float, float, float]:
    """Return percussion and both velocities of a row, those that are rounding beside the others of the impact as 0."""
    speed = max(np.abs(impact.before).max(), np.abs(impact.after).max())
    values = (impact.percussion, impact.percussion.max()), (impact.before, speed), (impact.after, speed)
    p, before, after = (0.0 if abs(one[k]) <= _ROUNDING * most else float(one[k]) for one, most in values)
    return p, before, after


def notebook(run: RunData) -> str:
    """Return the summary and a picture of the last state as HTML, and the strongest impacts behind a click."""
    first, *lines = (html.escape(line) for line in summary(run).splitlines())
    text = f"<b>{first}</b>" + "".join(f"<br>{line}" for line in lines)
    if run.problem is not None and run.problem.scene is not None and len(run.t):
        text += f"<div>{run.problem.scene.picture(run.q[-1], float(run.t[-1]))}</div>"
    if not run.impacts:
        return f"<div>{text}</div>"
    table = html.escape(impact_table(run, _SHOWN))
    return f"<div>{text}<details><summary>strongest impacts</summary><pre>{table}</pre></details></div>"
