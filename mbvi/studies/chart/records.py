"""Points of a chart, and the table they are kept in."""

from __future__ import annotations

import csv
import os
from collections.abc import Iterable
from dataclasses import asdict, dataclass, fields
from pathlib import Path

from ...errors import InputError

NOT = float("nan")


@dataclass(frozen=True)
class Record:
    """One point of a chart: a scheme or engine on a problem, at one step or tolerance; what was not measured is NaN.

    Attributes
    ----------
    problem : str
        Its name.
    e : float
        Restitution.
    duration : float
        How long was simulated [s].
    plotted : str
        Which error tells: "q", "energy" or "penetration".
    scheme : str
        The scheme, or the engine with its version.
    setting : str
        How it was set.
    step : float
        Time step [s]; the mean one of a scheme that chooses its own.
    tolerance : float
        Of a scheme that chooses its steps.
    cpu : float
        CPU time of one run [s], the median of the repeats.
    repeats : int
        Runs; the errors are the largest of them.
    q : float
        Largest difference of configurations [m, rad].
    v : float
        Integral of |v_h - v| over time [m, rad].
    graph : float
        Hausdorff distance of the graphs of v_h and v.
    energy : float
        Mean over time of |E_h - E|, configurations and velocities at consistent times [J].
    penetration : float
        Deepest, [m, rad].
    source : str
        What the errors are measured against.
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
        """The error that tells."""
        return float(getattr(self, self.plotted))


def write_csv(records: Iterable[Record], path: str | os.PathLike[str]) -> None:
    """Write records as a table whose columns are their attributes, numbers with all their digits."""
    with open(path, "w", newline="", encoding="utf-8") as file:
        table = csv.DictWriter(file, [f.name for f in fields(Record)], lineterminator="\n")
        table.writeheader()
        table.writerows(asdict(record) for record in records)


def read_csv(path: str | os.PathLike[str]) -> tuple[Record, ...]:
    """Return the records of a table that `write_csv` wrote.

    Raises
    ------
    InputError
        If the file is no such table.
    """
    kinds = {"str": str, "float": float, "int": int}
    with Path(path).open(newline="", encoding="utf-8") as file:
        table = csv.DictReader(file)
        if table.fieldnames != [f.name for f in fields(Record)]:
            raise InputError(f"{path} is no table of `mbvi chart`: its columns are others")
        return tuple(Record(**{f.name: kinds[str(f.type)](row[f.name]) for f in fields(Record)}) for row in table)
