"""What `mbvi.sweep` costs beside its runs: CPU time, efficiency on two cores, and the scheduler of a thousand workers.

`python benchmarks/sweep.py 1000` makes 1000 runs of a hopper for each number. Close other programs first.
"""

from __future__ import annotations

import os
import resource
import sys
import tempfile
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np

import mbvi
from mbvi.sweeps.batch import Done
from mbvi.sweeps.cluster import local_client
from mbvi.sweeps.points import points_of
from mbvi.sweeps.scheduling import BatchSizes
from mbvi.sweeps.study import Study, StudyFolder
from mbvi.sweeps.sweep import run_study

OPTIONS = {"scheme": mbvi.Paoli(), "step": 1e-3, "duration": 2.0}
TASKS, WORKERS, POINTS = 2000, 1000, 1_000_000


def make(height: float, rng: np.random.Generator) -> mbvi.Scene:
    """Return a hopper above a floor."""
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(mbvi.robot("hopper"), position=(0, 0, height), joints={"knee": 0.4 + 0.1 * rng.standard_normal()})
    return scene


def measure(run: mbvi.Trajectory) -> dict[str, float]:
    """Return a few numbers of a run."""
    return {"energy": run.energy()[-1], "impacts": len(run.impacts), "depth": run.penetration().max()}


@contextmanager
def timed(found: dict[str, float], name: str):
    """Note wall and CPU time of this process and those that it started and that have ended [s]."""

    def cpu() -> float:
        usage = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
        return sum(u.ru_utime + u.ru_stime for u in usage)

    wall, begin = time.perf_counter(), cpu()
    yield
    found[name], found[f"{name}, CPU"] = time.perf_counter() - wall, cpu() - begin


def swept(folder: Path, count: int, workers: int, found: dict[str, float]) -> float:
    """Sweep on a number of processes; return the CPU time of the rows [s]."""
    points = points_of({"height": np.linspace(0.7, 1.3, count)}, make)
    study, here = Study(make, measure, options=OPTIONS), StudyFolder(folder / f"{workers}_{count}")
    here.open(study, points)
    with timed(found, f"all {workers} {count}"), local_client(workers) as client:
        # kernels are loaded, so that walls of long runs can be compared
        first = StudyFolder(folder / f"first_{workers}_{count}")
        few = points_of({"height": np.linspace(0.7, 1.3, 4 * workers)}, make)
        first.open(study, few)
        run_study(first, study, few, client)
        with timed(found, f"runs {workers} {count}"):
            table = run_study(here, study, points, client)
    assert (table["status"] == "ok").all()
    return float(table["cpu"].sum())


def main(count: int = 400) -> None:
    """Print the numbers."""
    found: dict[str, float] = {}
    print(f"load of the machine before: {os.getloadavg()[0]:.1f} processes on {os.cpu_count()} cores")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        swept(folder, 1, 2, found)
        rows = {workers: swept(folder, count, workers, found) for workers in (1, 2)}
    own, begin = found[f"all 2 {count}, CPU"] - found["all 2 1, CPU"], found["all 2 1, CPU"]
    each = rows[2] / count
    beside, total = own - rows[2], begin + 1e4 * own / count
    print(f"a run              {1e3 * each:.1f} ms of CPU time")
    print(f"start and end      {begin:.1f} s of CPU time for two workers: imports, kernels, a few runs")
    print(f"beside the runs    {1e3 * beside / count:.2f} ms of CPU time for each, {100 * beside / rows[2]:.1f} %")
    print(f"1e4 runs           {100 * (total / (1e4 * each) - 1):.1f} % of CPU time beside them, with the start")
    walls = [found[f"runs {workers} {count}"] for workers in (1, 2)]
    print(f"load of the machine after: {os.getloadavg()[0]:.1f} processes")
    print(f"two cores          {walls[0]:.1f} s become {walls[1]:.1f} s: efficiency {walls[0] / walls[1] / 2:.2f}")
    with local_client(2) as client:
        client.submit(int, pure=False).result()
        begin = time.process_time()
        client.gather([client.submit(int, pure=False) for _ in range(TASKS)])
        task = (time.process_time() - begin) / TASKS
    sizes = BatchSizes()
    sizes.add(Done(100, 0, 100 * each, 100))
    batch = sizes.next(POINTS, WORKERS)
    print(f"a task             {1e3 * task:.2f} ms of CPU time of client and scheduler: {1 / task:.0f} tasks a second")
    rate, seconds = WORKERS / (batch * each), batch * each
    share = 100 * rate * task
    print(f"{WORKERS} workers       {batch} runs a batch, {seconds:.1f} s: {rate:.0f} tasks a second, {share:.0f} %")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
