"""The table of a study as an xarray Dataset."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..points import OWN_COLUMNS, Points
from ..rows import read_rows
from ..study import StudyFolder

if TYPE_CHECKING:
    import pyarrow as pa
    import xarray as xr


def dataset(folder: StudyFolder, points: Points) -> xr.Dataset:
    """Return the rows of a study.

    Parameters
    ----------
    folder : StudyFolder
        The study; every run has a row.
    points : Points
        Its points: the parameters of a grid become dimensions, others coordinates along "run".
    """
    import xarray as xr

    table = read_rows(folder.rows)
    dims, shape = (tuple(points.columns), points.shape) if points.grid else (("run",), (len(points),))
    if points.grid:
        coords: dict[str, Any] = {name: _coordinate(values) for name, values in points.columns.items()}
    else:
        coords = {"run": np.arange(len(points))}
        coords |= {name: ("run", _coordinate(values)) for name, values in points.columns.items()}
    variables: dict[str, Any] = {}
    names = [name for name in table.column_names if name not in OWN_COLUMNS]
    # the order of the names must not depend on which batch ended first
    for name in (*sorted(names), *OWN_COLUMNS):
        if name == "run" and not points.grid:
            continue
        values = _values(table, name)
        inner = tuple(f"{name}_{k}" for k in range(values.ndim - 1))
        variables[name] = (dims + inner, values.reshape(shape + values.shape[1:]))
    about = folder.about()
    made = xr.Dataset(variables, coords, {"study": str(folder.path), "seed": about["seed"], **about["versions"]})
    made["cpu"].attrs.update(units="s", long_name="CPU time")
    return made


def _coordinate(values: Any) -> np.ndarray:
    """Return the values of a parameter; what is neither number nor text is shown as text."""
    if isinstance(values, np.ndarray) and values.dtype.kind in "biufM":
        return values
    if all(isinstance(value, bool) for value in values) or all(isinstance(value, str) for value in values):
        return np.array(values)
    if all(isinstance(value, int | float | np.number) for value in values):
        return np.array(values, dtype=None if all(isinstance(v, int | np.integer) for v in values) else float)
    return np.array([repr(value) for value in values])


def _values(table: pa.Table, name: str) -> np.ndarray:
    """Return a column; what failed runs lack is nan, and an empty text."""
    import pyarrow as pa

    column = table[name]
    if pa.types.is_string(column.type):
        # equal texts are one object: a million texts of their own would be large
        known: dict[str, str] = {}
        texts = ("" if value is None else value for value in column.to_pylist())
        return np.array([known.setdefault(text, text) for text in texts], dtype=object)
    if pa.types.is_list(column.type):
        return _arrays(column.to_pylist())
    if column.null_count or pa.types.is_null(column.type):
        return np.array(column.cast(pa.float64()).to_numpy(), dtype=float)
    return np.array(column.to_numpy())


def _arrays(rows: list[Any]) -> np.ndarray:
    """Return arrays as one; where their shapes differ the smaller ones are filled up with nan."""
    arrays = [None if row is None else np.array(row, dtype=float) for row in rows]
    axes = max(a.ndim for a in arrays if a is not None)
    sizes = [a.shape + (0,) * (axes - a.ndim) for a in arrays if a is not None]
    largest = tuple(max(size[k] for size in sizes) for k in range(axes))
    found = np.full((len(arrays), *largest), np.nan)
    for k, array in enumerate(arrays):
        if array is not None and array.size:
            part: Any = (k, *(slice(n) for n in array.shape))
            found[part] = array
    return found
