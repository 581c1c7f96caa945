"""Writes a run to files of other programs: CSV and Parquet tables, and MCAP logs."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np

from ...arguments import choice
from ...errors import InputError, TrajectoryFileError
from ..run_data import RunData
from ..tables import TABLES, Series, table

_SUFFIXES = (".csv", ".parquet", ".mcap")
# rows of a CSV file that are converted at once
_ROWS = 4096


def export(run: RunData, path: Path, name: str | None) -> None:
    """Write a run to a file of the kind that its suffix names; see `Trajectory.export`.

    Raises
    ------
    InputError
        If the suffix or the table is unknown, a table is named for an MCAP file, or a package is not installed.
    TrajectoryFileError
        If the file cannot be written.
    """
    kind = path.suffix.lower()
    if kind not in _SUFFIXES:
        raise InputError(f"{path.name} names no kind of file: end it with {', '.join(_SUFFIXES)}; run.save writes HDF5")
    if name is not None:
        choice(name, "table", TABLES)
        if kind == ".mcap":
            raise InputError("an MCAP file holds the whole run: give no table")
    try:
        if kind == ".mcap":
            from .mcap_file import write_mcap

            write_mcap(run, path)
        else:
            (_write_csv if kind == ".csv" else _write_parquet)(run, path, name or "states")
    except OSError as error:
        raise TrajectoryFileError(f"{path} cannot be written: {error.strerror or error}") from error


def _write_csv(run: RunData, path: Path, name: str) -> None:
    """Write a table with one header row; numbers have the shortest digits that give the same bits when read."""
    columns = table(run, name)
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow([_headed(key, one) for key, one in columns.items()])
        count = len(next(iter(columns.values())).values)
        for start in range(0, count, _ROWS):
            rows = [one.values[start : start + _ROWS] for one in columns.values()]
            lists = [part.tolist() if isinstance(part, np.ndarray) else part for part in rows]
            writer.writerows(zip(*lists, strict=True))


def _headed(name: str, column: Series) -> str:
    """Return the head of a column, "name [unit]"; a number without a unit has none."""
    return f"{name} [{column.unit}]" if column.unit not in ("", "1") else name


def _write_parquet(run: RunData, path: Path, name: str) -> None:
    """Write a table whose fields carry unit and description as metadata."""
    columns = table(run, name)
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError as error:
        raise InputError("a Parquet file needs pyarrow: pip install 'mbvi[tables]'") from error
    fields, arrays = [], []
    for key, one in columns.items():
        arrays.append(pa.array(one.values, pa.string() if isinstance(one.values, list) else None))
        about = {"unit": one.unit, "description": one.description}
        fields.append(pa.field(key, arrays[-1].type, nullable=False, metadata=about))
    about = {"scheme": run.scheme, "step": repr(run.step), "notes": "\n".join(run.notes)}
    pq.write_table(pa.Table.from_arrays(arrays, schema=pa.schema(fields, about)), path)
