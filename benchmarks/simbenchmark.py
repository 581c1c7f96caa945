"""mbvi and MuJoCo on SimBenchmark's tests, in one run, beside RaiSim's published numbers.

    python benchmarks/simbenchmark.py                       # print the tables of docs/benchmarks/simbenchmark.md
    python benchmarks/simbenchmark.py --test bouncing       # one test; repeatable
    python benchmarks/simbenchmark.py --write               # measure all; write the page's tables, picture and CSV file
    python benchmarks/simbenchmark.py --draw                # the same from the numbers of the CSV file

The tests are in `simbenchmark_cases.py`, the engines in `simbenchmark_engines.py`. An error is a mean of squares over
the states before each step, from a run whose states are kept. A time is the CPU time of another run: of
`mbvi.simulate`, which records all states, less a run of one step, and of MuJoCo's batched `mj_step`, which records
nothing. The engines take turns; times are medians over the repeats, ratios medians of the ratios of runs next to each
other. The real-time factor is the simulated time over that time. MuJoCo and example-robot-data are needed
(`pip install mbvi[test]`).
"""

from __future__ import annotations

import os

# read once, when numpy is imported
for _variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")

import argparse  # noqa: E402
import csv  # noqa: E402
from collections.abc import Iterator, Sequence  # noqa: E402
from dataclasses import asdict, dataclass, fields  # noqa: E402
from pathlib import Path  # noqa: E402
from typing import TYPE_CHECKING  # noqa: E402

import numpy as np  # noqa: E402
from simbenchmark_cases import TRIALS  # noqa: E402
from simbenchmark_engines import DELIVERED, VARIANTS, Ours, Theirs, simulated_time  # noqa: E402
from turns import machine, table  # noqa: E402

import mbvi  # noqa: E402

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAGE = Path(__file__).parents[1] / "docs/benchmarks/simbenchmark.md"
NUMBERS, PICTURE = PAGE.with_suffix(".csv"), PAGE.with_suffix(".png")
BEGIN, END = "<!-- measured: python benchmarks/simbenchmark.py --write -->\n", "<!-- end of the measured part -->\n"
OURS, MUJOCO, RAISIM = "mbvi", "MuJoCo", "RaiSim, published"
# tests of smooth motion between few impacts, which the default scheme locates where no step is given
LOCATED = {"energy": (1e-6, 1e-9)}
# RaiSim without error reduction: step [s], error, CPU time of the whole run [s], from data/*/sample.csv, and
# data/rolling/default.csv (force along the diagonal) of SimBenchmark at commit 3fd1764, on its authors' machine
PUBLISHED = {
    "rolling": ((1e-3, 4.13711e-07, 0.308104),),
    "bouncing": ((4e-4, 0.000477103, 0.601746), (1e-3, 0.0186204, 0.235136), (4e-3, 4.76468, 0.0610991),
                 (1e-2, 185.953, 0.0252509)),
    "666": ((1e-3, 0.00013534, 1.51045), (4e-3, 0.00211391, 0.38779), (1e-2, 0.0152745, 0.167983)),
    "elastic 666": ((1e-3, 8.36835, 0.655143), (4e-3, 264.072, 0.180666), (1e-2, 5.18417e06, 0.0702891)),
    "momentum": ((1e-3, 4.67537e-05, 0.058022), (4e-3, 0.00091496, 0.016257), (1e-2, 0.00538685, 0.00609994)),
    "energy": ((4e-4, 0.0018144, 0.035285), (1e-3, 0.0118404, 0.0149939), (4e-3, 0.214716, 0.00422597),
               (1e-2, 1.39767, 0.00145698)),
    "PD": ((5e-3, np.nan, 0.406),),
}  # fmt: skip
# errors are drawn no lower
_LEAST = 1e-30


@dataclass(frozen=True)
class Record:
    """A point of the picture.

    Attributes
    ----------
    test, engine, setting : str
        A key of `TRIALS`; the engine; its scheme or integrator.
    step : float
        Time step, or the tolerance of a scheme that chooses its steps [s].
    error : float
        In the unit of the test; NaN where none is known.
    factor : float
        Real-time factor.
    ratio : float
        Real-time factor over that of MuJoCo as delivered at the same step; NaN where it was not measured beside.
    """

    test: str
    engine: str
    setting: str
    step: float
    error: float
    factor: float
    ratio: float = np.nan


def measured(test: str, repeats: int) -> Iterator[Record]:
    """Yield the points of a test; that at the step of the table is timed several times."""
    trial, whole = TRIALS[test], simulated_time(test)
    for h in trial.steps:
        mine, peers = Ours(test, h), [Theirs(test, h, variant) for variant in VARIANTS[test]]
        extra = [Ours(test, h, mbvi.EventDriven(tol)) for tol in LOCATED.get(test, ()) if h == trial.step]
        engines = [mine, *extra, *peers]
        errors = [trial.error(engine.states(), h) for engine in engines]
        count = repeats if h == trial.step else 1
        times = np.array([[engine.time() for engine in engines] for _ in range(count)])
        delivered = times[:, len(engines) - len(peers) + VARIANTS[test].index(DELIVERED)]
        factors, ratios = np.median(whole / times, axis=0), np.median(delivered[:, None] / times, axis=0)
        names = [(OURS, mine.used)]
        names += [(OURS, f"EventDriven({tol:g})") for tol in LOCATED.get(test, ()) if h == trial.step]
        names += [(MUJOCO, variant.label) for variant in VARIANTS[test]]
        for (engine, setting), error, factor, ratio in zip(names, errors, factors, ratios, strict=True):
            yield Record(test, engine, setting, h, float(error), float(factor), float(ratio))


def published() -> Iterator[Record]:
    """Yield RaiSim's points."""
    for test, points in PUBLISHED.items():
        for h, error, spent in points:
            yield Record(test, RAISIM, "no error reduction", h, error, simulated_time(test) / spent)


def cell(record: Record | None) -> str:
    """Return the cells of error and real-time factor."""
    if record is None:
        return "- | -"
    return f"{'-' if np.isnan(record.error) else f'{record.error:.1e}'} | {record.factor:.3g}"


def summary(records: Sequence[Record]) -> str:
    """Return the table at the step of each test: mbvi by default, MuJoCo as delivered and at its best, RaiSim."""
    lines = []
    for name, trial in TRIALS.items():
        here = [r for r in records if r.test == name and r.step == trial.step]
        mine = next((r for r in here if r.engine == OURS), None)
        peers = [r for r in here if r.engine == MUJOCO]
        if mine is None or not peers:
            continue
        best = min(peers, key=lambda r: r.error)
        rai = next((r for r in here if r.engine == RAISIM), None)
        lines.append(
            f"| {trial.title} | {trial.what} [{trial.unit}] | {1e3 * trial.step:g} | {cell(mine)} | {cell(peers[0])} "
            f"| {cell(best)} | {cell(rai)} | {mine.ratio:.2f} |"
        )
    heads = "test | error | h [ms] | mbvi, error | RTF | MuJoCo as delivered, error | RTF"
    return table(f"{heads} | MuJoCo's least error | RTF | RaiSim, error | RTF | speed, mbvi / MuJoCo", lines)


def verdict(records: Sequence[Record]) -> str:
    """Return where mbvi is behind MuJoCo, one line each."""
    lines = []
    for name, trial in TRIALS.items():
        here = [r for r in records if r.test == name and r.step == trial.step]
        mine, peers = [r for r in here if r.engine == OURS], [r for r in here if r.engine == MUJOCO]
        if not mine or not peers:
            continue
        first, best = mine[0], min(peers, key=lambda r: r.error)
        if first.error > peers[0].error:
            lines.append(
                f"- {trial.title}: the error is {first.error / peers[0].error:.2g} times that of MuJoCo as delivered."
            )
        if first.error > best.error:
            located = min(mine, key=lambda r: r.error)
            text = f"- {trial.title}: the error is above that of MuJoCo's {best.setting}, {best.error:.1e}."
            if located.error < best.error:
                text += (
                    f" `{located.setting}` has {located.error:.1e} at {located.ratio:.2g} of the speed as delivered."
                )
            lines.append(text)
        if first.ratio < 1.0 / 3.0:
            lines.append(f"- {trial.title}: the speed is {first.ratio:.2g} of MuJoCo's.")
    return "\n".join(lines) or "- nowhere: every error is below MuJoCo's, and every speed above a third of it."


def measured_part(records: Sequence[Record], about: str) -> str:
    """Return the part of the page that is measured."""
    used = {r.test: r.setting for r in records if r.engine == OURS and not r.setting.startswith("EventDriven(")}
    schemes = [f"| {TRIALS[name].title} | {setting} |" for name, setting in used.items()]
    parts = [summary(records), "Where mbvi is behind:", verdict(records), "Schemes that mbvi chose:"]
    return "\n\n".join([*parts, table("test | scheme", schemes), f"Measured on {about}."]) + "\n\n"


def draw(records: Sequence[Record]) -> Figure:
    """Return the picture: error against real-time factor, a panel for each test."""
    from matplotlib.figure import Figure
    from matplotlib.ticker import NullFormatter

    styles = {OURS: ("C3", "o", "-"), RAISIM: ("0.45", "D", ":")}
    mujoco_styles = iter([("C0", "s"), ("C9", "^"), ("C2", "s"), ("C8", "^"), ("C4", "v")])
    known: dict[tuple[str, str], dict[str, object]] = {}
    figure = Figure(figsize=(15.5, 8.2), layout="constrained")
    panels = figure.subplots(2, 4, squeeze=False).ravel()
    for axes in panels[len(TRIALS) :]:
        axes.remove()
    for axes, (name, trial) in zip(panels, TRIALS.items(), strict=False):
        mine = [r for r in records if r.test == name and not np.isnan(r.error)]
        located = [r for r in mine if r.setting.startswith("EventDriven(")]
        rest = [r for r in mine if r not in located]
        lines = dict.fromkeys((r.engine, r.setting if r.engine == MUJOCO else "") for r in rest)
        for engine, setting in lines:
            label = f"{engine}, {setting}" if setting else f"{engine}, default scheme" if engine == OURS else engine
            if (engine, setting) not in known:
                colour, marker, dash = styles.get(engine) or (*next(mujoco_styles), "-")
                known[engine, setting] = {"color": colour, "marker": marker, "linestyle": dash}
            points = sorted(
                (r for r in rest if r.engine == engine and setting in ("", r.setting)), key=lambda r: -r.step
            )
            errors = [max(r.error, _LEAST) for r in points]
            width = 2.2 if engine == OURS else 1.2
            axes.loglog([r.factor for r in points], errors, label=label, linewidth=width, **known[engine, setting])
        if located:
            errors = [max(r.error, _LEAST) for r in located]
            style = {"color": "C3", "marker": "*", "linestyle": "--", "markersize": 10}
            axes.loglog([r.factor for r in located], errors, label="mbvi, EventDriven", **style)
        axes.set_title(trial.title, fontsize="medium")
        axes.set(xlabel="real-time factor", ylabel=f"{trial.what} [{trial.unit}]")
        axes.margins(0.12)
        axes.xaxis.set_minor_formatter(NullFormatter())
        axes.grid(True, which="major", color="0.92", zorder=0)
    handles = {k: h for axes in figure.axes for h, k in zip(*axes.get_legend_handles_labels(), strict=True)}
    figure.legend(
        list(handles.values()), list(handles), loc="outside lower center", ncols=5, fontsize="small", frameon=False,
        title="Lines join the steps of an engine, the longest at the fast end. RaiSim ran on its authors' machine.",
        title_fontsize="x-small",
    )  # fmt: skip
    figure.suptitle("SimBenchmark: mean squared error against speed, lower right is better", fontsize="medium")
    return figure


def write_numbers(records: Sequence[Record]) -> None:
    """Write the CSV file."""
    with NUMBERS.open("w", newline="") as file:
        writer = csv.DictWriter(file, [field.name for field in fields(Record)], lineterminator="\n")
        writer.writeheader()
        for record in records:
            writer.writerow({k: v if isinstance(v, str) else f"{v:.6g}" for k, v in asdict(record).items()})


def read_numbers() -> list[Record]:
    """Read the CSV file; nothing if there is none."""
    if not NUMBERS.is_file():
        return []
    with NUMBERS.open(newline="") as file:
        text = {"test", "engine", "setting"}
        return [Record(**{k: v if k in text else float(v) for k, v in row.items()}) for row in csv.DictReader(file)]


def write_page(part: str) -> None:
    """Replace the measured part of the page.

    Raises
    ------
    SystemExit
        If the page has no such part.
    """
    before, found, rest = PAGE.read_text().partition(BEGIN)
    _, closing, after = rest.partition(END)
    if not found or not closing:
        raise SystemExit(f"{PAGE} has no measured part between {BEGIN.strip()!r} and {END.strip()!r}")
    PAGE.write_text(before + BEGIN + "\n" + part + END + after)


def main() -> None:
    """Print the tables and, with --write or --draw, put them into the page."""
    parser = argparse.ArgumentParser(description="Run SimBenchmark's tests in mbvi and in MuJoCo.")
    parser.add_argument("--test", action="append", choices=list(TRIALS), help="only this test; repeatable")
    parser.add_argument("--repeats", type=int, default=3, help="timed runs at the step of the table")
    parser.add_argument(
        "--write", action="store_true", help=f"write docs/benchmarks/{PAGE.name}, its picture and numbers"
    )
    parser.add_argument("--draw", action="store_true", help="write the page from the numbers measured before")
    asked = parser.parse_args()
    if asked.repeats < 1:
        parser.error("at least 1 repeat is asked for")
    tests, records = asked.test or list(TRIALS), list[Record]()
    if asked.draw or (asked.write and asked.test):
        # other tests keep the numbers that they have
        records = [r for r in read_numbers() if r.engine != RAISIM and (asked.draw or r.test not in tests)]
    for name in [] if asked.draw else tests:
        for record in measured(name, asked.repeats):
            records.append(record)
            print(record, flush=True)
    records += published()
    records.sort(key=lambda r: list(TRIALS).index(r.test))
    part = measured_part(records, machine())
    print(part)
    if asked.write or asked.draw:
        write_numbers(records)
        write_page(part)
        draw(records).savefig(PICTURE, dpi=90)


if __name__ == "__main__":
    main()
