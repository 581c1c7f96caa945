"""Time of a step by layer: Pinocchio, compiled kernels, and the rest, which is Python and numpy."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any
from unittest import mock

import numpy as np
import pinocchio as pin

import mbvi
from mbvi.compiled import kernel as compiled

LAYERS = ("Pinocchio", "kernels", "Python")

_PINOCCHIO = (
    *("integrate", "difference", "crba", "nonLinearEffects", "rnea", "aba", "forwardKinematics"),
    *("computeJointJacobians", "computeKineticEnergy", "computePotentialEnergy"),
)


class Stopwatch:
    """Time by name, without that of the timed functions it calls.

    What the timing itself costs is measured on a function that does nothing, and taken away.
    """

    def __init__(self) -> None:
        self.clear()
        self._inside = self._outside = 0.0
        # the least time, because layers are read from the fastest run
        self._inside, self._outside = np.min([self._cost() for _ in range(25)], axis=0)
        self.clear()

    def clear(self) -> None:
        """Reset all times."""
        self._spent: dict[str, float] = defaultdict(float)
        self._calls: dict[str, int] = defaultdict(int)
        self._called: dict[str, int] = defaultdict(int)
        self._open: list[list[float]] = []

    def wrap(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return the function, timed under a name."""

        def timed(*args: Any, **kwargs: Any) -> Any:
            inner = [0.0, 0]
            self._open.append(inner)
            start = time.perf_counter()
            try:
                return function(*args, **kwargs)
            finally:
                took = time.perf_counter() - start
                self._open.pop()
                self._spent[name] += took - inner[0]
                self._calls[name] += 1
                self._called[name] += int(inner[1])
                if self._open:
                    self._open[-1][0] += took
                    self._open[-1][1] += 1

        return timed

    def own(self, name: str) -> float:
        """Return the time in the functions of a name, without timed functions that they call [s]."""
        return self._spent[name] - self._calls[name] * self._inside - self._called[name] * self._outside

    def total(self) -> float:
        """Return the time in all timed functions, including the timing [s]."""
        outside = sum(self._calls.values()) - sum(self._called.values())
        return sum(self._spent.values()) + outside * self._outside

    def _cost(self, count: int = 2000) -> tuple[float, float]:
        """Return the time that timing adds to a function and to its caller, per call [s]."""
        nothing = self.wrap("nothing", lambda: None)

        def seconds(function: Callable[[], Any]) -> float:
            start = time.perf_counter()
            for _ in range(count):
                function()
            return (time.perf_counter() - start) / count

        bare = seconds(lambda: None)
        self.clear()
        whole = seconds(nothing)
        # the call belongs to the function, and so does the time between the two readings of the clock
        inside = max(self._spent["nothing"] / count - bare, 0.0)
        return inside, max(whole - bare - inside, 0.0)


@contextmanager
def _timed(watch: Stopwatch) -> Iterator[None]:
    """Time the calls into each layer while the context lasts."""
    compiled.compile_all()
    owners = [(pin, "Pinocchio", name) for name in _PINOCCHIO]
    with ExitStack() as stack:
        for owner, layer, name in owners:
            stack.enter_context(mock.patch.object(owner, name, watch.wrap(layer, getattr(owner, name))))
        for kernel in compiled.KERNELS:
            stack.enter_context(
                mock.patch.object(type(kernel), "__call__", staticmethod(watch.wrap("kernels", kernel.compiled())))
            )
        yield


def layers(
    prepare: Callable[[], mbvi.Problem], run: Callable[[mbvi.Problem, int], float], count: int, repeats: int
) -> np.ndarray:
    """Return the time a step spends in each of `LAYERS`, shape (4,) [s].

    Parameters
    ----------
    prepare : callable
        prepare() -> problem to run; not timed.
    run : callable
        run(problem, n) -> time by the wall clock that a run of n steps takes [s].
    count : int
        Steps of the long run; what one step takes, set-up included, is taken away.
    repeats : int
        Runs of each length, of which the fastest counts: there nothing else had the processor.
    """
    watch = Stopwatch()
    best = {1: (np.inf, np.empty(0)), count: (np.inf, np.empty(0))}
    with _timed(watch):
        for _ in range(repeats):
            for steps, (fastest, _) in best.items():
                problem = prepare()
                watch.clear()
                whole = run(problem, steps)
                if whole < fastest:
                    best[steps] = whole, np.array([*map(watch.own, LAYERS[:-1]), whole - watch.total()])
    return (best[count][1] - best[1][1]) / (count - 1)
