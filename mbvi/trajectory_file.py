"""Trajectories in HDF5, readable with h5py alone, written in pieces while a run goes on."""

from __future__ import annotations

import inspect
import json
import os
from collections.abc import Sequence
from itertools import pairwise
from time import perf_counter
from types import TracebackType
from typing import TYPE_CHECKING, Any, Protocol

import h5py
import numpy as np

from .errors import MbviError, TrajectoryFileError
from .scene.description import describe, lost, restore
from .schemes import Centered, EventDriven, MoreauJean, Paoli, SchatzmanPaoli, Scheme, StewartTrinkle
from .trajectory import Impact, Trajectory, energies

if TYPE_CHECKING:
    from .problem import Problem

_FORMAT = "mbvi trajectory 1"
# seconds between two pieces: what a killed run can lose
_INTERVAL = 0.5
_CHUNK = 256
_SCHEMES: dict[str, type] = {
    scheme.__name__: scheme for scheme in (Paoli, MoreauJean, Centered, SchatzmanPaoli, StewartTrinkle, EventDriven)
}
_STATES = {
    "t": ("s", "time"),
    "q": ("m, rad, unit quaternions (x, y, z, w)", "configuration"),
    "v": ("m/s, rad/s", "velocity on [t_i, t_{i+1})"),
    "penetration": ("m or rad", "deepest penetration, >= 0"),
    "residual": ("1", "largest relative KKT residual of the projections since the state before"),
    "energy": ("J", "kinetic and potential energy where v_i and the configuration belong together"),
}
_IMPACTS = {
    "instant": ("1", "rows of one impact share this number"),
    "time": ("s", "when"),
    "constraint": ("1", "name of the constraint"),
    "percussion": ("N s or N m s", "p >= 0 along the constraint's gradient"),
    "before": ("m/s or rad/s", "normal velocity before, negative when closing"),
    "after": ("m/s or rad/s", "normal velocity after"),
    "point": ("m", "contact point in the world; NaN where the constraint is no contact"),
    "normal": ("1", "unit normal in the world, from the first body named to the second"),
    "energy_change": ("J", "kinetic energy gained by the whole impact"),
}


class Record(Protocol):
    """What a run leaves behind while it goes on; `dense` are polynomials between the states, or None."""

    jump: float
    t: Any
    q: Any
    v: Any
    penetration: Any
    residual: Any
    dense: Any
    impacts: list[Impact]
    notes: list[str]

    @property
    def count(self) -> int:
        """How many states there are so far."""
        ...


class Writer:
    """Streams a run to a file; with no path it does nothing.

    Parameters
    ----------
    path : path or None
        Where to.
    problem, scheme, h
        What is run, and how.
    recorder : Record
        Where the states and impacts come from.

    Raises
    ------
    TrajectoryFileError
        If the file cannot be written.
    """

    def __init__(
        self,
        path: str | os.PathLike[str] | None,
        problem: Problem,
        scheme: Scheme | EventDriven,
        h: float,
        recorder: Record,
    ) -> None:
        self._recorder, self._problem, self._h = recorder, problem, h
        self._file: h5py.File | None = None
        self._states = self._rows = 0
        self._next = float("inf")
        if path is not None:
            self._file = _create(path, problem, type(scheme).__name__, _options(scheme), h, recorder.jump)
            # a killed run is to say why it was run so
            self._file.attrs["notes"] = list(recorder.notes)
            self._next = 0.0

    def __enter__(self) -> Writer:
        return self

    def poll(self) -> float:
        """Write what is new if the last piece is old enough; return when it will be again."""
        if perf_counter() >= self._next:
            self._flush()
            self._next = perf_counter() + _INTERVAL
        return self._next

    def _flush(self) -> None:
        file, r = self._file, self._recorder
        assert file is not None
        part = slice(self._states, r.count)
        if part.start < part.stop:
            if r.dense is not None:
                # before the states, which a killed run may then have fewer of
                dense = r.dense[max(part.start - 1, 0) : part.stop - 1]
                _append_dense(file, np.array(dense))
            both = energies(self._problem, r.t[part], r.q[part], r.v[part], self._h, r.jump)
            for name, values in zip(_STATES, (r.t, r.q, r.v, r.penetration, r.residual), strict=False):
                _append(file[name], np.asarray(values[part]))
            _append(file["energy"], both)
            self._states = r.count
        _write_impacts(file, r.impacts[self._rows :], self._rows)
        self._rows = len(r.impacts)
        file.flush()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._file is None:
            return
        self._flush()
        if error is None:
            # the end time was set to the last digit after the last piece
            self._file["t"][self._states - 1] = self._recorder.t[self._states - 1]
            self._file.attrs["complete"] = True
            self._file.attrs["notes"] = list(self._recorder.notes)
        self._file.close()


def save(run: Trajectory, path: str | os.PathLike[str]) -> None:
    """Write a trajectory to a file; see `Trajectory.save`."""
    file = _create(path, run.problem, run.scheme, _options(run._scheme), run.step, run._jump)
    with file:
        for name, values in zip(_STATES, (run.t, run.q, run.v, run.penetration(), run.residual), strict=False):
            _append(file[name], values)
        if run.problem is not None or run._energies is not None:
            _append(file["energy"], np.stack(run.energies(), axis=1))
        if run._dense is not None:
            _append_dense(file, run._dense)
        _write_impacts(file, run.impacts, 0)
        file.attrs["complete"] = run.complete
        file.attrs["notes"] = list(run.notes)


def load(path: str | os.PathLike[str]) -> Trajectory:
    """Read a trajectory.

    Parameters
    ----------
    path : path
        A file of `Trajectory.save` or `simulate(out=...)`, that of a killed run included.

    Returns
    -------
    Trajectory
        With its problem, if that was built by a `Scene`: a control is not kept and comes back as none.

    Raises
    ------
    TrajectoryFileError
        If the file is missing, truncated or of another kind.
    """
    if not os.path.isfile(path):
        raise TrajectoryFileError(f"no such file: {path}")
    try:
        with h5py.File(path, "r") as file:
            if file.attrs.get("format") != _FORMAT:
                raise TrajectoryFileError(f"{path} is an HDF5 file but no mbvi trajectory")
            return _read(file)
    except (OSError, KeyError, RuntimeError, ValueError) as error:
        raise TrajectoryFileError(
            f"{path} is truncated or no HDF5 file: {str(error).splitlines()[0]}; run the simulation again"
        ) from error


def _options(scheme: Any) -> dict[str, Any]:
    """Return what a scheme of the library was made with; of others nothing is brought back."""
    known = _SCHEMES.get(type(scheme).__name__)
    return {} if known is None else {name: getattr(scheme, name) for name in inspect.signature(known).parameters}


def _create(
    path: str | os.PathLike[str], problem: Problem | None, scheme: str, options: dict[str, Any], h: float, jump: float
) -> h5py.File:
    try:
        file = h5py.File(path, "w")
    except OSError as error:
        raise TrajectoryFileError(f"{path} cannot be written: {str(error).splitlines()[0]}") from error
    file.attrs.update({"format": _FORMAT, "scheme": scheme, "step": h, "jump": jump, "complete": False, "notes": []})
    file.attrs["scheme_options"] = json.dumps(options)
    group = file.create_group("problem")
    group.attrs["description"] = "the scene as JSON (SI units), initial state, restitution and order of q and v"
    if problem is not None:
        group.create_dataset("scene", data=describe(problem))
        for name, values, unit in (
            ("q0", problem.q0, _STATES["q"][0]),
            ("v0", problem.v0, _STATES["v"][0]),
            ("restitution", problem.restitution, "1"),
        ):
            group.create_dataset(name, data=values).attrs["unit"] = unit
        group.attrs["t0"] = problem.t0
        nq, nv = problem.system.nq, problem.system.nv
    else:
        nq = nv = 0
    width = {"q": (nq,), "v": (nv,), "energy": (2,), "point": (3,), "normal": (3,)}
    for parent, columns in ((file, _STATES), (file.create_group("impacts"), _IMPACTS)):
        for name, (unit, what) in columns.items():
            shape = width.get(name, ())
            kind: Any = {"instant": np.int64, "constraint": h5py.string_dtype()}.get(name, np.float64)
            chunk = (_CHUNK, *shape)
            column = parent.create_dataset(
                name, (0, *shape), kind, maxshape=(None, *shape), chunks=chunk, track_times=False
            )
            column.attrs.update({"unit": unit, "description": what})
    file.flush()
    return file


def _append_dense(file: h5py.File, values: np.ndarray) -> None:
    if not len(values):
        return
    if "dense" not in file:
        shape = values.shape[1:]
        dense = file.create_dataset(
            "dense", (0, *shape), np.float64, maxshape=(None, *shape), chunks=(_CHUNK, *shape), track_times=False
        )
        dense.attrs["description"] = "polynomials of the chart's coordinates and of v between the states"
    _append(file["dense"], values)


def _append(column: h5py.Dataset, values: np.ndarray) -> None:
    start = len(column)
    if len(values):
        column.resize(start + len(values), axis=0)
        column[start:] = values


def _write_impacts(file: h5py.File, impacts: Sequence[Impact], first: int) -> None:
    if not impacts:
        return
    group = file["impacts"]
    counts = [len(i.constraints) for i in impacts]
    _append(group["instant"], np.repeat(np.arange(first, first + len(impacts)), counts))
    _append(group["time"], np.repeat([i.time for i in impacts], counts))
    _append(group["energy_change"], np.repeat([i.energy_change for i in impacts], counts))
    _append(group["constraint"], np.array([n for i in impacts for n in i.constraints], dtype=object))
    for name in ("percussion", "before", "after", "point", "normal"):
        _append(group[name], np.concatenate([getattr(i, name) for i in impacts]))


def _read(file: h5py.File) -> Trajectory:
    columns = {name: file[name][:] for name in _STATES}
    # a killed run may have written one column further than the next
    n = min(len(columns[name]) for name in _STATES if name != "energy")
    energy = columns["energy"][:n] if len(columns["energy"]) >= n else None
    if not n:
        raise TrajectoryFileError(f"{file.filename} holds no states")
    problem, missing = None, False
    if "scene" in file["problem"]:
        text = file["problem/scene"][()].decode()
        try:
            problem, missing = restore(text), lost(text)
        except MbviError as error:
            raise TrajectoryFileError(f"{file.filename} holds a problem that cannot be built: {error}") from error
    scheme = str(file.attrs["scheme"])
    # files of other versions may name others
    known = _SCHEMES.get(scheme)
    return Trajectory(
        columns["t"][:n],
        columns["q"][:n],
        columns["v"][:n],
        _read_impacts(file["impacts"]),
        columns["residual"][:n],
        scheme,
        float(file.attrs["step"]),
        tuple(str(note) for note in file.attrs["notes"]),
        problem,
        bool(file.attrs["complete"]),
        columns["penetration"][:n],
        energy,
        None if known is None else known(**json.loads(file.attrs.get("scheme_options", "{}"))),
        # files of before there were several schemes have none
        float(file.attrs.get("jump", 1.0)),
        file["dense"][: n - 1] if "dense" in file else None,
        missing,
    )


def _read_impacts(group: h5py.Group) -> tuple[Impact, ...]:
    n = min(len(group[name]) for name in _IMPACTS)
    columns = {name: group[name][:n] for name in _IMPACTS}
    starts = np.flatnonzero(np.diff(columns["instant"], prepend=-1))
    impacts = []
    for start, stop in pairwise([*starts, n]):
        rows = slice(start, stop)
        names = tuple(name.decode() for name in columns["constraint"][rows])
        p, before, after, point, normal = (
            columns[k][rows] for k in ("percussion", "before", "after", "point", "normal")
        )
        time, energy_change = (float(columns[k][start]) for k in ("time", "energy_change"))
        impacts.append(Impact(time, names, p, before, after, point, normal, energy_change))
    return tuple(impacts)
