"""The columns of a trajectory file: their units, types and widths, and rows appended to them or read from them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any
from zlib import crc32

import h5py
import numpy as np

from ...errors import TrajectoryFileError

Array = np.ndarray
# the largest chunk of a column [bytes], and the most rows in one
_CHUNK, _ROWS = 1 << 18, 256
# the most rows in one that is compressed
_MANY = 4096
# names are of one length in the file; it grows by so much
_NAME = 16
# a compressed column can be that much smaller
_SMALLER = 1100


@dataclass(frozen=True)
class Column:
    """One array of a file, a row for each state or for each row of an impact.

    Attributes
    ----------
    unit, description : str
        What is kept with it.
    shape : tuple
        Of one row; "nq" and "nv" stand for the numbers of the problem.
    kind : str
        "float", "integer" or "name".
    """

    unit: str
    description: str
    shape: tuple[int | str, ...] = ()
    kind: str = "float"

    def row(self, sizes: Mapping[str, int]) -> tuple[int, ...]:
        """Return the shape of a row."""
        return tuple(sizes[n] if isinstance(n, str) else n for n in self.shape)


STATES = {
    "t": Column("s", "time"),
    "q": Column("m, rad, unit quaternions (x, y, z, w)", "configuration", ("nq",)),
    "v": Column("m/s, rad/s", "velocity on [t_i, t_{i+1})", ("nv",)),
    "penetration": Column("m", "deepest penetration of contacts since the state before, >= 0"),
    "limit_violation": Column("rad or m", "greatest violation of joint limits since the state before [m if sliding]"),
    "residual": Column("1", "largest relative KKT residual of the projections since the state before"),
    "energy": Column("J", "kinetic and potential energy where v_i and the configuration belong together", (2,)),
}
IMPACTS = {
    "instant": Column("1", "rows of one impact share this number", kind="integer"),
    "time": Column("s", "when"),
    "constraint": Column("1", "name of the constraint", kind="name"),
    "percussion": Column("N s or N m s", "p >= 0 along the constraint's gradient"),
    "before": Column("m/s or rad/s", "normal velocity before, negative when closing"),
    "after": Column("m/s or rad/s", "normal velocity after"),
    "point": Column("m", "contact point in the world; NaN where the constraint is no contact", (3,)),
    "normal": Column(
        "1", "unit normal in the world, from the first body named to the second, or out of a half-space or mesh", (3,)
    ),
    "energy_change": Column("J", "kinetic energy gained by the whole impact"),
}
# between two states each
DENSE = Column("1", "polynomials of the chart's coordinates and of v between the states", (2, "nv", "degree"))
CONTACTS = {
    "interval": Column("1", "number of the state at the end of the time that the row is of", kind="integer"),
    "constraint": Column("1", "name of the constraint", kind="name"),
    "percussion": Column("N s or N m s", "p >= 0 along the constraint's gradient, over the time between two states"),
    "point": Column("m", "contact point in the world; NaN where the constraint is no contact", (3,)),
    "normal": Column("1", "unit normal in the world, as of impacts", (3,)),
}
# what the percussions of contacts leave out of the momentum of free bodies
CORRECTIONS = {
    "interval": CONTACTS["interval"],
    "constraint": CONTACTS["constraint"],
    "wrench": Column(
        "N s, N m s", "force and moment about the origin over the time between two states, signed as normals", (6,)
    ),
}
# of runs with friction
REGIME = Column("1", "stick, slip or open", kind="name")
IMPACT_FRICTION = {
    "tangential": Column("N s", "tangential percussion in the world, on the body that the normal points to", (3,)),
    "slip_before": Column("m/s", "tangential velocity of that body relative to the other before, in the world", (3,)),
    "slip_after": Column("m/s", "the same after", (3,)),
    "regime": REGIME,
    "e_used": Column("1", "restitution that the law was applied with"),
}
CONTACT_FRICTION = {
    "tangential": Column("N s", "tangential percussion, over the time between two states, as of impacts", (3,)),
    "slip": Column("m/s", "mean tangential velocity after the steps, weighted by their percussions", (3,)),
    "regime": REGIME,
}
# of impacts and contacts of runs with torsional or rolling friction
RESISTANCE = {
    "angular": Column("N m s", "percussion of torsional and rolling friction, on the same body", (3,)),
}
# where each table of columns lies in the file; contacts in files of runs that recorded them
TABLES = {"/": STATES, "impacts": IMPACTS}
RECORDED = {"contacts": CONTACTS, "corrections": CORRECTIONS}
FRICTION = {"impacts": IMPACT_FRICTION, "contacts": CONTACT_FRICTION}
# of many rows that are alike
_COMPRESSED = {"impacts", "contacts", "corrections"}


class Sums(dict[str, tuple[int, int]]):
    """The number of rows and the checksum of the values of each column, by its place in the file."""

    def add(self, place: str, values: Array) -> None:
        """Count rows that follow those before."""
        rows, crc = self.get(place, (0, 0))
        if values.dtype.kind == "S":
            raw = b"".join(name + b"\0" for name in values.tolist())
        else:
            raw = np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("<")).tobytes()
        self[place] = rows + len(values), crc32(raw, crc)


def place_of(group: h5py.Group, name: str) -> str:
    """Return where in a file a column lies: "t", "impacts/time"."""
    return f"{group.name}/{name}".strip("/")


def create_columns(group: h5py.Group, columns: Mapping[str, Column], sizes: Mapping[str, int]) -> None:
    """Create empty columns in a group, with checksums."""
    for name, column in columns.items():
        _create(group, name, column, column.row(sizes), _NAME)


def append_rows(group: h5py.Group, columns: Mapping[str, Column], values: Mapping[str, Any], sums: Sums) -> None:
    """Append rows to those columns of a group that `values` names, and to their checksums."""
    for name, rows in values.items():
        data = as_kept(rows, columns[name])
        sums.add(place_of(group, name), data)
        target = group[name]
        if data.dtype.itemsize > target.dtype.itemsize and columns[name].kind == "name":
            target = _widened(group, name, columns[name], data.dtype.itemsize)
        if len(data):
            start = len(target)
            target.resize(start + len(data), axis=0)
            # names are to have the file's character set
            target[start:] = data.astype(target.dtype)


def as_kept(rows: Any, column: Column) -> Array:
    """Return rows as the file keeps them."""
    if column.kind == "name":
        return rows if isinstance(rows, np.ndarray) and rows.dtype.kind == "S" else encoded(rows)
    return np.asarray(rows, dtype=np.float64 if column.kind == "float" else np.int64)


def encoded(names: Sequence[str]) -> Array:
    """Return names as bytes of one length, shape (n,)."""
    try:
        return np.array([name.encode() for name in names], dtype="S") if len(names) else np.zeros(0, "S1")
    except UnicodeEncodeError as error:
        raise TrajectoryFileError(f"a name cannot be written: {error.object!r} is no text") from error


def read_column(group: h5py.Group, name: str, column: Column, sizes: Mapping[str, int]) -> Array:
    """Return a column of a file.

    Raises
    ------
    TrajectoryFileError
        If it is not there, or not of its type and shape.
    """
    found = group.get(name)
    where = place_of(group, name)
    if not isinstance(found, h5py.Dataset):
        raise TrajectoryFileError(f"it has no column {where}")
    row = column.row(sizes)
    if found.ndim != 1 + len(row) or found.shape[1:] != row:
        raise TrajectoryFileError(f"{where} has shape {found.shape}; {('n', *row)} is expected")
    if not _is_kind(found.dtype, column.kind):
        raise TrajectoryFileError(f"{where} holds {found.dtype} where it should hold a {column.kind} in each place")
    if found.nbytes > _SMALLER * found.id.get_storage_size():
        raise TrajectoryFileError(f"{where} claims {found.nbytes} bytes and holds {found.id.get_storage_size()}")
    values = found[:]
    if column.kind == "float":
        return np.ascontiguousarray(values, dtype=np.float64)
    # names of version 0.1 are objects of any length
    return values.astype(np.int64 if column.kind == "integer" else "S")


def _create(group: h5py.Group, name: str, column: Column, row: tuple[int, ...], width: int) -> h5py.Dataset:
    kind: Any = {"float": np.dtype(np.float64), "integer": np.dtype(np.int64)}.get(column.kind)
    options: dict[str, Any] = {}
    compressed = group.name.strip("/") in _COMPRESSED
    if compressed:
        # shuffled numbers alike compress better, names as they are
        options = {"compression": "gzip", "compression_opts": 1, "shuffle": kind is not None}
    if kind is None:
        kind = h5py.string_dtype("utf-8", width)
    size = int(np.prod(row, dtype=np.int64)) * kind.itemsize
    target = group.create_dataset(
        name,
        (0, *row),
        kind,
        maxshape=(None, *row),
        chunks=(min(max(_CHUNK // max(size, 1), 1), _MANY if compressed else _ROWS), *(max(n, 1) for n in row)),
        fletcher32=True,
        track_times=False,
        **options,
    )
    target.attrs.update({"unit": column.unit, "description": column.description})
    return target


def _widened(group: h5py.Group, name: str, column: Column, width: int) -> h5py.Dataset:
    """Return a column of names with room for longer ones."""
    kept = group[name][:]
    del group[name]
    target = _create(group, name, column, (), -(-width // _NAME) * _NAME)
    if len(kept):
        target.resize(len(kept), axis=0)
        target[:] = kept
    return target


def _is_kind(dtype: np.dtype[Any], kind: str) -> bool:
    if kind == "name":
        return h5py.check_string_dtype(dtype) is not None
    return dtype.kind == "f" and dtype.itemsize == 8 if kind == "float" else dtype.kind == "i"
