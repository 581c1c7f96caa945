"""Points of a chart and their CSV file."""

from __future__ import annotations

import csv
import os
from collections.abc import Iterable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TypeVar

from mbvi.errors import InputError

NOT_MEASURED = float("nan")
# a dataclass of text and numbers
R = TypeVar("R")


@dataclass(frozen=True)
class Record:
    """One point of a chart: a scheme or engine on a problem, at one step or tolerance; NaN means not measured.

    Attributes
    ----------
    problem : str
        Its name.
    e : float
        Restitution.
    duration : float
        Simulated time [s].
    plotted : str
        Which error is drawn: "q", "energy" or "penetration".
    scheme : str
        The scheme, or the engine with its version.
    setting : str
        Its settings.
    step : float
        Time step [s]; the mean step of a scheme that chooses its steps.
    tolerance : float
        Tolerance of a scheme that chooses its steps.
    cpu : float
        CPU time of one run [s], the median of the repeats.
    repeats : int
        Number of runs; the largest error of them counts.
    q : float
        Largest difference of configurations [m, rad].
    v : float
        Integral of |v_h - v| over time [m, rad].
    graph : float
        Hausdorff distance of the graphs of v_h and v.
    energy : float
        Mean over time of |E_h - E|, configurations and velocities at consistent times [J].
    penetration : float
        Deepest penetration [m, rad].
    source : str
        Reference of the errors.
    """

    problem: str
    e: float
    duration: float
    plotted: str
    scheme: str
    setting: str
    step: float
    tolerance: float
    cpu: float
    repeats: int
    q: float
    v: float
    graph: float
    energy: float
    penetration: float
    source: str

    @property
    def error(self) -> float:
        """The error that is drawn."""
        return float(getattr(self, self.plotted))


def write_csv(records: Iterable[Record], path: str | os.PathLike[str]) -> None:
    """Write records to a CSV file whose columns are their attributes; numbers keep all digits."""
    write_table(records, path, Record)


def read_csv(path: str | os.PathLike[str]) -> tuple[Record, ...]:
    """Return the records of a file that `write_csv` wrote; see `read_table`."""
    return read_table(path, Record)


def write_table(records: Iterable[R], path: str | os.PathLike[str], kind: type[R]) -> None:
    """Write records of a dataclass to a CSV file whose columns are their attributes; numbers keep all digits."""
    names = [f.name for f in fields(kind)]  # type: ignore[arg-type]
    with open(path, "w", newline="", encoding="utf-8") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(names)
        table.writerows([getattr(record, name) for name in names] for record in records)


def read_table(path: str | os.PathLike[str], kind: type[R]) -> tuple[R, ...]:
    """Return the records of a file that `write_table` wrote.

    Raises
    ------
    InputError
        If the file has other columns.
    """
    kinds = {"str": str, "float": float, "int": int}
    columns = {f.name: kinds[str(f.type)] for f in fields(kind)}  # type: ignore[arg-type]
    with Path(path).open(newline="", encoding="utf-8") as file:
        table = csv.DictReader(file)
        if table.fieldnames != list(columns):
            raise InputError(f"{path} is not a table of `mbvi chart`: its columns differ")
        return tuple(kind(**{name: read(row[name]) for name, read in columns.items()}) for row in table)
