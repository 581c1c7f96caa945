"""Sweeps of stress scenes over schemes and steps: one cell for each, with number, verdict and time."""

from __future__ import annotations

import signal
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import FrameType
from typing import Any

from mbvi.errors import MbviError, UnsuitableError
from mbvi.projection import Projector
from mbvi.results.trajectory import Trajectory
from mbvi.run.simulate import simulate
from mbvi.schemes import Centered, EventDriven, MoreauJean, Paoli, SchatzmanPaoli, StewartTrinkle

from ..engines.bodies import NoModelError
from .scene import StressScene

# fixed-step schemes by their names in tables; None leaves the choice to `simulate`
SCHEMES: Mapping[str, Callable[[], Any]] = {
    "default": lambda: None,
    "Paoli": Paoli,
    "MoreauJean": lambda: MoreauJean(0.5),
    "Centered": Centered,
    "Centered, positions projected": lambda: Centered(project_positions=True),
    "SchatzmanPaoli": SchatzmanPaoli,
    "StewartTrinkle": StewartTrinkle,
}
# step given to scenes that depend on it, for EventDriven [s]
_DEFAULT_STEP = 1e-3


@dataclass(frozen=True)
class Cell:
    """One scene, one scheme, one step.

    Attributes
    ----------
    scene, scheme : str
        Names of the scene and of the scheme or engine.
    step : float
        Time step [s], or the tolerance of `EventDriven`.
    value : float
        Number of the scene; infinite if there is none.
    verdict : str
        "held", "degraded" or "failed"; "too slow" if the run reached its time limit; "refused" if the scheme raised
        `UnsuitableError`; "not run" if another engine has no model of the scene.
    cpu : float
        CPU time [s].
    said : str
        Error message of the run, or its notes.
    setting : str
        Settings of another engine.
    """

    scene: str
    scheme: str
    step: float
    value: float
    verdict: str
    cpu: float
    said: str
    setting: str = ""

    @property
    def own(self) -> bool:
        """Whether it is a cell of mbvi, and not of another engine."""
        return self.scheme in SCHEMES or self.scheme == "EventDriven"


def sweep(
    scenes: Sequence[StressScene], steps: Sequence[float], tolerances: Sequence[float], budget: float
) -> Iterator[Cell]:
    """Yield a cell for every scene, scheme and step.

    Parameters
    ----------
    scenes : sequence of StressScene
        Scenes.
    steps : sequence of float
        Time steps of the fixed-step schemes [s].
    tolerances : sequence of float
        Tolerances of `EventDriven`.
    budget : float
        Limit of the CPU time of one run [s].
    """
    # kernels are compiled before any run is timed
    Projector()
    for scene in scenes:
        for name, make in SCHEMES.items():
            for h in steps:
                yield cell(scene, name, make(), h, budget)
        for tolerance in tolerances:
            yield cell(scene, "EventDriven", EventDriven(tolerance), tolerance, budget)


def cell(scene: StressScene, name: str, scheme: Any, step: float, budget: float) -> Cell:
    """Run one cell; an error becomes its verdict. For `EventDriven` the argument `step` is the tolerance."""

    def run() -> Trajectory:
        h = None if isinstance(scheme, EventDriven) else step
        problem = scene.make(_DEFAULT_STEP if h is None else h)
        return simulate(problem, scheme, duration=scene.duration, step=h, progress=False)

    return judged(scene, name, step, budget, run)


def judged(scene: StressScene, name: str, step: float, budget: float, run: Callable[[], Trajectory]) -> Cell:
    """Return the cell of a run, which is stopped at a limit of CPU time."""
    start = time.process_time()
    value, verdict, said = float("inf"), "failed", ""
    try:
        with _limited(budget), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = run()
            value = scene.measure(found)
        verdict, said = scene.verdict(value), "; ".join(found.notes)
    except TimeoutError:
        verdict, said = "too slow", f"more than {budget:g} s of CPU time"
    except NoModelError as error:
        verdict, said = "not run", str(error)
    except UnsuitableError as error:
        verdict, said = "refused", str(error)
    except MbviError as error:
        said = f"{type(error).__name__}: {error}"
    return Cell(scene.name, name, step, value, verdict, time.process_time() - start, said)


class _limited:
    """Context that raises `TimeoutError` in the main thread after a number of seconds of CPU time."""

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds

    def __enter__(self) -> None:
        self._before = signal.signal(signal.SIGPROF, self._ring)
        signal.setitimer(signal.ITIMER_PROF, self._seconds)

    def __exit__(self, *error: object) -> None:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, self._before)

    @staticmethod
    def _ring(number: int, frame: FrameType | None) -> None:
        raise TimeoutError
