"""True errors of Adaptive on problems with exact solutions, with friction and without, at four tolerances.

Every problem of `mbvi.reference` at e = 0, 0.5 and 1 and with friction, each from three starts on its exact solution.
Errors are those of the recorded states, in tolerances: of q in lengths of the scene and radians; of v relative to the
largest velocity where that is above 1, at times farther than ten tolerances from where it jumps.

    python benchmarks/adaptive_errors.py
"""

from __future__ import annotations

from time import process_time

import numpy as np

import mbvi
from mbvi.reference import ROUGH, Reference, references
from mbvi.system.parts import velocity_units

TOLERANCES = (1e-2, 1e-3, 1e-4, 1e-5)
# parts of the duration after which runs start
STARTS = (0.0, 0.137, 0.291)


def errors(case: Reference, start: float, tolerance: float) -> tuple[float, float, int, float]:
    """Return the errors of q and v in tolerances, the number of steps taken twice, and the CPU time [s]."""
    t0 = case.problem.t0 + start * case.duration
    problem = case.started(t0) if start else case.problem
    begin = process_time()
    run = mbvi.simulate(problem, mbvi.Adaptive(tolerance), duration=(1.0 - start) * case.duration, progress=False)
    cpu = process_time() - begin
    units, speed, of_q, of_v = velocity_units(problem.system, problem.length), 1.0, 0.0, 0.0
    end = case.problem.t0 + case.duration
    for t, q, v in zip(np.minimum(run.t, end).tolist(), run.q, run.v, strict=True):
        exact, rate = case.at(t)
        of_q = max(of_q, float(np.abs(problem.system.difference(exact, q) / units).max()))
        speed = max(speed, float(np.abs(rate / units).max()))
        if np.abs(case.breakpoints - t).min() > 10.0 * tolerance:
            of_v = max(of_v, float(np.abs((v - rate) / units).max()) / speed)
    (note,) = [one for one in run.notes if "were accepted and" in one]
    accepted, rejected = [int(word) for word in note.split() if word.isdigit()][:2]
    return of_q / tolerance, of_v / tolerance, accepted + rejected, cpu


def main() -> None:
    """Print the table."""
    cases = [case for e in (0.0, 0.5, 1.0) for case in references(e)] + [make() for make in ROUGH.values()]
    print(
        "| tolerance | runs | error of q: median | 95 % | worst | of v: 95 % | worst | steps: median | most | CPU [s] |"
    )
    print("|" + "---|" * 10)
    for tolerance in TOLERANCES:
        found = np.array([errors(case, start, tolerance) for case in cases for start in STARTS])
        q, v, steps, cpu = found.T
        errs = [np.median(q), np.quantile(q, 0.95), q.max(), np.quantile(v, 0.95), v.max()]
        words = [f"{x:.2g}" for x in errs] + [f"{np.median(steps):.0f}", f"{steps.max():.0f}", f"{np.median(cpu):.2g}"]
        print("| " + " | ".join([f"{tolerance:g}", str(len(found)), *words]) + " |", flush=True)


if __name__ == "__main__":
    main()
