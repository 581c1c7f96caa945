"""Error against CPU time of EventDriven and of all fixed-step schemes, on problems with exact solutions.

Prints a table in Markdown: for each problem the time of error control at the tolerances 1e-4, 1e-6 and 1e-8 with the
error it really has, the time of each time-stepping scheme until the largest error of q is 1e-4, and how many times the
best of these takes longer. Where no step of the list is fine enough the cost is carried on at order one from the three
finest, which is marked by a tilde.
"""

from __future__ import annotations

import argparse
from time import process_time

import numpy as np

import mbvi
from mbvi import reference
from mbvi.compiled import compile_all
from mbvi_studies.chart.errors import errors

TARGETS = (1e-4, 1e-6, 1e-8)
STEPS = (1.63e-2, 4.1e-3, 1.03e-3, 4.9e-4)
STEPPING = (mbvi.Paoli(), mbvi.MoreauJean(), mbvi.Centered(), mbvi.SchatzmanPaoli())
# number of runs whose median counts, if the first is shorter than this time [ms]
REPEATS, LONG = 3, 100.0
TIMES = 301


def taken(case: reference.Reference, scheme: object, **more: float) -> tuple[float, mbvi.Trajectory]:
    """Return the median CPU time of some runs [ms], and the last of them."""
    times = []
    for _ in range(REPEATS):
        begin = process_time()
        run = mbvi.simulate(case.problem, scheme, duration=case.duration, **more)
        times.append(1e3 * (process_time() - begin))
        if times[0] > LONG:
            break
    return float(np.median(times)), run


def controlled(case: reference.Reference, target: float) -> tuple[float, float]:
    """Return the CPU time of EventDriven at a tolerance [ms], and the true error."""
    time, run = taken(case, mbvi.EventDriven(target))
    difference = case.problem.system.difference
    instants = np.linspace(0, case.duration, TIMES)
    return time, max(float(np.abs(difference(case.at(t)[0], run.at(t)[0])).max()) for t in instants)


def stepped(case: reference.Reference, scheme: object) -> tuple[float, bool]:
    """Return the CPU time to the error 1e-4 [ms], and whether it was measured rather than extrapolated."""
    found = []
    for h in STEPS:
        time, run = taken(case, scheme, step=h)
        found.append((time, errors(run, case).q / TARGETS[0]))
    # coarsest step from which on all errors are below the target
    good = len(STEPS)
    while good and found[good - 1][1] <= 1.0:
        good -= 1
    if good < len(STEPS):
        return found[good][0], True
    return float(np.median([time * error for time, error in found[-3:]])), False


def main() -> None:
    """Print the table, and the least and the median of its last column."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--restitution", type=float, nargs="*", default=[0.0, 0.5, 1.0], metavar="E")
    wanted = parser.parse_args().restitution
    compile_all()
    head = " | ".join(f"EventDriven({target:g}) [ms] (error)" for target in TARGETS)
    names = " | ".join(f"{type(scheme).__name__} [ms]" for scheme in STEPPING)
    print(f"| problem | e | {head} | {names} | best / EventDriven({TARGETS[0]:g}) |")
    print("|---|---|" + "---|" * (len(TARGETS) + len(STEPPING) + 1))
    ratios = []
    for e in wanted:
        for case in reference.references(e):
            ours = [controlled(case, target) for target in TARGETS]
            theirs = [stepped(case, scheme) for scheme in STEPPING]
            ratios.append(min(time for time, _ in theirs) / ours[0][0])
            cells = [f"{time:.1f} ({error:.0e})" for time, error in ours]
            cells += [f"{'' if measured else '~'}{time:.3g}" for time, measured in theirs]
            print(f"| {case.name} | {e:g} | {' | '.join(cells)} | {ratios[-1]:.2g} |", flush=True)
    at_least = sum(ratio >= 10.0 for ratio in ratios)
    print(f"\nleast {min(ratios):.2g}, median {np.median(ratios):.2g}; {at_least} of {len(ratios)} are at least 10")


if __name__ == "__main__":
    main()
