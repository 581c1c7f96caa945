"""`mbvi chart friction`: errors of scenes with friction against CPU time, as a picture and a table."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..errors import InputError, MbviError
from ..studies.pictures import check_pictures

if TYPE_CHECKING:
    from ..studies.chart.friction_runs import FrictionRecord

# the name of the picture on the command line
FRICTION = "friction"
# time steps [s]
_STEPS = (4e-3, 2e-3, 1e-3, 5e-4)


def chart_friction(words: Sequence[str], peers: bool, budget: float, out: Path) -> None:
    """Measure and draw scenes with friction.

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
    from ..studies.chart.friction import ROUGH
    from ..studies.chart.friction_picture import draw_friction, friction_table
    from ..studies.chart.friction_runs import FrictionRecord
    from ..studies.chart.records import write_table
    from ..studies.chart.workers import machine

    scenes = words[1:]
    for name in scenes:
        if name not in ROUGH:
            raise InputError(f"no scene {name!r} of {FRICTION}; known are {'; '.join(ROUGH)}")
    check_pictures(out.parent)
    records = _measured(scenes or list(ROUGH), peers, budget)
    write_table(records, out.with_suffix(".csv"), FrictionRecord)
    figure = draw_friction(records, f"One thread; {machine()}.")
    for suffix in (".png", ".svg"):
        figure.savefig(out.with_suffix(suffix), dpi=110)
    print(friction_table(records))
    for title, source in dict.fromkeys((r.title, r.source) for r in records):
        print(f"{title}: errors against {source}")
    for line, setting in dict.fromkeys((r.line, r.setting) for r in records):
        print(f"{line}: {setting}")
    print(f"picture      {out.with_suffix('.png')}, {out.with_suffix('.svg')}")
    print(f"table        {out.with_suffix('.csv')}")


def _measured(scenes: Sequence[str], peers: bool, budget: float) -> list[FrictionRecord]:
    from tqdm import tqdm

    from ..studies.chart.friction_runs import sweep_other, sweep_ours
    from ..studies.chart.workers import worker
    from ..studies.engines import PEERS

    others = [peer for peer in PEERS if peer.friction] if peers else []
    for peer in others:
        if not peer.installed:
            print(f"{peer.name} is not installed: {peer.install}")
    running = [peer for peer in others if peer.installed]
    records: list[FrictionRecord] = []
    with tqdm(total=len(scenes) * (1 + len(running)), unit="sweep", disable=None) as bar:
        for scene in scenes:
            bar.set_description(f"{scene}, mbvi")
            with worker() as call:
                records += call(sweep_ours, scene, _STEPS, budget)
            bar.update()
            for peer in running:
                bar.set_description(f"{scene}, {peer.name}")
                with worker(silent=True) as call:
                    try:
                        records += call(sweep_other, peer.friction, scene, _STEPS, budget)
                    except (ImportError, RuntimeError, ValueError, MbviError) as error:
                        # an error of another engine costs its own points only
                        bar.write(f"{peer.name} failed on {scene}: {error}")
                bar.update()
    return records
