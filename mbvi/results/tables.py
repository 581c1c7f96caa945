"""A run as tables with named columns: states, impacts and recorded contacts, also for pandas and xarray."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..arguments import choice
from ..errors import InputError
from .contact_forces import recorded_contacts
from .coordinates import coordinates
from .diagnosis.energies import energies_of_run
from .files.columns import CONTACT_FRICTION, CONTACTS, IMPACT_FRICTION, IMPACTS, RESISTANCE, STATES, Column
from .files.writing import contact_rows, impact_rows
from .run_data import Array, RunData

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

TABLES = ("states", "impacts", "contacts")
_AXES = ("x", "y", "z")


class Series(NamedTuple):
    """One column of a table: numbers, shape (n,), or a list of n texts, with unit and description."""

    values: Array | list[str]
    unit: str
    description: str


def table(run: RunData, name: str) -> dict[str, Series]:
    """Return the columns of a table by name.

    Parameters
    ----------
    run : RunData
        The run.
    name : "states", "impacts" or "contacts"
        Which table; impacts and contacts have a row for each contact point or limit.

    Raises
    ------
    InputError
        If `name` is another word, or the run did not record contacts.
    """
    if choice(name, "table", TABLES) == "states":
        return _states(run)
    columns, rows = _impacts(run) if name == "impacts" else _contacts(run)
    found = dict[str, Series]()
    for key, values in rows.items():
        column = columns[key]
        if column.shape == (3,):
            for k, axis in enumerate(_AXES):
                found[f"{key}/{axis}"] = Series(np.ascontiguousarray(values[:, k]), column.unit, column.description)
        else:
            found[key] = Series(values, column.unit, column.description)
    return found


def _states(run: RunData) -> dict[str, Series]:
    of_q, of_v = coordinates(run)
    found = {"t": Series(run.t, "s", STATES["t"].description)}
    for letter, states, named in (("q", run.q, of_q), ("v", run.v, of_v)):
        description = STATES[letter].description
        for values, one in zip(states.T, named, strict=True):
            found[f"{letter}/{one.name}"] = Series(np.ascontiguousarray(values), one.unit, description)
    return found | {name: Series(values, *about) for name, (values, *about) in _of_states(run).items()}


def _of_states(run: RunData) -> dict[str, tuple[Array, str, str]]:
    """Return the quantities with one number for each state, with unit and description."""
    found = {}
    depths = {name: getattr(run.record, name) for name in ("penetration", "limit_violation")}
    for name, values in (depths | {"residual": run.residual}).items():
        found[name] = (values, STATES[name].unit, STATES[name].description)
    if run.record.energies is not None or run.problem is not None:
        where = "energy where v_i and the configuration belong together"
        for name, values in zip(("kinetic", "potential"), energies_of_run(run).T, strict=True):
            found[f"energy/{name}"] = (np.ascontiguousarray(values), STATES["energy"].unit, f"{name} {where}")
    return found


def _impacts(run: RunData) -> tuple[dict[str, Column], dict[str, Any]]:
    more: dict[str, Column] = {}
    if any(impact.regime is not None for impact in run.impacts):
        more |= IMPACT_FRICTION
    if any(impact.angular is not None for impact in run.impacts):
        more |= RESISTANCE
    columns = IMPACTS | more
    if not run.impacts:
        return columns, {name: _none(column) for name, column in columns.items()}
    rows = impact_rows(run.impacts, 0, more)
    return columns, {name: _array(rows[name], column) for name, column in columns.items()}


def _contacts(run: RunData) -> tuple[dict[str, Column], dict[str, Any]]:
    found = recorded_contacts(run)
    columns, rows = CONTACTS | CONTACT_FRICTION | RESISTANCE, contact_rows(found, 0)
    rows = {name: _array(values, columns[name]) for name, values in rows.items()}
    time = {"time": run.t[rows["interval"]]}
    return columns | {"time": Column("s", "end of the interval")}, time | rows


def _none(column: Column) -> Any:
    kinds = {"float": np.float64, "integer": np.int64}
    return [] if column.kind == "name" else np.zeros((0, *column.shape), kinds[column.kind])


def _array(values: Any, column: Column) -> Any:
    if column.kind == "name":
        return [one.decode() if isinstance(one, bytes) else str(one) for one in values]
    return np.asarray(values, dtype=np.float64 if column.kind == "float" else np.int64)


def to_pandas(run: RunData, name: str) -> pd.DataFrame:
    """Return a table as a DataFrame; see `Trajectory.to_pandas`."""
    columns = table(run, name)
    try:
        import pandas as pd
    except ImportError as error:
        raise InputError("run.to_pandas() needs pandas: pip install 'mbvi[tables]'") from error
    # copies, because the arrays of a run are read-only
    data = {
        key: pd.Series(one.values, dtype="str") if isinstance(one.values, list) else one.values.copy()
        for key, one in columns.items()
    }
    frame = pd.DataFrame(data)
    frame.attrs["units"] = {key: one.unit for key, one in columns.items()}
    return frame.set_index("t") if name == "states" else frame


def to_xarray(run: RunData) -> xr.Dataset:
    """Return all tables as one Dataset; see `Trajectory.to_xarray`."""
    try:
        import xarray as xr
    except ImportError as error:
        raise InputError("run.to_xarray() needs xarray: pip install 'mbvi[tables]'") from error
    of_q, of_v = coordinates(run)
    variables = dict[str, Any]()
    for letter, dimension, states in (("q", "coordinate", run.q), ("v", "velocity", run.v)):
        variables[letter] = (("t", dimension), states.copy(), {"long_name": STATES[letter].description})
    for key, (values, unit, description) in _of_states(run).items():
        variables[key.replace("/", "_")] = ("t", values.copy(), {"units": unit, "long_name": description})
    tables = {"impact": _impacts(run)} | ({"contact": _contacts(run)} if run.record.contacts is not None else {})
    for dimension, (columns, rows) in tables.items():
        for key, values in rows.items():
            column = columns[key]
            dims = (dimension, "axis") if column.shape == (3,) else (dimension,)
            texts = str if column.kind == "name" else None
            attributes = {"units": column.unit, "long_name": column.description}
            variables[f"{dimension}_{key}"] = (dims, np.array(values, dtype=texts), attributes)
    coords = {
        "t": ("t", run.t.copy(), {"units": "s", "long_name": STATES["t"].description}),
        "coordinate": ("coordinate", [one.name for one in of_q]),
        "coordinate_unit": ("coordinate", [one.unit for one in of_q]),
        "velocity": ("velocity", [one.name for one in of_v]),
        "velocity_unit": ("velocity", [one.unit for one in of_v]),
        "axis": ("axis", list(_AXES)),
    }
    about = {"scheme": run.scheme, "step": run.step, "notes": "\n".join(run.notes)}
    return xr.Dataset(variables, coords, about)
