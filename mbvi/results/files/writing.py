"""Writes a trajectory file: appends and commits rows, reads the file back, and marks it complete."""

from __future__ import annotations

import atexit
import os
import threading
import weakref
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from itertools import takewhile
from typing import TYPE_CHECKING, Any

import h5py
import numpy as np

from ...errors import TrajectoryFileError
from .checked_file import CheckedFile, reason, uninterrupted
from .columns import (
    CONTACT_FRICTION,
    CONTACTS,
    CORRECTIONS,
    DENSE,
    FRICTION,
    IMPACTS,
    RECORDED,
    RESISTANCE,
    STATES,
    TABLES,
    Array,
    Column,
    Sums,
    append_rows,
    as_kept,
    create_columns,
    encoded,
    place_of,
)
from .metadata import Metadata
from .verification import opened

if TYPE_CHECKING:
    from ..contacts import ContactTable
    from ..run_data import Impact

# bytes that are committed at once; in longer files one part in this number of the bytes already written
_PIECE, _PART = 1 << 17, 8
# bytes compared at once
_COMPARED = 1 << 22

# open files: they must be closed before Python ends, because HDF5 would call them afterwards
_open: weakref.WeakSet[RunFile] = weakref.WeakSet()


class RunFile:
    """A new trajectory file; a context that closes it.

    Parameters
    ----------
    path : path
        Path of the file.
    metadata : Metadata
        The metadata of the run.
    sizes : dict
        "nq", "nv" and, of schemes with dense output, its "degree".
    contacts, friction : bool
        Whether the run records contacts, and whether its problem has friction.

    Attributes
    ----------
    states, impacts : int
        How many were appended.

    Raises
    ------
    TrajectoryFileError
        Here and from every method: if the file cannot be written. It keeps what was committed before.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        metadata: Metadata,
        sizes: Mapping[str, int],
        *,
        contacts: bool = False,
        friction: bool = False,
        resistance: Collection[str] = (),
    ) -> None:
        self.path = os.fspath(path)
        self._metadata = metadata
        more = {
            name: (columns if friction else {}) | (RESISTANCE if name in resistance else {})
            for name, columns in FRICTION.items()
        }
        self._of_impacts = more["impacts"]
        self._problem = "" if metadata.problem is None else metadata.problem.digest()
        self.states = self.impacts = self._kept = 0
        self._sums = Sums()
        self._failed, self._busy = False, threading.RLock()
        self._disk = CheckedFile(self.path)
        _open.add(self)
        try:
            with self._writing():
                self._file = h5py.File(self._disk, "w", libver=("v108", "v108"))
                metadata.write(self._file)
                for name, columns in (TABLES | (RECORDED if contacts else {})).items():
                    self._create(self._file.require_group(name), {**columns, **more.get(name, {})}, sizes)
                if "degree" in sizes:
                    self._create(self._file, {"dense": DENSE}, sizes)
                self._commit()
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> RunFile:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def append(
        self,
        states: Mapping[str, Array],
        impacts: Sequence[Impact] = (),
        dense: Array | None = None,
        notes: Any = (),
        contacts: ContactTable | None = None,
        switches: Sequence[str] = (),
    ) -> None:
        """Append states and impacts, and commit them, in pieces so that a disk that fills up keeps what it can.

        `dense` has a row less than there are states when these are the first; `contacts` are those of the intervals
        that end at the states. `notes` and `switches` are all so far.
        """
        t = states.get("t", np.zeros(0))
        row = sum(values[:1].nbytes for values in states.values()) + (0 if dense is None else dense[:1].nbytes)
        if contacts is not None and len(t):
            row += 64 * len(contacts.percussion) // len(t)
        start, left, before = 0, impacts, int(not self.states)
        while start < len(t) or left:
            piece = max(_PIECE, self._disk.size // _PART)
            stop = min(start + max(piece // max(row, 1), 1), len(t))
            last = stop == len(t)
            end = np.inf if last else t[stop - 1]
            now = [*takewhile(partial(_until, end), left)]
            between = None if dense is None else dense[max(start - before, 0) : max(stop - before, 0)]
            with self._writing():
                part = {name: values[start:stop] for name, values in states.items()}
                append_rows(self._file, STATES, part, self._sums)
                if between is not None and len(between):
                    append_rows(self._file, {"dense": DENSE}, {"dense": between}, self._sums)
                if now:
                    rows = impact_rows(now, self.impacts, self._of_impacts)
                    append_rows(self._file["impacts"], IMPACTS | self._of_impacts, rows, self._sums)
                if contacts is not None:
                    rows = contact_rows(contacts.part(start, stop), self.states)
                    columns = CONTACTS | CONTACT_FRICTION | RESISTANCE
                    append_rows(self._file["contacts"], columns, rows, self._sums)
                    rows = correction_rows(contacts.part(start, stop), self.states)
                    append_rows(self._file["corrections"], CORRECTIONS, rows, self._sums)
                self.states += stop - start
                self.impacts += len(now)
                self._metadata = replace(self._metadata, notes=tuple(notes), switches=tuple(switches))
                self._commit()
            start, left = stop, left[len(now) :]

    def finish(
        self,
        recorded: Mapping[str, Array],
        impacts: Sequence[Impact],
        contacts: ContactTable | None = None,
        *,
        complete: bool,
    ) -> None:
        """Read the file back, compare it with what was recorded, and mark it complete if the run is."""
        with self._writing():
            # the end time was corrected for rounding after the last piece
            if self.states:
                self._file["t"][self.states - 1] = recorded["t"][self.states - 1]
                del self._sums["t"]
                self._sums.add("t", recorded["t"])
            self._commit()
            self._disk.sync()
        self._compare(recorded, impacts, contacts)
        with self._writing():
            self._metadata = replace(self._metadata, complete=complete)
            self._commit()
            self._disk.sync()
        # the mark itself is read back as well
        with opened(self.path, locked=True):
            pass

    def close(self) -> None:
        """Close the file; it holds what was committed."""
        with self._busy, uninterrupted():
            if self not in _open:
                return
            _open.discard(self)
            self._failed = True
            if hasattr(self, "_file"):
                # to memory, where nothing fails
                self._file.close()
            self._disk.close()

    def _create(self, group: h5py.Group, columns: Mapping[str, Column], sizes: Mapping[str, int]) -> None:
        create_columns(group, columns, sizes)
        for name in columns:
            self._sums.add(place_of(group, name), np.zeros(0))

    def _commit(self) -> None:
        self._metadata.write_state(self._file, self._sums, self._problem)
        self._file.flush()
        self._disk.commit()
        self._kept = self.states

    @contextmanager
    def _writing(self) -> Iterator[None]:
        with self._busy, uninterrupted():
            if self._failed:
                raise TrajectoryFileError(f"{self.path} is closed, or could not be written before")
            # until the write has succeeded
            self._failed = True
            try:
                yield
            except OSError as error:
                raise TrajectoryFileError(self._message(reason(error))) from error
            except (ValueError, TypeError, RuntimeError, KeyError) as error:
                raise TrajectoryFileError(self._message(str(error).splitlines()[0])) from error
            self._failed = False

    def _message(self, why: str) -> str:
        if not self._kept:
            return f"{self.path} cannot be written: {why}; it keeps no states"
        return (
            f"{self.path} cannot be written further: {why}; it keeps the first {self._kept} states, which load. "
            "The run so far is the `run` of this error: save it elsewhere"
        )

    def _compare(self, recorded: Mapping[str, Array], impacts: Sequence[Impact], contacts: ContactTable | None) -> None:
        """Read the file as `load` does and compare it with what was recorded."""
        rows = impact_rows(impacts, 0, self._of_impacts) if impacts else {}
        columns = IMPACTS | self._of_impacts
        rows = {name: as_kept(values, columns[name]) for name, values in rows.items()}
        with opened(self.path, locked=True) as file:
            tables = [(file, recorded), (file["impacts"], rows)]
            if contacts is not None:
                tables.append((file["contacts"], contact_rows(contacts, 0)))
                tables.append((file["corrections"], correction_rows(contacts, 0)))
            for group, values in tables:
                for name, expected in values.items():
                    if not _same(group[name], np.asarray(expected)):
                        raise TrajectoryFileError(
                            f"{self.path} does not hold what was written to it: {name} differs when read back. "
                            "The run is the `run` of this error: save it elsewhere"
                        )


@atexit.register
def _close_all() -> None:
    for file in list(_open):
        file.close()


def impact_rows(impacts: Sequence[Impact], first: int, more: Collection[str] = ()) -> dict[str, Any]:
    """Return the columns of impacts, numbered from `first`; `more` names those of friction."""
    counts = [len(i.constraints) for i in impacts]
    rows = {
        "instant": np.repeat(np.arange(first, first + len(impacts)), counts),
        "time": np.repeat([i.time for i in impacts], counts),
        "energy_change": np.repeat([i.energy_change for i in impacts], counts),
        "constraint": [name for i in impacts for name in i.constraints],
        **{
            name: np.concatenate([getattr(i, name) for i in impacts])
            for name in ("percussion", "before", "after", "point", "normal")
        },
    }
    return rows | {name: [x for i in impacts for x in getattr(i, name)] for name in more}


def contact_rows(table: ContactTable, first: int) -> dict[str, Any]:
    """Return the columns of contacts, their intervals numbered from `first`."""
    interval, names = _numbered(table, table.starts, table.constraint, first)
    columns = {"percussion": table.percussion, "point": table.point, "normal": table.normal}
    if table.tangential is not None and table.slip is not None and table.sticks is not None:
        regimes = np.array([b"slip", b"stick"])[table.sticks.astype(int)]
        columns |= {"tangential": table.tangential, "slip": table.slip, "regime": regimes}
    if table.angular is not None:
        columns["angular"] = table.angular
    return {"interval": interval, "constraint": names, **columns}


def correction_rows(table: ContactTable, first: int) -> dict[str, Any]:
    """Return the columns of the corrections of contacts, numbered as `contact_rows`."""
    if table.corrections is None:
        return {"interval": np.zeros(0, np.int64), "constraint": encoded(()), "wrench": np.zeros((0, 6))}
    starts, constraint, wrench = table.corrections.starts, table.corrections.constraint, table.corrections.wrench
    interval, names = _numbered(table, starts, constraint, first)
    return {"interval": interval, "constraint": names, "wrench": wrench}


def _numbered(table: ContactTable, starts: Array, constraint: Array, first: int) -> tuple[Array, Array]:
    """Return the intervals of some rows, numbered from `first`, and the names of their constraints."""
    interval = np.repeat(np.arange(first, first + len(starts) - 1), np.diff(starts))
    return interval, encoded(table.names)[constraint] if table.names else encoded(())


def _until(end: float, impact: Impact) -> bool:
    return impact.time <= end


def _same(column: h5py.Dataset, expected: Array) -> bool:
    if column.shape != expected.shape:
        return False
    rows = max(_COMPARED // max(column.dtype.itemsize * int(np.prod(column.shape[1:])), 1), 1)
    for start in range(0, len(expected), rows):
        found, part = column[start : start + rows], expected[start : start + rows]
        # to the bit, NaN and the sign of zero included
        if part.dtype.kind == "S":
            if not np.array_equal(found, part):
                return False
        elif found.tobytes() != np.ascontiguousarray(part, dtype=found.dtype).tobytes():
            return False
    return True
