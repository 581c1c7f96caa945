"""Stress scenes, and the numbers by which their runs are judged."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mbvi.problem import Problem
from mbvi.reference.solution import Reference
from mbvi.results.trajectory import Trajectory

# number of times at which a run is compared with an exact solution
_TIMES = 501


@dataclass(frozen=True)
class StressScene:
    """A problem, and the number by which a run of it is judged.

    Attributes
    ----------
    name : str
        Short name.
    make : callable
        make(h) -> Problem; most scenes ignore the step h.
    duration : float
        Simulated time [s].
    measure : callable
        measure(run) -> the number; 0 is perfect.
    number : str
        Meaning of the number, with its unit.
    held, failed : float
        Bounds: the scene is held if the number is at most `held`, failed if it is above `failed`, degraded between.
    long : bool
        Whether the scene runs with `--long` only.
    """

    name: str
    make: Callable[[float], Problem]
    duration: float
    measure: Callable[[Trajectory], float]
    number: str
    held: float
    failed: float
    long: bool = False

    def verdict(self, value: float) -> str:
        """Return "held", "degraded" or "failed"; NaN is "failed"."""
        return "held" if value <= self.held else "degraded" if value <= self.failed else "failed"


def energy_drift(run: Trajectory) -> float:
    """Return the largest change of the energy, relative to the initial energy."""
    energy = run.energy()
    return float(np.abs(energy - energy[0]).max() / abs(energy[0]))


def energy_gain(run: Trajectory) -> float:
    """Return the largest rise of the energy above an earlier value, relative to the initial energy."""
    energy = run.energy()
    return float((energy - np.minimum.accumulate(energy)).max() / abs(energy[0]))


def penetration(length: float) -> Callable[[Trajectory], float]:
    """Return the deepest penetration in units of a length [m]."""
    return lambda run: float(max(run.penetration().max(), run.limit_violation().max()) / length)


def gain_or_penetration(length: float) -> Callable[[Trajectory], float]:
    """Return the gain of energy, or the deepest penetration in units of a length [m], whichever is worse."""
    depth = penetration(length)
    return lambda run: max(energy_gain(run), depth(run))


def moved(run: Trajectory) -> float:
    """Return the largest distance from the initial configuration [m, rad]."""
    assert run.problem is not None
    difference = run.problem.system.difference
    return max(float(np.abs(difference(run.q[0], q)).max()) for q in run.q)


def compared(name: str, exact: Reference, held: float) -> StressScene:
    """Return a scene with an exact solution, judged by the largest error of the configuration [m, rad]."""

    def measure(run: Trajectory) -> float:
        difference = exact.problem.system.difference
        times = np.linspace(0.0, min(exact.duration, run.t[-1]), _TIMES).tolist()
        return max(float(np.abs(difference(exact.at(t)[0], run.at(t)[0])).max()) for t in times)

    return StressScene(name, lambda h: exact.problem, exact.duration, measure, "error of q [m, rad]", held, 10 * held)
