"""The quantities of a run over time: energies, percussions, gaps, penetration, contacts, angles and friction."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...arguments import watched
from ..diagnosis.energies import energies, energies_of_run
from ..summary import limit_unit, regimes
from .panel import BLACK, Array, Curve, Level, Panel, thinned

if TYPE_CHECKING:
    from ..diagnosis.diagnosis import Diagnosis
    from ..run_data import RunData

BLUE, ORANGE, GREEN, RED, PURPLE = "#0072b2", "#e69f00", "#009e73", "#d55e00", "#8f5aa8"
GREY = "#999999"
_COLORS = (BLUE, ORANGE, GREEN, PURPLE, "#56b4e9")
# most gaps with a curve of their own, and constraints among which they are chosen
_MOST_GAPS, _MOST_NAMED = 5, 2000
# gaps are evaluated at so many states, and at fewer where there are many: so many gaps in all
_MOST_STATES, _MOST_VALUES, _FEWEST_STATES = 400, 2_000_000, 40
# contacts are counted whose gap is below so many lengths of the scene
_CLOSED = 1e-3


class Omitted(NamedTuple):
    """A plot that is left out, and why."""

    title: str
    reason: str


def panels(run: RunData, diagnosis: Diagnosis | None, no_diagnosis: str) -> tuple[list[Panel], list[Omitted]]:
    """Return the plots of a run, thinned, and those that are left out.

    Plots of friction are only mentioned where there is friction.

    Parameters
    ----------
    run : RunData
        The run.
    diagnosis : Diagnosis or None
        Its diagnosis, for the kinetic angles.
    no_diagnosis : str
        Why there is none.
    """
    made: dict[str, Callable[[], Panel | str]] = {
        "Energy": lambda: _energy(run),
        "Percussions of impacts": lambda: _percussions(run),
        "Gaps": lambda: _gaps(run, limits=False),
        "Joint limits": lambda: _gaps(run, limits=True),
        "Penetration": lambda: _penetration(run),
        "Violation of joint limits": lambda: _violation(run),
        "Closed contacts": lambda: _contacts(run),
        "Kinetic angles": lambda: no_diagnosis if diagnosis is None else _angles(diagnosis),
        "Friction": lambda: _friction(run),
        "Slip": lambda: _slip(run),
    }
    shown, omitted = list[Panel](), list[Omitted]()
    start, end = float(run.t[0]), float(run.t[-1])
    for title, make in watched(made.items(), "plots"):
        panel = make() if end > start else "the run has one state"
        if panel == "":
            continue
        if isinstance(panel, str):
            omitted.append(Omitted(title, panel))
        else:
            curves = [thinned(curve, start, end, log=panel.log) for curve in panel.curves]
            shown.append(panel._replace(curves=curves))
    return shown, omitted


def _energy(run: RunData) -> Panel | str:
    if run.record.energies is None and run.problem is None:
        return "the file of this run holds neither energies nor a problem"
    t, kinetic, potential = run.t, *energies_of_run(run).T
    if run.record.dense is not None and run.problem is not None:
        seen = _states(run, _MOST_STATES)
        found = energies(run.problem, *seen, 0.0, switches=run.record.switches)
        t, (kinetic, potential) = seen.t, found.T
    curves = [
        Curve("kinetic", t, kinetic, color=ORANGE),
        Curve("potential", t, potential, color=BLUE),
        Curve("total", t, kinetic + potential, color=BLACK),
    ]
    times = np.array([impact.time for impact in run.impacts])
    if len(times):
        curves.append(Curve("impacts", times, np.zeros(len(times)), "ticks", RED))
    return Panel("Energy", "energy [J]", curves)


def _percussions(run: RunData) -> Panel | str:
    if not run.impacts:
        return "no impacts"
    t, p, contact = _rows(run, lambda impact: impact.percussion)
    others = "joint limits" if run.problem is not None and run.problem.scene is not None else "constraints"
    curves = [
        Curve(name, t[chosen], p[chosen], "dots", color)
        for name, chosen, color in (("contacts", contact & (p > 0.0), RED), (others, ~contact & (p > 0.0), PURPLE))
        if chosen.any()
    ]
    # limits of joints that turn, and given functions
    unit = "N s" if contact.all() else "N s or N m s"
    return Panel("Percussions of impacts", f"percussion [{unit}]", curves, log=_spread(p)) if curves else "none"


def _rows(run: RunData, values: Callable[..., Array]) -> tuple[Array, Array, Array]:
    """Return time and value of each row of the impacts, and whether it is a contact in space."""
    counts = [len(impact.constraints) for impact in run.impacts]
    t = np.repeat([impact.time for impact in run.impacts], counts)
    contact = np.concatenate([np.isfinite(impact.normal).all(axis=1) for impact in run.impacts])
    return t, np.concatenate([values(impact) for impact in run.impacts]), contact


def _spread(values: Array) -> bool:
    """Return whether values need a logarithmic axis."""
    positive = values[values > 0.0]
    return bool(len(positive) and positive.max() > 50.0 * np.median(positive))


class _States(NamedTuple):
    """States at which a quantity is evaluated, shapes (n,), (n, nq) and (n, nv)."""

    t: Array
    q: Array
    v: Array


def _states(run: RunData, most: int) -> _States:
    """Return at most so many recorded states, evenly in their order; of dense output as many more between them."""
    index = np.unique(np.linspace(0, len(run.t) - 1, min(most, len(run.t))).astype(np.int64))
    t, q, v = run.t[index], run.q[index], run.v[index]
    if run.record.dense is None or run.problem is None:
        return _States(t, q, v)
    between = np.setdiff1d(np.linspace(run.t[0], run.t[-1], most), run.t)
    more = [run.at(float(time)) for time in between]
    # stable, because at an impact two states have one time
    order = np.argsort(np.concatenate([t, between]), kind="stable")
    t = np.concatenate([t, between])[order]
    q, v = np.concatenate([q, [q for q, _ in more]])[order], np.concatenate([v, [v for _, v in more]])[order]
    return _States(t, q, v)


def _note_of(run: RunData, states: _States) -> str:
    """Return at how many states a quantity was evaluated, "" if at all of them."""
    return f"at {len(states.t)} of {len(run.t)} states" if len(states.t) < len(run.t) else ""


def _gaps(run: RunData, *, limits: bool) -> Panel | str:
    problem = run.problem
    if problem is None:
        return "" if limits else "the file of this run could not bring its problem back"
    constraints = problem.constraints
    families = [family for family in constraints.families if family.of_joints is limits]
    count = sum(family.count for family in families)
    if not count:
        return "" if limits else "there are no constraints"
    if count * _FEWEST_STATES > _MOST_VALUES:
        return f"{count} constraints are too many to evaluate all of them"
    states = _states(run, min(_MOST_STATES, _MOST_VALUES // count))
    gaps = np.array(
        [
            np.concatenate([family.gap(float(t), q) for family in families])
            for t, q in zip(states.t, states.q, strict=True)
        ]
    )
    # limits come before all contacts
    first = 0 if limits else constraints.limits
    t, curves = states.t, list[Curve]()
    # only where each number has a gap of its own are they known by name
    named = gaps.shape[1] == sum(family.size for family in families) <= _MOST_NAMED
    chosen = _strongest(run, [constraints.name(first + k) for k in range(gaps.shape[1])], gaps) if named else []
    if gaps.shape[1] > len(chosen):
        curves.append(Curve("smallest of all", t, gaps.min(axis=1), color=BLACK))
    curves += [
        Curve(constraints.name(first + k), t, gaps[:, k], color=color)
        for k, color in zip(chosen, _COLORS, strict=False)
    ]
    title, axis = ("Joint limits", f"distance [{limit_unit(problem)}]") if limits else ("Gaps", "gap [m]")
    return Panel(title, axis, curves, note=_note_of(run, states), levels=[Level("", 0.0)])


def _strongest(run: RunData, names: list[str], gaps: Array) -> list[int]:
    """Return the numbers of the constraints with the greatest sums of percussions, then of the smallest gaps."""
    total = Counter[str]()
    for impact in run.impacts:
        for name, p in zip(impact.constraints, impact.percussion.tolist(), strict=True):
            total[name] += p
    # several contact points of one pair have one number and one name
    least = gaps.min(axis=0)
    return sorted(range(len(names)), key=lambda k: (-total[names[k]], least[k]))[:_MOST_GAPS]


def _penetration(run: RunData) -> Panel | str:
    depth = run.record.penetration
    if not (depth > 0.0).any():
        return "nothing penetrates"
    curve = Curve("", run.t, depth, color=PURPLE)
    return Panel("Penetration", "deepest of contacts [m]", [curve], log=True)


def _violation(run: RunData) -> Panel | str:
    beyond = run.record.limit_violation
    if not (beyond > 0.0).any():
        return "no joint is beyond its limits" if run.problem is not None and run.problem.constraints.limits else ""
    curve = Curve("", run.t, beyond, color=PURPLE)
    return Panel("Violation of joint limits", f"greatest [{limit_unit(run.problem)}]", [curve], log=True)


def _contacts(run: RunData) -> Panel | str:
    found, problem = run.record.contacts, run.problem
    if found is not None:
        counts = np.diff(found.starts)
        curves = [Curve("closed", run.t, counts.astype(float), "steps", BLUE)]
        if found.sticks is not None:
            sticks = np.concatenate([[0], np.cumsum(found.sticks)])
            curves.append(Curve("of them sticking", run.t, np.diff(sticks[found.starts]).astype(float), "steps", GREEN))
        return Panel("Closed contacts", "contacts", curves, whole=True) if counts.any() else "no contact was closed"
    if problem is None:
        return "the file of this run could not bring its problem back"
    states, near = _states(run, _MOST_STATES), _CLOSED * problem.length
    closed = [len(problem.constraints.active(float(t), q, near).gap) for t, q in zip(states.t, states.q, strict=True)]
    if not any(closed):
        return "no contact was closed"
    note = ", ".join(filter(None, [f"gap < {near:.2g} m", _note_of(run, states)]))
    curve = Curve("", states.t, np.array(closed, dtype=float), "steps", BLUE)
    return Panel("Closed contacts", "contacts", [curve], whole=True, note=note)


def _angles(diagnosis: Diagnosis) -> Panel | str:
    if not diagnosis.instants:
        return "several constraints were never active at once"
    curves = list[Curve]()
    stretches = [instant for instant in diagnosis.instants if instant.until > instant.time]
    for which in (0, 1) if stretches else ():
        t = np.array([[i.time, i.until, i.until] for i in stretches]).ravel()
        angles = np.degrees([i.extreme_angles[which] for i in stretches])
        y = np.stack([angles, angles, np.full(len(angles), np.nan)], axis=1).ravel()
        curves.append(Curve("", t, y, color=GREY))
    for name, holds, color in (("(12) holds", True, BLUE), ("(12) fails", False, RED)):
        points = [
            (time, angle)
            for instant in diagnosis.instants
            if instant.condition_12 is holds
            for angle in np.degrees(instant.extreme_angles)
            for time in {instant.time, instant.until}
        ]
        if points:
            t, y = np.array(sorted(points)).T
            curves.append(Curve(name, t, y, "dots", color))
    note = "least and greatest between gradients"
    return Panel("Kinetic angles", "angle [deg]", curves, note=note, levels=[Level("right angle", 90.0)])


def _friction(run: RunData) -> Panel | str:
    if not _frictional(run):
        return ""
    frictional = [impact for impact in run.impacts if impact.tangential is not None]
    if not frictional:
        return "no impacts"
    t = np.repeat([impact.time for impact in frictional], [len(impact.constraints) for impact in frictional])
    p = np.concatenate([impact.percussion for impact in frictional])
    tangential = np.concatenate([np.linalg.norm(np.asarray(impact.tangential), axis=1) for impact in frictional])
    # "" of joint limits and others without friction
    regime = np.array([word for impact in frictional for word in regimes(impact)])
    acts = p > 0.0
    curves = []
    for word, color in (("stick", BLUE), ("slip", RED)):
        chosen = acts & (regime == word)
        if chosen.any():
            curves.append(Curve(word, t[chosen], tangential[chosen] / p[chosen], "dots", color))
    levels = [Level(f"mu = {mu:g}", mu) for mu in _coefficients(run)]
    axis = "|p_t| / p [1]"
    return Panel("Friction in impacts", axis, curves, levels=levels) if curves else "no percussion with friction"


def _frictional(run: RunData) -> bool:
    """Return whether the run has friction."""
    if run.problem is not None:
        return run.problem.constraints.frictional
    return any(impact.regime is not None for impact in run.impacts)


def _coefficients(run: RunData) -> list[float]:
    """Return the coefficients of friction of the scene, none where there are many."""
    scene = None if run.problem is None else run.problem.scene
    if scene is None:
        return []
    found = sorted({scene.items.friction, *scene.items.pair_friction.values()} - {0.0})
    return found if len(found) <= 3 else []


def _slip(run: RunData) -> Panel | str:
    found = run.record.contacts
    if not _frictional(run):
        return ""
    if found is None or found.slip is None:
        return 'the run did not record contacts: simulate(..., record="contacts") does'
    speed = np.linalg.norm(found.slip, axis=1)
    # limits have no place in space
    seen = np.isfinite(found.normal[:, 0]) & (found.percussion > 0.0)
    if not seen.any():
        return "no contact was closed"
    interval = np.repeat(np.arange(len(found.starts) - 1), np.diff(found.starts))[seen]
    fastest = np.full(len(run.t), np.nan)
    np.fmax.at(fastest, interval, speed[seen])
    return Panel("Slip", "fastest slip [m/s]", [Curve("", run.t, fastest, "dots", GREEN)], log=_spread(speed[seen]))
