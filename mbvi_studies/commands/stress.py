"""`mbvi stress`: run the stress scenes, print verdicts, write a JSON file and the heat map."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mbvi.cli.help_texts import examples
from mbvi.errors import InputError

from ..pictures import check_pictures

if TYPE_CHECKING:
    from ..stress.scene import StressScene
    from ..stress.sweep import Cell

_STEPS, _LONG_STEPS, _TOLERANCES = (1e-1, 1e-2, 1e-3), (0.5, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6), (1e-4, 1e-8)
# factor on steps, so that no event falls on the end of a step
_STEP_FACTOR = 1.03


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode=None)


@app.command(epilog=examples("mbvi stress --list", "mbvi stress chain --step 1e-3 --step 1e-4"))
def stress(
    scenes: Annotated[
        list[str] | None,
        typer.Argument(metavar="[SCENE]...", help="Words in the names of scenes; all scenes by default."),
    ] = None,
    step: Annotated[list[float] | None, typer.Option(help="Time step [s]; repeatable.")] = None,
    tolerance: Annotated[list[float] | None, typer.Option(help="Tolerance of EventDriven; repeatable.")] = None,
    budget: Annotated[float, typer.Option(help="Limit of the CPU time of one run [s].")] = 10.0,
    long: Annotated[
        bool, typer.Option("--long", help="Add the scenes that need minutes, and steps from 1e-6 to 0.5 s.")
    ] = False,
    peers: Annotated[bool, typer.Option("--peers", help="Add the other engines that are installed.")] = False,
    keep: Annotated[
        bool, typer.Option("--keep", help="Keep the results of the other scenes that DIR/stress.json holds.")
    ] = False,
    listed: Annotated[bool, typer.Option("--list", help="Print the scenes and exit.")] = False,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Where to write.")] = Path("out/stress"),
) -> None:
    """Run the scenes where methods fail, over schemes and steps."""
    # imported here because it is slow: scenes compute their exact solutions
    from mbvi.arguments.bar import Bar

    from ..stress.files import read_cells, replaced, write_cells
    from ..stress.sweep import SCHEMES, sweep

    chosen = _chosen(scenes or [], long or listed)
    if listed:
        for scene in chosen:
            print(f"{scene.name}: {scene.number}; held up to {scene.held:g}, failed beyond {scene.failed:g}")
        return
    check_pictures(out)
    kept = read_cells(out / "stress.json", budget) if keep else []
    steps = [_STEP_FACTOR * h for h in step or (_LONG_STEPS if long else _STEPS)]
    tolerances = tolerance or _TOLERANCES
    total = len(chosen) * (len(SCHEMES) * len(steps) + len(tolerances))
    cells: list[Cell] = []
    with Bar(total=total, unit="run") as bar:
        for cell in sweep(chosen, steps, tolerances, budget):
            cells.append(cell)
            bar.set_postfix_str(f"{cell.scene}, {cell.scheme}", refresh=False)
            bar.update()
    if peers:
        cells += _peers(chosen, steps, budget)
    cells = replaced(kept, chosen, cells)
    write_cells(cells, budget, out / "stress.json")
    pictures = _pictures(cells, out)
    _print(cells)
    print(f"wrote {out / 'stress.json'}, {', '.join(map(str, pictures))}")


def _chosen(parts: Sequence[str], long: bool) -> list[StressScene]:
    from ..stress.scenes import SCENES

    found = [s for s in SCENES if any(part.lower() in s.name.lower() for part in parts)]
    missing = [part for part in parts if not any(part.lower() in s.name.lower() for s in SCENES)]
    if missing:
        raise InputError(f"no scene's name contains {missing[0]!r}: see mbvi stress --list")
    return found or [s for s in SCENES if long or not s.long]


def _peers(scenes: Sequence[StressScene], steps: Sequence[float], budget: float) -> list[Cell]:
    from mbvi.arguments.bar import Bar

    from ..engines import PEERS
    from ..stress.peers import sweep_peer

    cells: list[Cell] = []
    for peer in PEERS:
        if not peer.installed:
            print(f"{peer.name} is not installed: {peer.install}")
            continue
        with Bar(total=len(scenes) * len(steps), unit="run", desc=peer.name) as bar:
            try:
                for cell in sweep_peer(peer, scenes, steps, budget):
                    cells.append(cell)
                    bar.set_postfix_str(cell.scene, refresh=False)
                    bar.update()
            except ImportError as error:
                bar.write(f"{peer.name} cannot be loaded: {error}")
    return cells


def _pictures(cells: Sequence[Cell], out: Path) -> list[Path]:
    """Draw the map of schemes, and that of other engines beside the default scheme; return the files."""
    from ..stress.picture import draw

    own, others = [cell for cell in cells if cell.own], [cell for cell in cells if not cell.own]
    drawn = {"stress": own}
    if others:
        scenes, beside = {cell.scene for cell in others}, ("default", "EventDriven")
        drawn["stress_engines"] = [c for c in own if c.scheme in beside and c.scene in scenes] + others
    found = []
    for name, some in drawn.items():
        files = [out / f"{name}.png", out / f"{name}.svg"]
        draw(some, files)
        found += files
    return found


def _print(cells: Sequence[Cell]) -> None:
    for scheme in dict.fromkeys(cell.scheme for cell in cells):
        count = Counter(cell.verdict for cell in cells if cell.scheme == scheme)
        print(f"{scheme}: {', '.join(f'{n} {verdict}' for verdict, n in count.most_common())}")
