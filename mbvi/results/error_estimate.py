"""The estimated error of a run: its difference from a second run that is more accurate, up to the first fork."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from ..errors import InputError, UnsuitableError
from ..schemes import Adaptive, OwnStepsScheme
from ..system.parts import velocity_units
from ..system.settings import Settings
from .diagnosis.diagnose import given_or_computed
from .run_data import Array, RunData

# The second run takes _FINER steps in the time of _COMMON steps of the first. Were its step a tenth, one impact in ten
# would end the same step in both runs, and the difference would be zero however large the error is.
_FINER, _COMMON = 65, 7
# its tolerance over that of the first: at a tenth both often take the same steps; steps of order 2 are dearer
_STRICTER, _STRICTER_ADAPTIVE = 1e-3, 1e-2
# its longest step over that of the first, because slow motion takes the longest steps at any tolerance
_SHORTER = 0.5
# part of a step by which times of states differ by rounding
_SAME = 1e-3

Run = TypeVar("Run", bound=RunData)


@dataclass(frozen=True)
class ErrorEstimate:
    """How far the configurations of a run are from the exact solution, estimated by a second run.

    Attributes
    ----------
    t : ndarray, shape (m,)
        Times at which the runs are compared [s].
    error : ndarray, shape (m,)
        Largest difference of a coordinate from that of the second run, in lengths of the scene (`unit`) and rad; nan
        after the fork.
    unit : float
        Length of the scene, `Problem.length` [m].
    fork : float
        Time after which the problem has several solutions, and no error exists [s]; inf if none was found.
    second : str
        Scheme and step of the second run.
    caveat : str
        What is not known about forks; empty if nothing is left open.
    """

    t: Array
    error: Array
    unit: float
    fork: float
    second: str
    caveat: str = ""

    @property
    def largest(self) -> float:
        """The largest error up to the fork, in the units of `error`."""
        return float(np.nanmax(self.error))

    def __repr__(self) -> str:
        return f"ErrorEstimate(largest={self.largest:.1e}, fork={self.fork:g}, times={len(self.t)})"

    def __str__(self) -> str:
        until = f" until t = {self.fork:.6g} s" if np.isfinite(self.fork) else ""
        lines = [
            f"The error of configurations is about {self.largest:.1e}{until}, in units of {self.unit:.3g} m and rad: "
            f"the largest difference from {self.second}."
        ]
        if until:
            lines.append(f"After t = {self.fork:.6g} s the problem has several solutions, and no error exists.")
        return "\n".join([*lines, self.caveat] if self.caveat else lines)


def estimate_error(run: RunData) -> ErrorEstimate:
    """Return the estimated error of a run; see `Trajectory.error_estimate`."""
    with run.record.as_set():
        return _estimated(run)


def _estimated(run: RunData) -> ErrorEstimate:
    problem, again, scheme = run.problem, run.record.again, run.record.scheme
    if problem is None or scheme is None or run.lacks_functions or (again is None and run.record.switches):
        raise InputError(
            "this run lacks its problem, or functions that acted or switched: give them to mbvi.load, or simulate again"
        )
    if again is None or not run.complete:
        raise InputError("only a complete run of simulate has an error estimate")
    duration = float(run.t[-1] - run.t[0])
    if isinstance(scheme, OwnStepsScheme):
        compared, finer = np.arange(len(run.t)), _stricter(scheme)
        other, second = again(problem, finer, duration=duration), repr(finer)
        if isinstance(finer, Adaptive):
            second += f" with steps of at most {finer.longest:g} s"
    else:
        step, every, compared = run.step * _COMMON / _FINER, *_common(run)
        other = again(problem, scheme, duration=duration, step=step, every=_FINER * every)
        second = f"{scheme!r} at h = {step:.3g} s"
    t, units = run.t[compared], velocity_units(problem.system, problem.length)
    exact = other.at(np.clip(t, other.t[0], other.t[-1]))[0]
    error = np.array([
        np.abs(problem.system.difference(a, b) / units).max(initial=0.0)
        for a, b in zip(exact, run.q[compared], strict=True)
    ])  # fmt: skip
    fork, caveat = _fork(run)
    error[t > fork] = np.nan
    return ErrorEstimate(t, error, problem.length, fork, second, caveat)


def _common(run: RunData) -> tuple[int, Array]:
    """Return how many steps lie between recorded states, and the numbers of the states that are compared."""
    every, done = recorded_every(run), _steps_done(run)
    return every, np.append(np.flatnonzero(done % (_COMMON * every) == 0), len(done))


def recorded_every(run: RunData) -> int:
    """Return how many fixed steps lie between recorded states.

    Where connections were switched, states between those are recorded too.
    """
    done, total = _steps_done(run), float((run.t[-1] - run.t[0]) / run.step)
    for every in np.unique(done[done > 0]).tolist():
        if np.isin(np.arange(every, total - _SAME, every), done).all():
            return int(every)
    return max(1, round(total))


def _steps_done(run: RunData) -> Array:
    """Return the number of fixed steps before each state but the last, shape (n,)."""
    done: Array = np.rint((run.t[:-1] - run.t[0]) / run.step).astype(np.int64)
    return done


def repeatable(run: Run, again: Callable[..., RunData], settings: Settings | None = None) -> Run:
    """Return a run that knows how it is simulated again, with the settings given or else those of now."""
    if settings is None and run.problem is not None:
        settings = Settings(run.problem.system)
    return replace(run, record=replace(run.record, again=again, settings=settings))


def _stricter(scheme: OwnStepsScheme) -> OwnStepsScheme:
    """Return the scheme with a stricter tolerance."""
    tolerance, strictest = scheme.tolerance, scheme.strictest
    stricter = max((_STRICTER_ADAPTIVE if isinstance(scheme, Adaptive) else _STRICTER) * tolerance, strictest)
    if stricter > 0.11 * tolerance:
        raise UnsuitableError(
            f"no second run of {scheme.name} is ten times more accurate than {scheme!r}: take a tolerance of "
            f"{10 * strictest:.0e} or above"
        )
    finer = type(scheme)(stricter)
    if isinstance(finer, Adaptive):
        finer.longest = _SHORTER * finer.longest
    return finer


def _fork(run: RunData) -> tuple[float, str]:
    """Return the first time after which the problem has several solutions, and what is not known about forks."""
    diagnosis, why = given_or_computed(run, None)
    if diagnosis is None:
        return np.inf, f"Whether impacts have several outcomes was not looked for: {why}."
    times = [*diagnosis.dead_centres, *(jump.time for jump in diagnosis.jumps if jump.second_solution)]
    times += [] if np.isnan(diagnosis.horizon) else [diagnosis.horizon]
    return min(times, default=np.inf), diagnosis.verdict() if np.isnan(diagnosis.horizon) else ""
