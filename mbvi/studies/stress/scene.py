"""What a stress scene is, and the numbers that scenes are judged by."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...problem import Problem
from ...reference.solution import Reference
from ...results.trajectory import Trajectory

# instants at which a run is compared with an exact solution
_TIMES = 501


@dataclass(frozen=True)
class StressScene:
    """A problem, and the number by which a run of it is judged.

    Attributes
    ----------
    name : str
        Short.
    make : callable
        make(h) -> Problem; most scenes do not depend on the step.
    duration : float
        How long [s].
    measure : callable
        measure(run) -> the number, 0 at best.
    number : str
        What it is, with its unit.
    held, failed : float
        Up to and including the first the scene is held, beyond the second it has failed; in between it is degraded.
    long : bool
        Whether it is left out unless asked for.
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
        """Return "held", "degraded" or "failed"; a NaN has failed."""
        return "held" if value <= self.held else "degraded" if value <= self.failed else "failed"


def energy_drift(run: Trajectory) -> float:
    """Return the largest change of the energy relative to the first."""
    energy = run.energy()
    return float(np.abs(energy - energy[0]).max() / abs(energy[0]))


def energy_gain(run: Trajectory) -> float:
    """Return the most that the energy rises above any earlier one, relative to the first."""
    energy = run.energy()
    return float((energy - np.minimum.accumulate(energy)).max() / abs(energy[0]))


def penetration(length: float) -> Callable[[Trajectory], float]:
    """Return the deepest penetration in units of a length [m]."""
    return lambda run: float(run.penetration().max() / length)


def gain_or_penetration(length: float) -> Callable[[Trajectory], float]:
    """Return the gain of energy, or the deepest penetration in units of a length [m], whichever is worse."""
    depth = penetration(length)
    return lambda run: max(energy_gain(run), depth(run))


def moved(run: Trajectory) -> float:
    """Return how far the configuration ever is from the first [m, rad]."""
    assert run.problem is not None
    difference = run.problem.system.difference
    return max(float(np.abs(difference(run.q[0], q)).max()) for q in run.q)


def compared(name: str, exact: Reference, held: float) -> StressScene:
    """Return a scene that has an exact solution, judged by the largest error of its configuration [m, rad]."""

    def measure(run: Trajectory) -> float:
        difference = exact.problem.system.difference
        times = np.linspace(0.0, min(exact.duration, run.t[-1]), _TIMES).tolist()
        return max(float(np.abs(difference(exact.at(t)[0], run.at(t)[0])).max()) for t in times)

    return StressScene(name, lambda h: exact.problem, exact.duration, measure, "error of q [m, rad]", held, 10 * held)
