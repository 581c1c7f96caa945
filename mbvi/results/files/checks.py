"""Checks that the columns of a file belong to a run of its problem: shapes, order, numbers, names, energies."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import TrajectoryFileError
from ...scene.saved.description import CONSTRAINTS_BY_HAND, describe
from ...schemes import EventDriven
from ..diagnosis.energies import energies
from ..run_data import Array, Switch
from .metadata import Metadata, ProblemData

if TYPE_CHECKING:
    from ...problem import Problem

# how far from 1 the length of a quaternion or of a normal may be
_UNIT = 1e-6
# energies are computed again at so many states, and may differ by so much of the largest
_STATES, _ENERGY = 9, 1e-6
# constraints are listed to compare names up to so many
_LISTED = 100_000


def check_states(states: dict[str, Array], dense: Array | None, metadata: Metadata, problem: Problem | None) -> None:
    """Raise `TrajectoryFileError` unless these can be the states of a run."""
    t, n = states["t"], len(states["t"])
    if not n:
        raise TrajectoryFileError("it holds no states")
    for name, values in states.items():
        # a problem given by functions may have no energy
        if len(values) != n and not (name == "energy" and not len(values)):
            raise TrajectoryFileError(f"{name} has {len(values)} rows and t has {n}")
        if not np.isfinite(values).all() and not (name == "energy" and problem is None):
            raise TrajectoryFileError(f"{name} holds numbers that are not finite")
    for name in ("penetration", "limit_violation", "residual"):
        if states[name].min() < 0.0:
            raise TrajectoryFileError(f"{name} holds negative numbers")
    gaps = np.diff(t)
    if (gaps < 0.0).any() or (metadata.step > 0.0 and (gaps == 0.0).any()):
        raise TrajectoryFileError("the times of its states do not ascend")
    kept = metadata.problem
    if kept is not None and t[0] != kept.t0:
        raise TrajectoryFileError(f"its first state is at t = {t[0]:g}, and its problem starts at {kept.t0:g}")
    if metadata.scheme == EventDriven.__name__ and n > 1 and dense is None:
        raise TrajectoryFileError("it has no column dense")
    if dense is not None and (len(dense) != max(n - 1, 0) or not np.isfinite(dense).all()):
        raise TrajectoryFileError(f"dense has {len(dense)} rows for {n} states, or numbers that are not finite")
    if problem is not None:
        for group in problem.system.unit_groups():
            length = np.linalg.norm(states["q"][:, group], axis=-1)
            if np.abs(length - 1.0).max(initial=0.0) > _UNIT:
                raise TrajectoryFileError("q holds a rotation that is not of unit length")


def check_impacts(
    impacts: dict[str, Array], t: Array, metadata: Metadata, problem: Problem | None, switches: Sequence[Switch] = ()
) -> None:
    """Raise `TrajectoryFileError` unless these can be the impacts of a run with states at t."""
    instant, n = impacts["instant"], len(impacts["instant"])
    for name, values in impacts.items():
        if len(values) != n:
            raise TrajectoryFileError(f"impacts/{name} has {len(values)} rows and impacts/instant has {n}")
    if not n:
        return
    steps = np.diff(instant, prepend=-1)
    if instant[0] != 0 or ((steps != 0) & (steps != 1)).any():
        raise TrajectoryFileError("impacts/instant does not count from 0 on")
    for name in ("time", "percussion", "before", "after", "energy_change"):
        if not np.isfinite(impacts[name]).all():
            raise TrajectoryFileError(f"impacts/{name} holds numbers that are not finite")
    if impacts["percussion"].min() < 0.0:
        raise TrajectoryFileError("impacts/percussion holds negative numbers")
    for name in ("time", "energy_change"):
        if (np.diff(impacts[name])[steps[1:] == 0] != 0.0).any():
            raise TrajectoryFileError(f"impacts/{name} differs within one impact")
    time, slack = impacts["time"], 1e-9 * max(abs(t[0]), abs(t[-1]), metadata.step)
    if (np.diff(time) < 0.0).any() or time[0] < t[0] or (metadata.complete and time[-1] > t[-1] + slack):
        raise TrajectoryFileError("the times of its impacts do not ascend within those of its states")
    _check_places(impacts, "impacts", problem, switches)
    _check_friction(impacts, "impacts", problem)
    if (np.abs(impacts.get("e_used", np.zeros(1)) - 0.5) > 0.5).any():
        raise TrajectoryFileError("impacts/e_used holds numbers outside [0, 1]")


def check_contacts(
    contacts: dict[str, Array], t: Array, problem: Problem | None, switches: Sequence[Switch] = ()
) -> None:
    """Raise `TrajectoryFileError` unless these can be the contacts of a run with states at t."""
    if not _check_intervals(contacts, "contacts", t):
        return
    percussion = contacts["percussion"]
    if not np.isfinite(percussion).all() or percussion.min() < 0.0:
        raise TrajectoryFileError("contacts/percussion holds numbers that are negative or not finite")
    _check_places(contacts, "contacts", problem, switches)
    _check_friction(contacts, "contacts", problem)


def check_corrections(
    corrections: dict[str, Array], t: Array, problem: Problem | None, switches: Sequence[Switch] = ()
) -> None:
    """Raise `TrajectoryFileError` unless these can be the corrections of a run with states at t."""
    if not _check_intervals(corrections, "corrections", t):
        return
    if not np.isfinite(corrections["wrench"]).all():
        raise TrajectoryFileError("corrections/wrench holds numbers that are not finite")
    _check_names(corrections, "corrections", problem, switches)


def _check_intervals(rows: dict[str, Array], table: str, t: Array) -> bool:
    """Raise unless rows can be those of intervals between states at t; return whether there are any."""
    interval = rows["interval"]
    for name, values in rows.items():
        if len(values) != len(interval):
            raise TrajectoryFileError(f"{table}/{name} has {len(values)} rows; {table}/interval has {len(interval)}")
    if not len(interval):
        return False
    if (np.diff(interval) < 0).any() or interval[0] < 1 or interval[-1] >= len(t):
        raise TrajectoryFileError(f"{table}/interval does not ascend within the numbers of the states")
    if (np.diff(t)[interval - 1] == 0.0).any():
        raise TrajectoryFileError(f"{table}/interval names an interval that takes no time")
    return True


def _check_friction(rows: dict[str, Array], table: str, problem: Problem | None) -> None:
    """Raise unless the friction of some rows can be that of contacts of the problem."""
    if problem is not None and CONSTRAINTS_BY_HAND not in problem.not_kept:
        if problem.constraints.frictional != ("regime" in rows):
            raise TrajectoryFileError(f"{table} have friction, or lack it, against their problem")
    if "regime" not in rows:
        return
    for name in ("tangential", "slip", "angular", "slip_before", "slip_after", "e_used"):
        if not np.isfinite(rows.get(name, 0.0)).all():
            raise TrajectoryFileError(f"{table}/{name} holds numbers that are not finite")
    words = {word.decode() for word in set(rows["regime"].tolist())}
    if not words <= {"stick", "slip", "open"}:
        raise TrajectoryFileError(f"{table}/regime holds other words than stick, slip and open")


def _check_places(rows: dict[str, Array], table: str, problem: Problem | None, switches: Sequence[Switch]) -> None:
    """Raise unless points, normals and names of some rows can be those of contacts of the problem."""
    point, normal = np.isnan(rows["point"]), np.isnan(rows["normal"])
    whole = (point.all(axis=1) & normal.all(axis=1)) | ~(point.any(axis=1) | normal.any(axis=1))
    length = np.linalg.norm(rows["normal"][~normal.any(axis=1)], axis=1)
    if not whole.all() or np.isinf(rows["point"]).any() or (np.abs(length - 1.0) > _UNIT).any():
        raise TrajectoryFileError(f"{table} hold contact points that are not finite, or normals not of length 1")
    _check_names(rows, table, problem, switches)


def _check_names(rows: dict[str, Array], table: str, problem: Problem | None, switches: Sequence[Switch]) -> None:
    """Raise unless the names of some rows can be those of constraints of the problem."""
    names = {name.decode() for name in set(rows["constraint"].tolist())}
    if problem is not None and CONSTRAINTS_BY_HAND not in problem.not_kept:
        problems = [problem, *(one.problem for one in switches if one.problem is not None)]
        known = set().union(*(_constraint_names(one, names) for one in problems))
        unknown = sorted(names - known - {name for one in switches for name in one.connections})
        if unknown:
            raise TrajectoryFileError(f"{table} name {unknown[0]!r}, which its problem does not have")


def check_problem(
    problem: Problem, kept: ProblemData, states: dict[str, Array], metadata: Metadata, switches: Sequence[Switch] = ()
) -> None:
    """Raise `TrajectoryFileError` unless the problem is that of the states and was read without loss."""
    data = json.loads(kept.scene)
    if list(problem.system.bodies[1:]) != data["order_of_q_and_v"]:
        raise TrajectoryFileError("its bodies are not in the order of its scene")
    if states["q"][0].tobytes() != kept.q0.tobytes():
        raise TrajectoryFileError("its first state is not that of its problem")
    active = problem.constraints.active(kept.t0, kept.q0, problem.tolerance)
    alone = not len(active.gap) and CONSTRAINTS_BY_HAND not in problem.not_kept
    alone = alone and not (switches and switches[0].time == kept.t0)
    # a run starts with the nearest velocity that keeps its loops
    alone = alone and np.allclose(problem.system.tangent(kept.q0, kept.v0), kept.v0, rtol=0.0, atol=1e-12)
    if states["v"][0].tobytes() != kept.v0.tobytes() and alone:
        raise TrajectoryFileError("its first velocity is not that of its problem, and nothing touches at the start")
    for group in problem.system.unit_groups():
        if (np.abs(np.linalg.norm(kept.q0[group], axis=-1) - 1.0) > _UNIT).any():
            raise TrajectoryFileError("problem/q0 holds a rotation that is not of unit length")
    if metadata.old:
        return
    # functions that were kept by nothing are listed only once they are lost
    data.pop("not_kept", None)
    differs = _difference(data, json.loads(describe(problem)), "problem/scene")
    if differs:
        raise TrajectoryFileError(f"{differs} cannot be read without loss")
    found = states["energy"]
    if len(found):
        # spread over the run, and where numbers are largest
        largest = [int(np.abs(states[name]).max(axis=1).argmax()) for name in ("q", "v", "energy")]
        some = np.unique([*np.linspace(0, len(found) - 1, _STATES).astype(int), *largest])
        t, q, v = (states[name][some] for name in ("t", "q", "v"))
        again = energies(problem, t, q, v, metadata.step, metadata.jump, switches)
        weight = np.abs(problem.system.force(float(t[0]), q[0], np.zeros_like(v[0]))).sum() * problem.length
        scale = np.median(np.abs(again).sum(axis=1)) + weight
        # written so that a NaN is refused too
        if not (np.isfinite(again) & (np.abs(again - found[some]) <= _ENERGY * (np.abs(again) + scale))).all():
            raise TrajectoryFileError("its energies are not those of its states: its scene is another one")


def _constraint_names(problem: Problem, wanted: set[str]) -> set[str]:
    """Return which of the wanted names are those of constraints."""
    constraints, scene = problem.constraints, problem.scene
    if len(constraints) <= _LISTED:
        return wanted & {constraints.name(k) for k in range(len(constraints))}
    parts = {body for body in problem.system.bodies}
    if scene is not None:
        parts |= {s.name for s in scene.shapes} | set(scene.walls) | {s.name for s in scene.surfaces}
        parts |= {name for item in scene.items.spheres for name in item.names()}
    # pairs of many bodies are not listed
    return {name for name in wanted if all(part in parts or " limit" in part for part in name.split(" | "))}


def _difference(given: Any, found: Any, where: str) -> str | None:
    """Return the first place where `found` lacks or changes a value of `given`, or None; it may hold more values."""
    if isinstance(given, dict) and "source" in given and found is None:
        # a motion of the user's, which no file can keep
        return None
    if isinstance(given, dict) and isinstance(found, dict):
        pairs = [(value, found.get(key, _difference), f"{where}/{key}") for key, value in given.items()]
    elif isinstance(given, list) and isinstance(found, list) and len(given) == len(found):
        pairs = [(a, b, f"{where}[{k}]") for k, (a, b) in enumerate(zip(given, found, strict=True))]
    else:
        same = given == found and isinstance(given, bool) == isinstance(found, bool)
        return None if same else where
    return next((place for place in (_difference(*pair) for pair in pairs) if place), None)
