"""Measure the first use of mbvi on a machine: CPU time of a process with an empty cache of kernels.

    python benchmarks/first_use.py              # of this clone, which compiles
    python benchmarks/first_use.py mbvi.whl     # of a wheel, which carries machine code

Imports, the build of the problem, the run and the check of Pinocchio's addresses are included; medians of some repeats.
"""

import os
import resource
import statistics
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

BALL = """
import mbvi
scene = mbvi.Scene(restitution=0.5)
scene.add_halfspace((0, 0, 1))
scene.add_sphere(0.1, 1.0, position=(0, 0, 1.1))
mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=0.3, progress=False)
"""
QUADRUPED = """
import mbvi
scene = mbvi.Scene(restitution=0.5)
scene.add_halfspace((0, 0, 1))
scene.add_urdf(mbvi.robot("quadruped"), position=(0, 0, 0.5))
mbvi.simulate(scene.build(), step=1e-3, duration=0.3, progress=False)
"""
GO2 = """
import mbvi
from mbvi_studies.published_robots import published_robot
mbvi.simulate(published_robot("go2", 0.02), duration=0.3, progress=False)
"""
CASES = {"nothing: import pinocchio": "import pinocchio", "ball": BALL, "quadruped": QUADRUPED, "Go2": GO2}


def seconds(code: str, path: str, cache: str) -> float:
    """Return the CPU time of a process and its children [s]."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    environment = {**os.environ, "PYTHONPATH": path, "NUMBA_CACHE_DIR": cache, "OMP_NUM_THREADS": "1"}
    subprocess.run([sys.executable, "-P", "-W", "ignore", "-c", code], env=environment, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def main() -> None:
    """Print a line for each case: first use, and use after it."""
    with tempfile.TemporaryDirectory() as folder:
        path, repeats = str(Path(__file__).parents[1]), 1
        if len(sys.argv) > 1:
            path, repeats = folder + "/site", 7
            with zipfile.ZipFile(sys.argv[1]) as archive:
                archive.extractall(path)
            # pip compiles source to bytecode when it installs
            seconds(GO2, path, folder + "/warm")
        for name, code in CASES.items():
            caches = [f"{folder}/{name}-{k}" for k in range(repeats)]
            first = statistics.median(seconds(code, path, cache) for cache in caches)
            later = statistics.median(seconds(code, path, cache) for cache in caches)
            print(f"{name}: {first:.2f} s at first, {later:.2f} s later", flush=True)


if __name__ == "__main__":
    main()
