"""`mbvi chart`: error against CPU time and step, as a picture and a table."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mbvi.arguments import positive
from mbvi.cli.help_texts import examples
from mbvi.cli.names.schemes import SchemeName
from mbvi.errors import InputError

from ..pictures import check_pictures
from .gradient_chart import GRADIENTS, chart_gradients
from .scene_chart import FRICTION, chart_scenes

if TYPE_CHECKING:
    from mbvi.schemes import OwnStepsScheme, Scheme

    from ..chart.records import Record
    from ..chart.sweep import Case

# the error for which the cost is printed
_TARGET = 1e-4
# CPU time of one run of a pile [s]
_PILE_BUDGET = 20.0

_Problems = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="[PROBLEM]...",
        help="Names of problems, or piles or friction and names of its scenes, or gradients; --list prints them.",
        show_default=False,
    ),
]
_Schemes = Annotated[
    str,
    typer.Option(
        metavar="NAME,...", help="Names separated by commas.", show_default="all that are made for the problem"
    ),
]
_Budget = Annotated[
    float | None,
    typer.Option(
        help="Of piles and friction: CPU time that a run may cost, judged by the run before [s].",
        show_default=f"{_PILE_BUDGET:g}",
    ),
]
_Out = Annotated[Path, typer.Option(metavar="STEM", help="Where to write: STEM.png, STEM.svg and STEM.csv.")]

_EXAMPLES = examples(
    "mbvi chart --list",
    "mbvi chart --schemes paoli,event-driven --out out/chart",
    "mbvi chart piles --peers --budget 60",
    "mbvi chart gradients",
)

app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)


@app.command(epilog=_EXAMPLES)
def chart(
    problems: _Problems = None,
    schemes: _Schemes = "",
    e: Annotated[float, typer.Option(help="Restitution; scenes of many spheres have their own.")] = 0.5,
    peers: Annotated[bool, typer.Option("--peers", help="Add the other engines that are installed.")] = False,
    budget: _Budget = None,
    out: _Out = Path("out/chart"),
    listed: Annotated[bool, typer.Option("--list", help="Print the names of problems, schemes and engines.")] = False,
) -> None:
    """Chart accuracy against CPU time.

    Shows errors, also against the step; of piles the worst depth, of friction the creep, of gradients derivatives
    through an impact.
    """
    from ..chart.cases import CASES, DEFAULT_CASES
    from ..chart.friction import ROUGH
    from ..chart.piles import PICTURES
    from ..chart.records import write_csv
    from ..engines import PEERS

    words = {name.value: name for name in SchemeName}
    if listed:
        print("\n  ".join(["problems", *CASES]))
        print("without a name: " + "; ".join(DEFAULT_CASES))
        for name, picture in PICTURES.items():
            print(f"scenes of {name}: {'; '.join(picture.scenes)}")
        print(f"scenes of {FRICTION}: {'; '.join(ROUGH)}")
        print(f"{GRADIENTS}: derivatives through an impact, by mbvi and MuJoCo")
        print("\n  ".join(["schemes", *words]))
        print("\n  ".join(["engines", *(f"{p.name}: {'installed' if p.installed else p.install}" for p in PEERS)]))
        return
    if problems and GRADIENTS in problems:
        if len(problems) > 1 or schemes or peers or budget is not None:
            raise InputError(f"{GRADIENTS} is a picture of its own: give it alone, and no option but --out")
        chart_gradients(out)
        return
    if problems and problems[0] in (*PICTURES, FRICTION):
        if schemes:
            raise InputError(f"{problems[0]} has schemes of its own: leave out --schemes")
        chart_scenes(problems, peers, _PILE_BUDGET if budget is None else positive(budget, "budget"), out)
        return
    if budget is not None:
        raise InputError("--budget is an option of piles and friction")
    chosen = [_checked_name(name.replace("-", " "), list(CASES), "problem") for name in problems or DEFAULT_CASES]
    named = [_checked_name(name.strip().lower(), list(words), "scheme") for name in schemes.split(",") if name.strip()]
    check_pictures(out.parent)
    tasks = _tasks(chosen, named)
    records = _measured(tasks, e)
    if peers:
        records += _peers(chosen, e)
    if not records:
        raise InputError("nothing to chart: EventDriven is not run on many constraints; choose another scheme")
    write_csv(records, out.with_suffix(".csv"))
    _write_picture(records, out)
    _print_summary(records, out)


def _tasks(problems: list[str], schemes: list[str]) -> list[tuple[str, Scheme | OwnStepsScheme]]:
    """Return each problem with each of the schemes, by default all, that is made for it."""
    from ..chart.cases import MANY_CONSTRAINTS

    made = {word.value: word.make() for word in SchemeName}
    left_out = {(problem, SchemeName.event_driven.value) for problem in MANY_CONSTRAINTS}
    return [
        (problem, made[word]) for problem in problems for word in schemes or made if (problem, word) not in left_out
    ]


def _checked_name(word: str, known: list[str], what: str) -> str:
    if word not in known:
        raise InputError(f"no {what} {word!r}; known are {'; '.join(known)}")
    return word


def _measured(tasks: list[tuple[str, Scheme | OwnStepsScheme]], e: float) -> list[Record]:
    from mbvi.arguments.bar import Bar

    from ..chart.cases import CASES
    from ..chart.workers import swept, worker

    records: list[Record] = []
    with worker() as call, Bar(tasks, unit="sweep", disable=None) as bar:
        for name, scheme in bar:
            bar.set_description(f"{name}, {type(scheme).__name__}")
            make: Callable[[float], Case] = CASES[name]
            records += call(swept, make, e, scheme)
    return records


def _peers(chosen: list[str], e: float) -> list[Record]:
    """Return the records of the engines that are installed, each run in a process of its own."""
    from mbvi.arguments.bar import Bar

    from ..chart.cases import CASES
    from ..chart.workers import worker
    from ..engines import PEERS
    from ..engines.bodies import NoModelError
    from ..engines.measure import ModelError, sweep_peer
    from ..engines.rig import RIGS

    records: list[Record] = []
    mapped = [name for name in chosen if name in RIGS]
    left = [name for name in chosen if name not in RIGS]
    if left:
        print(f"not run in other engines, because they are not problems of rigid bodies: {'; '.join(left)}")
    for peer in PEERS:
        if not peer.installed:
            print(f"{peer.name} is not installed: {peer.install}")
            continue
        with worker(silent=True) as call, Bar(mapped, unit="sweep", disable=None, desc=peer.name) as bar:
            for name in bar:
                try:
                    records += call(sweep_peer, peer.module, CASES[name], e)
                except ModelError as error:
                    bar.write(str(error))
                except NoModelError as error:
                    bar.write(f"{peer.name} is not run on {name}: {error}")
                except (ImportError, RuntimeError, ValueError) as error:
                    # an error of another engine costs its own points only
                    bar.write(f"{peer.name} failed on {name}: {error}")
    return records


def _write_picture(records: list[Record], out: Path) -> None:
    from ..chart.picture import draw
    from ..chart.workers import machine

    figure = draw(records, f"One thread; {machine()}.")
    for suffix in (".png", ".svg"):
        figure.savefig(out.with_suffix(suffix), dpi=110)


def _print_summary(records: list[Record], out: Path) -> None:
    """Print the table, the settings of engines, and the files written."""
    from ..chart.costs import table

    print(table(records, _TARGET))
    for problem, source in dict.fromkeys((r.problem, r.source) for r in records):
        print(f"{problem}: errors against {source}")
    for scheme, setting in dict.fromkeys((r.scheme, r.setting) for r in records if r.setting):
        print(f"{scheme}: {setting}")
    print(f"picture      {out.with_suffix('.png')}, {out.with_suffix('.svg')}")
    print(f"table        {out.with_suffix('.csv')}")
