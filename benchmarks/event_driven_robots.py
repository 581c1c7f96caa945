"""What EventDriven needs for published robots that fall on their hulls: CPU time, steps, impacts, fallback steps.

    python benchmarks/event_driven_robots.py [-l SECONDS] [-t TOLERANCE] [NAME ...]

Each robot falls 2 cm and lies for the rest of one second, at e = 0 and e = 0.5. A run ends after 40 s of CPU time, or
as many as -l says; the table then says how far it came. Kernels and robots are loaded before that.
"""

from __future__ import annotations

import argparse
import os
import time

os.environ.setdefault("OMP_NUM_THREADS", "1")

import mbvi
from mbvi.errors import MbviError
from mbvi.projection import Projector
from mbvi.schemes.event_driven.impact_event import ImpactEvent
from mbvi_studies.published_robots import PUBLISHED, published_robot

HEIGHT, DURATION = 0.02, 1.0


def line(name: str, restitution: float, tolerance: float, limit: float) -> str:
    """Run one robot and return its line of the table."""
    problem = published_robot(name, HEIGHT, restitution)
    start = time.process_time()
    integrator = mbvi.EventDriven(tolerance).integrator(problem, Projector())
    steps = impacts = 0
    end = ""
    try:
        for each in integrator.run(DURATION):
            impacts, steps = impacts + isinstance(each, ImpactEvent), steps + (not isinstance(each, ImpactEvent))
            if time.process_time() - start > limit:
                break
    except MbviError as error:
        end = f" {type(error).__name__}: {error}"
    cpu = time.process_time() - start
    return (
        f"{PUBLISHED[name].title:14} {restitution:4.1f} {integrator.t:7.3f} {cpu:7.1f} {steps:6} {impacts:8}"
        f" {integrator.fallbacks:8}{end}"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("names", nargs="*", default=list(PUBLISHED))
    parser.add_argument("-l", "--limit", type=float, default=40.0)
    parser.add_argument("-t", "--tolerance", type=float, default=1e-6)
    given = parser.parse_args()
    # loads the kernels
    line("panda", 0.0, 1e-3, 1.0)
    print(f"{'robot':14} {'e':>4} {'t [s]':>7} {'CPU [s]':>7} {'steps':>6} {'impacts':>8} {'fallback':>8}")
    for name in given.names:
        for restitution in (0.0, 0.5):
            print(line(name, restitution, given.tolerance, given.limit), flush=True)


if __name__ == "__main__":
    main()
