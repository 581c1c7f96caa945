"""Writes runs to HDF5 files: whole ones, and piece by piece those that are still going on."""

from __future__ import annotations

import os
from collections.abc import Sequence
from time import perf_counter
from types import TracebackType
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from ...errors import TrajectoryFileError
from ...scene.saved.description import describe
from ...schemes import SCHEMES, SchemeBase, Timing
from ...schemes.event_driven.runge_kutta import DEGREE
from ..contacts import ContactLog, ContactTable
from ..diagnosis.energies import energies, energies_of_states
from ..run_data import Array, Impact, RunData, Switch
from .metadata import Metadata, ProblemData
from .switches import texts_of
from .writing import RunFile

if TYPE_CHECKING:
    from ...problem import Problem

# seconds between two pieces: a killed run loses at most the states of this time
_INTERVAL = 0.5

# columns of states beside the energy
_RECORDED = ("t", "q", "v", "penetration", "limit_violation", "residual")


class Recording(Protocol):
    """States and impacts recorded so far by a run that is still going on.

    `dense` are polynomials between the states, or None; `contacts` is None where they are not recorded.
    """

    timing: Timing
    t: Any
    q: Any
    v: Any
    penetration: Any
    limit_violation: Any
    residual: Any
    dense: Any
    impacts: list[Impact]
    notes: list[str]
    contacts: ContactLog | None

    @property
    def switches(self) -> Sequence[Switch]:
        """Connections that were switched so far."""

    def name(self, constraint: int) -> str:
        """Return the name of a constraint of `contacts`."""

    @property
    def count(self) -> int:
        """How many states there are so far."""
        ...


class Writer:
    """Streams a run to a file; with no path it does nothing.

    Parameters
    ----------
    path : path or None
        Path of the file.
    problem, scheme, h
        Problem, scheme and time step of the run.
    recorder : Recording
        Provides the states and impacts.

    Raises
    ------
    TrajectoryFileError
        If the file cannot be written.
    """

    def __init__(
        self,
        path: str | os.PathLike[str] | None,
        problem: Problem,
        scheme: SchemeBase,
        h: float,
        recorder: Recording,
    ) -> None:
        self._recorder, self._problem, self._h = recorder, problem, h
        self._file: RunFile | None = None
        self._energies: list[Array] = [np.zeros((0, 2))]
        self._next = float("inf")
        if path is not None:
            # the notes tell why the scheme was chosen: also the file of a killed run holds them
            metadata = _metadata(problem, scheme, scheme.name, h, recorder.timing, recorder.notes)
            sizes = _sizes(problem.system.nq, problem.system.nv, recorder.dense)
            friction = problem.constraints.frictional
            resistance = () if problem.constraints.resistance is None else ("impacts", "contacts")
            recorded = recorder.contacts is not None
            self._file = RunFile(path, metadata, sizes, contacts=recorded, friction=friction, resistance=resistance)
            self._next = 0.0

    def __enter__(self) -> Writer:
        return self

    def poll(self) -> float:
        """Write new states if the last piece is old enough; return the time of the next piece."""
        if perf_counter() >= self._next:
            self._flush()
            self._next = perf_counter() + _INTERVAL
        return self._next

    def _flush(self) -> None:
        file, r = self._file, self._recorder
        assert file is not None
        part, impacts = slice(file.states, r.count), r.impacts[file.impacts :]
        states = {name: np.asarray(getattr(r, name)[part]) for name in _RECORDED} if part.start < part.stop else {}
        if states:
            t, q, v = (states[name] for name in ("t", "q", "v"))
            states["energy"] = energies(self._problem, t, q, v, self._h, r.timing.jump, r.switches)
            self._energies.append(states["energy"])
        dense = None if r.dense is None else np.array(r.dense[max(part.start - 1, 0) : max(part.stop - 1, 0)])
        contacts = self._contacts(part.start, part.stop)
        file.append(states, impacts, dense, r.notes, contacts, texts_of(r.switches))

    def _contacts(self, first: int, end: int) -> ContactTable | None:
        log = self._recorder.contacts
        return None if log is None else log.piece(self._recorder.name, first, end)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._file is None:
            return
        with self._file:
            if error is None:
                self._flush()
                r = self._recorder
                recorded = {name: np.asarray(getattr(r, name)[: r.count]) for name in _RECORDED}
                recorded["energy"] = np.concatenate(self._energies)
                if r.dense is not None:
                    recorded["dense"] = np.array(r.dense).reshape(-1, 2, self._problem.system.nv, DEGREE)
                self._file.finish(recorded, r.impacts, self._contacts(0, r.count), complete=True)
            elif not isinstance(error, TrajectoryFileError):
                try:
                    self._flush()
                except TrajectoryFileError as second:
                    error.add_note(str(second))


def save(run: RunData, path: str | os.PathLike[str]) -> None:
    """Write a run to a file; see `Trajectory.save`."""
    record = run.record
    values = run.t, run.q, run.v, record.penetration, record.limit_violation, run.residual
    recorded = dict(zip(_RECORDED, values, strict=True))
    if run.problem is not None or record.energies is not None:
        recorded["energy"] = energies_of_states(run)
    with record.as_set():
        metadata = _metadata(run.problem, record.scheme, run.scheme, run.step, record.timing, run.notes)
    try:
        sizes = _sizes(run.q.shape[1], run.v.shape[1], record.dense)
        given, friction = record.contacts is not None, _frictional(run)
        with RunFile(path, metadata, sizes, contacts=given, friction=friction, resistance=_resisting(run)) as file:
            file.append(recorded, run.impacts, record.dense, run.notes, record.contacts, texts_of(record.switches))
            if record.dense is not None:
                recorded["dense"] = record.dense
            file.finish(recorded, run.impacts, record.contacts, complete=run.complete)
    except TrajectoryFileError as error:
        error.run = run
        raise


def _frictional(run: RunData) -> bool:
    """Return whether the impacts and contacts of a run have friction."""
    if run.problem is not None:
        return run.problem.constraints.frictional
    contacts = run.record.contacts
    return any(i.regime is not None for i in run.impacts) or (contacts is not None and contacts.sticks is not None)


def _resisting(run: RunData) -> list[str]:
    """Return which of impacts and contacts have torques of torsional and rolling friction."""
    contacts = run.record.contacts
    if run.impacts:
        found = {"impacts": run.impacts[0].angular is not None}
    else:
        found = {"impacts": run.problem is not None and run.problem.constraints.resistance is not None}
    found["contacts"] = contacts is not None and contacts.angular is not None
    return [name for name, there in found.items() if there]


def _metadata(
    problem: Problem | None, scheme: SchemeBase | None, name: str, h: float, timing: Timing, notes: Any
) -> Metadata:
    kept = None
    if problem is not None:
        kept = ProblemData(
            describe(problem), problem.q0, problem.v0, problem.restitution, problem.t0, float(problem.length)
        )
    # the options of users' schemes are not kept: a file cannot bring these back
    options = scheme.options() if scheme is not None and scheme.name in SCHEMES else {}
    return Metadata(name, options, float(h), float(timing.jump), kept, False, tuple(notes))


def _sizes(nq: int, nv: int, dense: Any) -> dict[str, int]:
    return {"nq": nq, "nv": nv} | ({} if dense is None else {"degree": DEGREE})
