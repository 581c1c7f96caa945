"""`mbvi chart piles`: worst depth of poured bodies against CPU time, as a picture and a table."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError, MbviError
from ..studies.pictures import check_pictures

if TYPE_CHECKING:
    from ..studies.chart.pile_runs import PileRecord

# steps [s] and accepted depths of mbvi, and steps of other engines
_STEPS, _DEPTHS = (4e-3, 2e-3, 1e-3), (1e-2, 1e-3, 1e-4)
_PEER_STEPS = (4e-3, 2e-3, 1e-3, 5e-4, 2e-4, 1e-4)


def chart_piles(words: Sequence[str], peers: bool, budget: float, out: Path) -> None:
    """Measure and draw one picture of piles.

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
    from ..studies.chart.pile_picture import draw_piles, pile_table
    from ..studies.chart.pile_runs import PileRecord
    from ..studies.chart.piles import PICTURES
    from ..studies.chart.records import write_table
    from ..studies.chart.workers import machine

    picture, scenes = words[0], words[1:]
    known = PICTURES[picture].scenes
    for name in scenes:
        if name not in known:
            raise InputError(f"no scene {name!r} of {picture}; known are {'; '.join(known)}")
    check_pictures(out.parent)
    records = _measured(picture, scenes or list(known), peers, budget)
    write_table(records, out.with_suffix(".csv"), PileRecord)
    figure = draw_piles(records, f"One thread; {machine()}.")
    for suffix in (".png", ".svg"):
        figure.savefig(out.with_suffix(suffix), dpi=110)
    print(pile_table(records))
    for line, setting in dict.fromkeys((r.line.partition(", h =")[0], r.setting) for r in records):
        print(f"{line}: {setting}")
    print(f"picture      {out.with_suffix('.png')}, {out.with_suffix('.svg')}")
    print(f"table        {out.with_suffix('.csv')}")


def _measured(picture: str, scenes: Sequence[str], peers: bool, budget: float) -> list[PileRecord]:
    from tqdm import tqdm

    from ..studies.chart.pile_runs import sweep_ours, sweep_peer_piles
    from ..studies.chart.workers import worker
    from ..studies.engines import PEERS

    running = [peer for peer in PEERS if peer.piles and peer.installed] if peers else []
    if peers:
        for peer in PEERS:
            if peer.piles and not peer.installed:
                print(f"{peer.name} is not installed: {peer.install}")
    records: list[PileRecord] = []
    with tqdm(total=len(scenes) * (1 + len(running)), unit="sweep", disable=None) as bar:
        for scene in scenes:
            bar.set_description(f"{scene}, mbvi")
            with worker() as call:
                records += call(sweep_ours, picture, scene, _STEPS, _DEPTHS, budget)
            bar.update()
            for peer in running:
                bar.set_description(f"{scene}, {peer.name}")
                with worker(silent=True) as call:
                    try:
                        records += call(sweep_peer_piles, peer.piles, picture, scene, _PEER_STEPS, budget)
                    except (ImportError, RuntimeError, ValueError, MbviError) as error:
                        # an error of another engine costs its own points only
                        bar.write(f"{peer.name} failed on {scene}: {error}")
                bar.update()
    return records
