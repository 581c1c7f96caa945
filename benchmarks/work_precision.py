"""Error reached against time taken, of error control and of time-stepping, on problems with exact solutions.

Prints a table in Markdown: for each problem the time a run takes until the largest error of q is 1e-4, 1e-6 and 1e-8.
Time-stepping is measured at h = 1e-3, 5e-4 and 2.5e-4 s; beyond what these reach its cost is carried on at the order
one that it has, which is marked by a tilde.
"""

from __future__ import annotations

from time import perf_counter

import numpy as np

import mbvi
from mbvi import reference
from mbvi.work_precision import errors

TARGETS = (1e-4, 1e-6, 1e-8)
STEPS = (1.03e-3, 4.9e-4, 2.6e-4)
REPEATS = 5
TIMES = 301


def taken(case: reference.Reference, scheme: object, **more: float) -> tuple[float, mbvi.Trajectory]:
    """Return the median time of a run [ms] and the run."""
    times = []
    for _ in range(REPEATS):
        begin = perf_counter()
        run = mbvi.simulate(case.problem, scheme, duration=case.duration, **more)
        times.append(1e3 * (perf_counter() - begin))
    return float(np.median(times)), run


def controlled(case: reference.Reference, target: float) -> str:
    """Return the time of error control at this tolerance, and the error it really has."""
    time, run = taken(case, mbvi.EventDriven(target))
    difference = case.problem.system.difference
    instants = np.linspace(0, case.duration, TIMES)
    error = max(float(np.abs(difference(case.at(t)[0], run.at(t)[0])).max()) for t in instants)
    return f"{time:.1f} ({error:.0e})"


def stepped(case: reference.Reference, scheme: object) -> float:
    """Return the time a run takes to the error 1e-4 [ms], carried on at order one: the median over the steps."""
    found = []
    for h in STEPS:
        time, run = taken(case, scheme, step=h)
        found.append(time * errors(run, case).q / TARGETS[0])
    return float(np.median(found))


def main() -> None:
    """Print the table."""
    head = " | ".join(f"EventDriven({target:g}) [ms] (error)" for target in TARGETS)
    print(f"| problem | e | {head} | Paoli to 1e-4 [ms] | ratio |")
    print("|---|---|" + "---|" * (len(TARGETS) + 2))
    for e in (0.0, 0.5, 1.0):
        for case in reference.references(e):
            cells = [controlled(case, target) for target in TARGETS]
            slow = stepped(case, mbvi.Paoli())
            ratio = slow / float(cells[0].split()[0])
            print(f"| {case.name} | {e:g} | {' | '.join(cells)} | ~{slow:.3g} | {ratio:.2g} |", flush=True)


if __name__ == "__main__":
    main()
