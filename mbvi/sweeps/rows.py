"""Rows of a study: one for each run, in files of Parquet with checksums that are written whole and renamed."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..arguments import shown
from ..errors import InputError, TrajectoryFileError
from .points import OWN_COLUMNS
from .study import written

if TYPE_CHECKING:
    import pyarrow as pa

Row = dict[str, Any]
_NUMBERS = (bool, int, float)
# what stands before the digest of a file in its metadata, and in the digest's place while it is taken
_DIGEST, _ZEROS = b"SHA-256 of this file with zeros here: ", b"0" * 64


class Status(NamedTuple):
    """How runs end; the words of the column `status`."""

    ok: str = "ok"
    failed: str = "failed"
    diverged: str = "diverged"
    over_budget: str = "over budget"
    killed: str = "killed"


STATUS = Status()


def measured(values: Any, parameters: Mapping[str, Any]) -> Row:
    """Return what `measure` returned, as numbers, texts and nested lists.

    Raises
    ------
    InputError
        If it is no mapping of names to numbers, arrays of numbers or texts, or a name is that of another column.
    """
    if not isinstance(values, Mapping):
        raise InputError(f"measure must return a mapping of names to numbers or arrays; got {shown(values)}")
    found: Row = {}
    for name, value in values.items():
        if not isinstance(name, str) or name in OWN_COLUMNS or name in parameters:
            raise InputError(
                f"measure must return names that are no parameters and not {OWN_COLUMNS}; got {shown(name)}"
            )
        found[name] = _value(name, value)
    return found


def _value(name: str, value: Any) -> Any:
    if isinstance(value, np.generic | np.ndarray) and np.ndim(value) == 0:
        value = value.item()
    if isinstance(value, int) and not isinstance(value, bool) and abs(value) >= 2**63:
        return float(value)
    if isinstance(value, str | bool | int | float):
        return value
    array = np.asarray(value)
    if array.dtype.kind not in "bif":
        raise InputError(f"measure must return numbers, arrays of numbers or texts; {name} is {shown(value)}")
    return array.astype(float).tolist()


def write_rows(path: Path, rows: Sequence[Row]) -> None:
    """Write rows to a file, whole.

    Raises
    ------
    TrajectoryFileError
        If the file cannot be written.
    """
    import pyarrow as pa

    names = list(dict.fromkeys(name for row in rows for name in row))
    table = pa.table({name: _column(name, [row.get(name) for row in rows]) for name in names})
    part = path.with_name(f"{path.name}.{os.getpid()}.part")
    with written(path.parent.parent):
        part.write_bytes(_packed(table))
        os.replace(part, path)


def read_file(path: Path) -> list[Row]:
    """Return the rows of one file."""
    rows: list[Row] = _table(path).to_pylist()
    return rows


def _packed(table: pa.Table) -> bytes:
    """Return a file of Parquet whose metadata holds the digest of the file, taken with zeros in its place."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    sink = pa.BufferOutputStream()
    with pq.ParquetWriter(sink, table.schema) as writer:
        writer.write_table(table)
        writer.add_key_value_metadata({"mbvi": (_DIGEST + _ZEROS).decode()})
    data = sink.getvalue().to_pybytes()
    return _with_digest(data, sha256(data).hexdigest().encode())


def _table(path: Path, columns: list[str] | None = None) -> pa.Table:
    """Return the rows of a file whose digest fits.

    Raises
    ------
    TrajectoryFileError
        If the file cannot be read, is damaged, or was changed.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        data = path.read_bytes()
    except OSError as error:
        raise TrajectoryFileError(f"{path} cannot be read: {error.strerror or error}") from error
    if _with_digest(data, sha256(_with_digest(data, _ZEROS)).hexdigest().encode()) != data or _DIGEST not in data:
        raise TrajectoryFileError(
            f"{path} is damaged, or was changed after it was written: remove it, and the same call makes its runs again"
        )
    return pq.read_table(pa.BufferReader(data), columns=columns)


def _with_digest(data: bytes, digest: bytes) -> bytes:
    """Return a file with another digest in its metadata, which stands near the end."""
    place = data.rfind(_DIGEST) + len(_DIGEST)
    return data[:place] + digest + data[place + len(digest) :]


def read_rows(folder: Path, columns: Sequence[str] | None = None) -> pa.Table:
    """Return all rows of a folder, each run once, in the order of the runs.

    Parameters
    ----------
    folder : Path
        The folder.
    columns : sequence of str, optional
        Which columns; all by default.

    Raises
    ------
    InputError
        If a name means a number in one run and a text in another.
    TrajectoryFileError
        If a file cannot be read, is damaged, or was changed.
    """
    import pyarrow as pa

    names = None if columns is None else list(columns)
    tables = [_table(path, names) for path in sorted(folder.glob("*.parquet"))]
    if not tables:
        return pa.table({name: pa.array([], pa.int64()) for name in columns or ["run"]})
    try:
        table = pa.concat_tables(tables, promote_options="permissive")
    except (pa.ArrowInvalid, pa.ArrowTypeError) as error:
        raise InputError(f"measure must return the same kind of value in every run: {error}") from error
    # a run can be in two files where a batch was begun twice; what it computed is the same
    _, first = np.unique(table["run"].to_numpy(), return_index=True)
    return table.take(pa.array(first))


def _column(name: str, values: list[Any]) -> pa.Array:
    """Return a column whose type is that of its values; a missing value is null."""
    import pyarrow as pa

    kinds = {type(value) for value in values if value is not None}
    if kinds <= {bool} or kinds <= {int} or kinds <= {str} or not kinds:
        return pa.array(values)
    if kinds <= set(_NUMBERS):
        return pa.array([None if value is None else float(value) for value in values])
    if kinds == {list}:
        return pa.array(values)
    kind = " and ".join(sorted(k.__name__ for k in kinds))
    raise InputError(f"measure must return the same kind of value in every run: {name} is {kind}")
