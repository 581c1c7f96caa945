"""Reads a run from a file and checks all of it."""

from __future__ import annotations

import copy
import os
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np

from ...arguments import file_path
from ...constraints import AdmissibleSet
from ...errors import MbviError, MbviWarning, TrajectoryFileError
from ...scene.items import Force
from ...scene.saved.description import CONSTRAINTS_BY_HAND, restore
from ...scene.saved.given_again import Controls, GivenAgain, given_again
from ...schemes import SCHEMES, SchemeBase, Timing
from ..contacts import ContactTable, CorrectionTable
from ..run_data import Array, Impact, RunRecord
from ..trajectory import Trajectory
from .checks import check_contacts, check_corrections, check_impacts, check_problem, check_states
from .columns import (
    CONTACT_FRICTION,
    CONTACTS,
    CORRECTIONS,
    DENSE,
    IMPACT_FRICTION,
    IMPACTS,
    RESISTANCE,
    STATES,
    Column,
    Sums,
    read_column,
)
from .metadata import Metadata, ProblemData, check_digest, read_metadata
from .switches import switches_of, with_problems
from .verification import opened

if TYPE_CHECKING:
    from ...problem import Problem

_FUNCTIONS = "the problem or its system was given by functions, which a file cannot keep: run.problem is None"

# a column that earlier files do not have, and what is noted of them
_LIMITS = "limit_violation"
_NO_TORQUES = "the file was written by an earlier version: torques of torsional and rolling friction are missing"
_TOGETHER = "the file was written by an earlier version: penetration() holds violations of joint limits, too [m or rad]"


def load(
    path: str | os.PathLike[str],
    control: Controls | None = None,
    force: Mapping[str, Force | Sequence[Force]] | None = None,
) -> Trajectory:
    """Read a trajectory.

    Parameters
    ----------
    path : path
        A file of `Trajectory.save` or `simulate(out=...)`, that of a killed run included.
    control : dict of str to callable, callable, or list of these, optional
        The control of each robot that had one, by the robot's name; those of the whole scene as functions of the state,
        all of them in their order: `[{"hopper": f}, g]` for both. A file cannot keep functions.
    force : dict of str to callable, or to a list of them, optional
        The external forces by the name of the body or link they act on; a list where several act on one.

    Returns
    -------
    Trajectory
        With its problem, if that was built by a `Scene`. What the file could not keep is named by a `MbviWarning` and
        in the notes, and simulating the problem raises until it is given again.

    Raises
    ------
    TrajectoryFileError
        If the file is missing, damaged, truncated, of another kind, or written by a run that is still going on.
    InputError
        If `control` or `force` names what had none, is no function, or gives more or fewer than there were.
    """
    where = os.fsdecode(file_path(path))
    try:
        # numbers of any size are checked below: no warnings of overflow
        with np.errstate(all="ignore"):
            run, kept = _read(where)
    except TrajectoryFileError as error:
        text = str(error)
        raise TrajectoryFileError(text if where in text else f"{where} cannot be used: {text}") from error
    except MbviError as error:
        raise TrajectoryFileError(f"{where} holds a problem that cannot be built: {error}") from error
    except Exception as error:
        # a changed file may make h5py or numpy raise any exception
        why = (str(error) or type(error).__name__).splitlines()[0]
        raise TrajectoryFileError(f"{where} holds contents that are not of a run: {why}") from error
    if run.problem is None or kept is None:
        return run
    if control is not None or force is not None:
        problem = _problem(kept, given_again(control, force, kept.scene, where))
        assert problem is not None
        switches = with_problems(problem, run.record.switches)
        run = replace(run, problem=problem, record=replace(run.record, switches=switches))
    return _named(run, where)


def _read(path: str) -> tuple[Trajectory, ProblemData | None]:
    with opened(path) as file:
        metadata = read_metadata(file)
        kept = metadata.problem
        problem = None if kept is None else _problem(kept, GivenAgain())
        sizes = _sizes(file, problem)
        # earlier files keep limits of joints and contacts in one column
        known = {name: column for name, column in STATES.items() if name != _LIMITS or name in file}
        states = {name: read_column(file, name, column, sizes) for name, column in known.items()}
        impacts = _table(file["impacts"], IMPACTS, IMPACT_FRICTION)
        dense = read_column(file, "dense", DENSE, sizes) if "dense" in file else None
        contacts = corrections = None
        if "contacts" in file:
            contacts = _table(file["contacts"], CONTACTS, CONTACT_FRICTION)
        # files of earlier versions have none
        if "corrections" in file:
            corrections = _table(file["corrections"], CORRECTIONS, {})
        tables = {"": states, "impacts/": impacts, "contacts/": contacts or {}, "corrections/": corrections or {}}
        found = Sums()
        for table, columns in tables.items():
            for name, values in columns.items():
                found.add(table + name, values)
        if dense is not None:
            found.add("dense", dense)
        check_digest(file, metadata, found)
    if metadata.old and not metadata.complete:
        states, impacts, dense = _whole_rows(states, impacts, dense)
    notes = metadata.notes if kept is None or problem is not None else _noted(metadata.notes, _FUNCTIONS)
    if _LIMITS not in states:
        states[_LIMITS] = np.zeros(len(states["t"]))
        if problem is None or problem.constraints.limits:
            notes = _noted(notes, _TOGETHER)
    resists = problem is not None and problem.constraints.resistance is not None
    if resists and ("angular" not in impacts or (contacts is not None and "angular" not in contacts)):
        notes = _noted(notes, _NO_TORQUES)
    scheme = _scheme(metadata)
    check_states(states, dense, metadata, problem)
    widths = states["q"].shape[1], states["v"].shape[1]
    switches = switches_of(metadata.switches, states["t"], widths, metadata.complete)
    if problem is not None:
        switches = with_problems(problem, switches)
    check_impacts(impacts, states["t"], metadata, problem, switches)
    if contacts is not None:
        check_contacts(contacts, states["t"], problem, switches)
    if corrections is not None:
        check_corrections(corrections, states["t"], problem, switches)
    if problem is not None and kept is not None:
        check_problem(problem, kept, states, metadata, switches)
    t, q, v, penetration, residual = (states[n] for n in ("t", "q", "v", "penetration", "residual"))
    run = Trajectory(
        t,
        q,
        v,
        _impacts(impacts),
        residual,
        metadata.scheme,
        metadata.step,
        notes,
        problem,
        metadata.complete,
        RunRecord(
            penetration,
            scheme,
            replace(Timing() if scheme is None else scheme.timing, jump=metadata.jump),
            dense,
            states["energy"] if len(states["energy"]) else None,
            None if contacts is None else _contacts(contacts, corrections, len(t)),
            states[_LIMITS],
            switches=switches,
        ),
    )
    return run, kept


def _table(group: h5py.Group, columns: dict[str, Column], friction: dict[str, Column]) -> dict[str, Array]:
    """Return the columns of impacts or contacts, with those of friction if the file has them."""
    # files of earlier versions have no torques
    more = friction | {name: column for name, column in RESISTANCE.items() if name in group}
    known = columns | more if "regime" in group else columns
    return {name: read_column(group, name, column, {}) for name, column in known.items()}


def _problem(kept: ProblemData, functions: GivenAgain) -> Problem | None:
    """Return the problem of a file with its initial state; None if the problem was given by functions."""
    built = restore(kept.scene, functions)
    if built is None:
        return None
    by_hand = CONSTRAINTS_BY_HAND in built.not_kept
    for name in ("q0", "v0") if by_hand else ("q0", "v0", "restitution"):
        found, given = getattr(kept, name), getattr(built, name)
        if found.shape != given.shape:
            raise TrajectoryFileError(f"problem/{name} has shape {found.shape}; that of the scene is {given.shape}")
    # a copy, because the initial state of a run need not be admissible
    problem = copy.copy(built)
    problem.q0, problem.v0, problem.t0 = kept.q0, kept.v0, kept.t0
    for values in (problem.q0, problem.v0):
        values.setflags(write=False)
    if kept.length is not None and kept.length != built.length:
        problem.length, problem.tolerance = kept.length, built.tolerance / built.length * kept.length
    if not by_hand and not np.array_equal(kept.restitution, built.restitution):
        if not ((kept.restitution >= 0.0) & (kept.restitution <= 1.0)).all():
            raise TrajectoryFileError("problem/restitution holds numbers outside [0, 1]")
        problem.restitution = kept.restitution
        problem.constraints = AdmissibleSet(
            built.system, built.constraints.constraints, kept.restitution, built.friction
        )
        problem.constraints.resistance = built.constraints.resistance
    return problem


def _named(run: Trajectory, path: str) -> Trajectory:
    """Return the run with a note naming the functions that its file could not keep, and warn."""
    lost = () if run.problem is None else run.problem.not_kept
    if not lost:
        return run
    note = f"the file could not keep: {', '.join(lost)}"
    warnings.warn(f"{path}: {note}; simulating this problem raises until it is given again", MbviWarning, stacklevel=3)
    return replace(run, notes=_noted(run.notes, note))


def _noted(notes: tuple[str, ...], note: str) -> tuple[str, ...]:
    return notes if note in notes else (*notes, note)


def _sizes(file: h5py.File, problem: Problem | None) -> dict[str, int]:
    """Return the numbers of q and v: those of the problem, else those of the columns themselves."""
    shapes: dict[str, tuple[int, ...]] = {name: getattr(file.get(name), "shape", ()) for name in ("q", "v")}
    if problem is not None:
        sizes = {"nq": problem.system.nq, "nv": problem.system.nv}
    elif all(len(shape) == 2 for shape in shapes.values()):
        sizes = {"nq": shapes["q"][1], "nv": shapes["v"][1]}
    else:
        raise TrajectoryFileError(f"q and v have shapes {shapes['q']} and {shapes['v']}; two axes each are expected")
    if "dense" in file:
        shape: tuple[int, ...] = getattr(file["dense"], "shape", None) or (0,)
        sizes["degree"] = shape[-1]
    return sizes


def _scheme(metadata: Metadata) -> SchemeBase | None:
    """Return the scheme of a run, None where its name is that of another version or of a user's scheme."""
    known = SCHEMES.get(metadata.scheme)
    if known is None:
        return None
    try:
        scheme = known(**metadata.options)
    except (TypeError, ValueError, MbviError) as error:
        raise TrajectoryFileError(f"{metadata.scheme} cannot be made with {metadata.options}: {error}") from error
    jump = scheme.timing.jump
    if not metadata.old and jump != metadata.jump:
        raise TrajectoryFileError(f"its jump is {metadata.jump}; that of {metadata.scheme} is {jump}")
    if scheme.timing.own_steps != (metadata.step == 0.0) or metadata.step < 0.0:
        raise TrajectoryFileError(f"its step is {metadata.step:g}, which {metadata.scheme} cannot have")
    return scheme


def _whole_rows(
    states: dict[str, Array], impacts: dict[str, Array], dense: Array | None
) -> tuple[dict[str, Array], dict[str, Array], Array | None]:
    """Cut the columns of a killed run to equal length: in the old format one may be a piece longer than another."""
    n = min(len(values) for name, values in states.items() if name != "energy")
    m = min(map(len, impacts.values()))
    states = {name: values[:n] for name, values in states.items()}
    if len(states["energy"]) < n:
        states["energy"] = states["energy"][:0]
    return states, {name: values[:m] for name, values in impacts.items()}, None if dense is None else dense[: n - 1]


def _impacts(columns: dict[str, Array]) -> tuple[Impact, ...]:
    n = len(columns["instant"])
    starts = np.flatnonzero(np.diff(columns["instant"], prepend=-1))
    names = [name.decode() for name in columns["constraint"]]
    impacts = []
    for start, stop in pairwise([*starts, n]):
        rows = slice(start, stop)
        p, before, after, point, normal = (
            columns[k][rows] for k in ("percussion", "before", "after", "point", "normal")
        )
        time, energy_change = (float(columns[k][start]) for k in ("time", "energy_change"))
        impact = Impact(time, tuple(names[rows]), p, before, after, point, normal, energy_change)
        if "regime" in columns:
            more: dict[str, Any] = {name: columns[name][rows] for name in IMPACT_FRICTION}
            more["regime"] = tuple(word.decode() for word in more["regime"].tolist())
            impact = replace(impact, angular=columns["angular"][rows] if "angular" in columns else None, **more)
        impacts.append(impact)
    return tuple(impacts)


def _contacts(columns: dict[str, Array], corrections: dict[str, Array] | None, states: int) -> ContactTable:
    count, known, more = len(columns["interval"]), columns["constraint"], None
    if corrections is not None:
        known = np.concatenate([known, corrections["constraint"]])
    names, constraint = np.unique(known, return_inverse=True)
    if corrections is not None:
        starts = np.searchsorted(corrections["interval"], np.arange(states + 1))
        more = CorrectionTable(starts, constraint[count:], corrections["wrench"])
    starts = np.searchsorted(columns["interval"], np.arange(states + 1))
    words = tuple(name.decode() for name in names.tolist())
    table = ContactTable(
        starts, constraint[:count], words, columns["point"], columns["normal"], columns["percussion"], corrections=more
    )
    if "regime" not in columns:
        return table
    sticks = columns["regime"] == b"stick"
    tangential, slip, angular = columns["tangential"], columns["slip"], columns.get("angular")
    return replace(table, tangential=tangential, slip=slip, sticks=sticks, angular=angular)
