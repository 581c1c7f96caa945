"""Scenes over schemes and steps: one cell each, with its number, its verdict and its time."""

from __future__ import annotations

import signal
import time
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import FrameType
from typing import Any

from ...errors import MbviError, UnsuitableError
from ...projection import Projector
from ...results.trajectory import Trajectory
from ...run.simulate import simulate
from ...schemes import Centered, EventDriven, MoreauJean, Paoli, SchatzmanPaoli, StewartTrinkle
from ..engines.bodies import NoModelError
from .scene import StressScene

# time-stepping schemes by the names they have in tables; each cell makes its own, or leaves the choice to `simulate`
SCHEMES: Mapping[str, Callable[[], Any]] = {
    "default": lambda: None,
    "Paoli": Paoli,
    "MoreauJean": lambda: MoreauJean(0.5),
    "Centered": Centered,
    "Centered, positions projected": lambda: Centered(project_positions=True),
    "SchatzmanPaoli": SchatzmanPaoli,
    "StewartTrinkle": StewartTrinkle,
}
# what a scene that depends on the step gets where there is none [s]
_USUAL = 1e-3


@dataclass(frozen=True)
class Cell:
    """One scene, one scheme, one step.

    Attributes
    ----------
    scene, scheme : str
        Their names; an engine's instead of a scheme's.
    step : float
        Time step [s], or the tolerance of error control.
    value : float
        The scene's number; infinite where there is none.
    verdict : str
        "held", "degraded" or "failed"; "too slow" where the time given was not enough, "refused" where the scheme says
        that the scene is not for it, "not run" where another engine cannot be given it.
    cpu : float
        CPU time [s].
    said : str
        What the run said of itself: its error, or its notes.
    setting : str
        How another engine was set.
    """

    scene: str
    scheme: str
    step: float
    value: float
    verdict: str
    cpu: float
    said: str
    setting: str = ""


def sweep(
    scenes: Sequence[StressScene], steps: Sequence[float], tolerances: Sequence[float], budget: float
) -> Iterator[Cell]:
    """Yield a cell for every scene, scheme and step.

    Parameters
    ----------
    scenes : sequence of StressScene
        Which.
    steps : sequence of float
        Time steps of the time-stepping schemes [s].
    tolerances : sequence of float
        Tolerances of `EventDriven`.
    budget : float
        CPU time that one run may take [s].
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
    """Run one cell; what goes wrong in it is its result. `step` is the tolerance of a scheme that has one."""

    def run() -> Trajectory:
        h = None if isinstance(scheme, EventDriven) else step
        problem = scene.make(_USUAL if h is None else h)
        return simulate(problem, scheme, duration=scene.duration, step=h, progress=False)

    return judged(scene, name, step, budget, run)


def judged(scene: StressScene, name: str, step: float, budget: float, run: Callable[[], Trajectory]) -> Cell:
    """Return the cell of what a function runs, within a time."""
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
    """Raises `TimeoutError` in the main thread after so many seconds of CPU time, however busy the machine is."""

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
