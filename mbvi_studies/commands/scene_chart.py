"""`mbvi chart piles` and `mbvi chart friction`: scenes run by mbvi and other engines, as a picture and a table."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from mbvi.errors import InputError, MbviError

from ..pictures import check_pictures

if TYPE_CHECKING:
    from ..engines import Peer

# the name of the picture of friction on the command line
FRICTION = "friction"
# steps [s] of mbvi and accepted depths of piles, and steps of other engines with piles
_PILE_STEPS, _DEPTHS = (4e-3, 2e-3, 1e-3), (1e-2, 1e-3, 1e-4)
_PEER_STEPS = (4e-3, 2e-3, 1e-3, 5e-4, 2e-4, 1e-4)
# steps of all engines with friction [s]
_FRICTION_STEPS = (4e-3, 2e-3, 1e-3, 5e-4)


class SceneChart(NamedTuple):
    """What is measured and drawn.

    Attributes
    ----------
    scenes : sequence of str
        Names of the scenes.
    record : type
        Dataclass of the records.
    adapter : callable
        Peer -> the module that runs the scenes in it, "" if there is none.
    ours, others : callable
        (scene) and (module, scene) -> a function and its arguments, which return records; called in a worker process.
    draw, table : callable
        (records, footnote) -> Figure and (records) -> str.
    lines : callable
        (records) -> what is printed below the table.
    """

    scenes: Sequence[str]
    record: type
    adapter: Callable[[Peer], str]
    ours: Callable[[str], tuple[Any, ...]]
    others: Callable[[str, str], tuple[Any, ...]]
    draw: Callable[..., Any]
    table: Callable[..., str]
    lines: Callable[..., Iterable[str]]


def chart_scenes(words: Sequence[str], peers: bool, budget: float, out: Path) -> None:
    """Measure and draw scenes of one picture.

    Parameters
    ----------
    words : sequence of str
        The name of the picture, then the names of its scenes; all of them if none is named.
    peers : bool
        Whether to run other engines that are installed.
    budget : float
        CPU time that a run may cost, judged by the run before it [s]; shorter steps are left out.
    out : Path
        Where to write, without suffix.
    """
    from ..chart.records import write_table
    from ..chart.workers import machine

    name, scenes = words[0], words[1:]
    chart = _friction(budget) if name == FRICTION else _piles(name, budget)
    for scene in scenes:
        if scene not in chart.scenes:
            raise InputError(f"no scene {scene!r} of {name}; known are {'; '.join(chart.scenes)}")
    check_pictures(out.parent)
    records = _measured(chart, scenes or chart.scenes, peers)
    write_table(records, out.with_suffix(".csv"), chart.record)
    figure = chart.draw(records, f"One thread; {machine()}.")
    for suffix in (".png", ".svg"):
        figure.savefig(out.with_suffix(suffix), dpi=110)
    print(chart.table(records))
    for line in dict.fromkeys(chart.lines(records)):
        print(line)
    print(f"picture      {out.with_suffix('.png')}, {out.with_suffix('.svg')}")
    print(f"table        {out.with_suffix('.csv')}")


def _piles(picture: str, budget: float) -> SceneChart:
    from ..chart.pile_picture import draw_piles, pile_table
    from ..chart.pile_runs import PileRecord, sweep_ours, sweep_peer_piles
    from ..chart.piles import PICTURES

    return SceneChart(
        list(PICTURES[picture].scenes),
        PileRecord,
        lambda peer: peer.piles,
        lambda scene: (sweep_ours, picture, scene, _PILE_STEPS, _DEPTHS, budget),
        lambda module, scene: (sweep_peer_piles, module, picture, scene, _PEER_STEPS, budget),
        draw_piles,
        pile_table,
        lambda records: (f"{r.line.partition(', h =')[0]}: {r.setting}" for r in records),
    )


def _friction(budget: float) -> SceneChart:
    from ..chart.friction import ROUGH
    from ..chart.friction_picture import draw_friction, friction_table
    from ..chart.friction_runs import FrictionRecord, sweep_other, sweep_ours

    return SceneChart(
        list(ROUGH),
        FrictionRecord,
        lambda peer: peer.friction,
        lambda scene: (sweep_ours, scene, _FRICTION_STEPS, budget),
        lambda module, scene: (sweep_other, module, scene, _FRICTION_STEPS, budget),
        draw_friction,
        friction_table,
        lambda records: [
            *(f"{r.title}: errors against {r.source}" for r in records),
            *(f"{r.line}: {r.setting}" for r in records),
        ],
    )


def _measured(chart: SceneChart, scenes: Sequence[str], peers: bool) -> list[Any]:
    from mbvi.arguments.bar import Bar

    from ..chart.workers import worker
    from ..engines import PEERS

    others = [peer for peer in PEERS if chart.adapter(peer)] if peers else []
    for peer in others:
        if not peer.installed:
            print(f"{peer.name} is not installed: {peer.install}")
    running = [peer for peer in others if peer.installed]
    records: list[Any] = []
    with Bar(total=len(scenes) * (1 + len(running)), unit="sweep", disable=None) as bar:
        for scene in scenes:
            bar.set_description(f"{scene}, mbvi")
            with worker() as call:
                records += call(*chart.ours(scene))
            bar.update()
            for peer in running:
                bar.set_description(f"{scene}, {peer.name}")
                with worker(silent=True) as call:
                    try:
                        records += call(*chart.others(chart.adapter(peer), scene))
                    except (ImportError, RuntimeError, ValueError, MbviError) as error:
                        # an error of another engine costs its own points only
                        bar.write(f"{peer.name} failed on {scene}: {error}")
                bar.update()
    return records
