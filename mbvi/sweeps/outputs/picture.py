"""The picture of a study: maps over two parameters, or each quantity over each parameter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ...arguments import optional, several_names, shown
from ...errors import InputError
from ..points import OWN_COLUMNS
from ..rows import STATUS

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.figure import Figure

# up to so many whole numbers are shown as classes
_MOST_CLASSES = 8
_CLASSES = ("#4477aa", "#ee6677", "#228833", "#ccbb44", "#66ccee", "#aa3377", "#bbbbbb", "#222222")
_MOST_PANELS = 30
_FAILED = "#d62728"


def plot_sweep(ds: xr.Dataset, names: Sequence[str] | None = None) -> Figure:
    """Draw the table of a sweep: a map over two parameters, else each quantity over each parameter.

    Parameters
    ----------
    ds : xarray.Dataset
        What `sweep` returned, or a part of it.
    names : sequence of str, optional
        Measured quantities; all that are one number for each run by default. What is written at an axis is the
        variable's `attrs["long_name"]`, or its name, and its `attrs["units"]`.

    Returns
    -------
    matplotlib.figure.Figure
        One panel for each quantity, or for each quantity and parameter. Runs without a result are marked by crosses.

    Raises
    ------
    InputError
        If `ds` is no table of a sweep, a name is no quantity of it, it has nothing to draw or too much, or matplotlib
        is not installed.
    """
    table = _table(ds, optional(several_names, names, "names"))
    try:
        from ...results.plots.notebook import NotebookFigure
    except ImportError as error:
        raise InputError("pictures need matplotlib: pip install 'mbvi[charts]'") from error
    varied = [name for name, values in table.parameters.items() if len(np.unique(values)) > 1] or list(table.parameters)
    if table.grid and len(varied) == 2:
        columns = min(len(table.quantities), 3)
        rows = -(-len(table.quantities) // columns)
        figure = NotebookFigure(figsize=(4.6 * columns + 0.4, 3.7 * rows + 0.3), layout="constrained")
        panels = figure.subplots(rows, columns, squeeze=False).ravel()
        for panel, name in zip(panels, table.quantities, strict=False):
            _map(figure, panel, table, name, varied)
        for panel in panels[len(table.quantities) :]:
            panel.set_axis_off()
    else:
        if len(table.quantities) * len(varied) > _MOST_PANELS:
            raise InputError(f"more than {_MOST_PANELS} panels: choose quantities by names=")
        size = (3.4 * len(varied) + 0.6, 2.6 * len(table.quantities) + 0.5)
        figure = NotebookFigure(figsize=size, layout="constrained")
        lines = figure.subplots(len(table.quantities), len(varied), squeeze=False, sharex="col", sharey="row")
        for line, quantity in zip(lines, table.quantities, strict=True):
            for panel, name in zip(line, varied, strict=True):
                _scatter(panel, table, quantity, name)
            line[0].set_ylabel(table.labels[quantity])
        for panel, name in zip(lines[-1], varied, strict=True):
            panel.set_xlabel(table.labels[name])
    figure.suptitle(table.title, fontsize="medium")
    return figure


@dataclass(frozen=True)
class _Table:
    """Columns of a table, one entry for each run."""

    parameters: dict[str, Any]
    quantities: dict[str, Any]
    good: np.ndarray
    grid: bool
    title: str
    labels: dict[str, str]


def _table(ds: Any, names: tuple[str, ...] | None) -> _Table:
    try:
        dims = ds["status"].dims
        good = np.asarray(ds["status"].values == STATUS.ok).ravel()
        grid = dims != ("run",)
        found = {str(n): v for n, v in ds.data_vars.items() if v.dims == dims and n not in OWN_COLUMNS}
        axes = [
            str(n) for n, v in ds.coords.items() if set(v.dims) <= set(dims) and (v.dims or not grid) and n != "run"
        ]
        parameters = {n: np.asarray(ds[n].broadcast_like(ds["status"]).values).ravel() for n in axes}
        study = str(ds.attrs.get("study", ""))
    # anything may have been given
    except Exception as error:
        raise InputError(f"ds must be the Dataset that mbvi.sweep returned; got {shown(type(ds))}") from error
    numbers = {n: np.asarray(v.values).ravel() for n, v in found.items() if v.dtype.kind in "biuf"}
    unknown = [name for name in names or () if name not in numbers]
    if unknown:
        raise InputError(
            f"no quantity {shown(unknown[0])} with one number for each run; known are {', '.join(numbers)}"
        )
    chosen = {name: numbers[name] for name in names or numbers}
    if not chosen or not parameters or not good.size:
        raise InputError("the table holds no parameter or no quantity with one number for each run")
    failed = int((~good).sum())
    title = f"{study.rpartition('/')[2]}: {good.size} runs" + (
        f", {failed} without a result (crosses)" if failed else ""
    )
    labels = {name: _label(name, ds[name].attrs) for name in (*parameters, *chosen)}
    return _Table(parameters, chosen, good, grid, title.removeprefix(": "), labels)


def _label(name: str, about: Mapping[str, Any]) -> str:
    """Return the name of a variable, or what is written for it, with its unit."""
    return f"{about.get('long_name', name)}" + (f" [{about['units']}]" if "units" in about else "")


def _axis(values: Any) -> tuple[Any, list[str] | None]:
    """Return places on an axis, and labels where the values are no numbers."""
    if np.asarray(values).dtype.kind in "biuf":
        return np.asarray(values, dtype=float), None
    known, places = np.unique(np.asarray(values, dtype=str), return_inverse=True)
    return places.astype(float), list(known)


def _map(figure: Any, panel: Any, table: _Table, name: str, varied: Sequence[str]) -> None:
    from matplotlib.colors import BoundaryNorm, ListedColormap

    (y, y_labels), (x, x_labels) = (_axis(table.parameters[axis]) for axis in varied)
    ys, row = np.unique(y, return_inverse=True)
    xs, column = np.unique(x, return_inverse=True)
    values = np.full((len(ys), len(xs)), np.nan)
    values[row[table.good], column[table.good]] = table.quantities[name][table.good]
    classes = np.unique(values[np.isfinite(values)])
    look: dict[str, Any] = {"cmap": "viridis"}
    if 0 < len(classes) <= _MOST_CLASSES and (classes == np.round(classes)).all():
        edges = np.concatenate([classes - 0.5, [classes[-1] + 0.5]])
        look = {"cmap": ListedColormap(_CLASSES[: len(classes)]), "norm": BoundaryNorm(edges, len(classes))}
    drawn = panel.pcolormesh(xs, ys, values, shading="nearest", rasterized=True, **look)
    bar = figure.colorbar(drawn, ax=panel)
    if "norm" in look:
        middles = 0.5 * (edges[1:] + edges[:-1])
        bar.set_ticks(middles, labels=[f"{value + 0.0:g}" for value in classes])
        bar.minorticks_off()
    _crosses(panel, x[~table.good], y[~table.good])
    panel.set(xlabel=table.labels[varied[1]], ylabel=table.labels[varied[0]], title=table.labels[name])
    _labels(panel, x_labels, y_labels)


def _scatter(panel: Any, table: _Table, quantity: str, name: str) -> None:
    x, labels = _axis(table.parameters[name])
    y = np.asarray(table.quantities[quantity], dtype=float)
    single = len(table.parameters) == 1
    order = np.argsort(x[table.good], kind="stable")
    look = {"markersize": 3, "alpha": 1.0 if single else max(0.15, min(1.0, 200.0 / len(x))), "color": _CLASSES[0]}
    panel.plot(
        x[table.good][order], y[table.good][order], "o-" if single else "o", linewidth=0.8, markeredgewidth=0, **look
    )
    failed = x[~table.good]
    if failed.size:
        # on the lower edge, whatever the scale
        panel.plot(failed, np.full(len(failed), 0.03), "x", color=_FAILED, transform=panel.get_xaxis_transform())
    panel.grid(alpha=0.3)
    _labels(panel, labels, None)


def _crosses(panel: Any, x: np.ndarray, y: np.ndarray) -> None:
    if len(x):
        panel.plot(x, y, "x", color=_FAILED, markersize=max(2.0, min(7.0, 60.0 / len(x) ** 0.5)))


def _labels(panel: Any, x: list[str] | None, y: list[str] | None) -> None:
    if x is not None:
        panel.set_xticks(range(len(x)), x)
    if y is not None:
        panel.set_yticks(range(len(y)), y)
