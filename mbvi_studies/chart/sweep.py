"""Timed runs of a scheme over a range of steps or tolerances."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import median
from time import process_time
from typing import TYPE_CHECKING

import numpy as np

from mbvi.compiled import compile_all
from mbvi.errors import MbviWarning
from mbvi.problem import Problem
from mbvi.results.diagnosis.energies import energies
from mbvi.results.trajectory import Trajectory
from mbvi.run.simulate import simulate
from mbvi.schemes import Adaptive, OwnStepsScheme

from .errors import Array, errors, sampled_errors
from .records import NOT_MEASURED, Record

if TYPE_CHECKING:
    from mbvi.reference.solution import Reference
    from mbvi.schemes import Scheme

# no step is a dyadic multiple of another
STEPS = tuple((1e-2 * 10.0 ** -np.linspace(0.03, 1.58, 8)).tolist())
TOLERANCES = tuple((10.0 ** -np.arange(2.0, 11.0)).tolist())
ADAPTIVE_TOLERANCES = TOLERANCES[:4]
REPEATS = 3
_SAMPLES = 300


@dataclass(frozen=True, eq=False)
class Case:
    """A problem to be charted.

    Attributes
    ----------
    name : str
        Name.
    problem : Problem
        The problem.
    duration : float
        Simulated time [s].
    source : str
        Reference of the errors.
    solution : Reference or None
        The exact solution; None if only a conserved quantity or a bound is known.
    plotted : str
        Which error is drawn: "q", "energy" (exactly constant) or "penetration" (exactly none).
    steps : tuple of float
        Time steps of its runs [s].
    """

    name: str
    problem: Problem
    duration: float
    source: str
    solution: Reference | None = None
    plotted: str = "q"
    steps: tuple[float, ...] = STEPS

    @classmethod
    def of(cls, solution: Reference) -> Case:
        """Return the case of a problem with an exact solution."""
        return cls(solution.name, solution.problem, solution.duration, solution.source, solution)

    @property
    def restitution(self) -> float:
        """The largest e."""
        return float(self.problem.restitution.max())

    def started(self, late: float) -> Problem:
        """Return a fresh problem that starts later by a time, on the solution [s]."""
        p = self.problem
        if self.solution is None:
            return Problem(
                p.system, p.constraints.constraints, p.q0, p.v0, restitution=p.restitution, length=p.length,
                scene=p.scene,
            )  # fmt: skip
        return self.solution.started(p.t0 + late)

    def judged(self, run: Trajectory) -> tuple[float, float, float, float, float]:
        """Return the errors of a run: q, v, graph, energy, penetration; see `Record`."""
        located = run.step == 0.0
        depths = np.maximum(run.penetration(), run.limit_violation())
        depth = float(depths.max(initial=0.0)) if len(depths) else NOT_MEASURED
        off = self._energy_error(run)
        if self.solution is None:
            return NOT_MEASURED, NOT_MEASURED, NOT_MEASURED, off, depth
        if located:
            return *sampled_errors(run.at, np.array([i.time for i in run.impacts]), self.solution), off, depth
        return *errors(run, self.solution), off, depth

    def _energy_error(self, run: Trajectory) -> float:
        problem, solution = self.problem, self.solution
        if run.step == 0.0:
            times = np.linspace(run.t[0], run.t[-1], _SAMPLES + 1)
            q, v = (np.array(x) for x in zip(*(run.at(t) for t in times.tolist()), strict=True))
        else:
            # a sample of the states is enough
            consistent = run.t + (run.record.timing.jump - 0.5) * run.step
            inside = np.flatnonzero((consistent > run.t[0]) & (consistent <= run.t[-1]))[1:]
            chosen = inside[np.unique(np.linspace(0, len(inside) - 1, _SAMPLES).astype(int))]
            times, q, v = run.t[chosen], run.q[chosen], run.v[chosen]
        own = energies(problem, times, q, v, run.step, run.record.timing.jump if run.step else 0.5).sum(axis=1)
        if solution is None:
            exact = energies(problem, run.t[:1], problem.q0[None], problem.v0[None], 0.0).sum(axis=1)
        else:
            shifted = times + (run.record.timing.jump - 0.5) * run.step
            states = [solution.at(t) for t in shifted.tolist()]
            q, v = (np.array(x) for x in zip(*states, strict=True))
            exact = energies(problem, shifted, q, v, 0.0, 0.5).sum(axis=1)
        return float(np.abs(own - exact).mean())


def sweep(
    case: Case, scheme: Scheme | OwnStepsScheme, settings: Sequence[float] | None = None, repeats: int = REPEATS
) -> tuple[Record, ...]:
    """Run a scheme at several steps, or one that chooses its own steps at several tolerances, and time it.

    Parameters
    ----------
    case : Case
        The case.
    scheme : Scheme
        The scheme; its tolerance is ignored.
    settings : sequence of float, optional
        Steps [s], or tolerances; the case's, `TOLERANCES` and `ADAPTIVE_TOLERANCES` by default.
    repeats : int
        Runs for each setting; their median time and their largest error count. With a fixed step and an exact solution
        each run starts later by a part of the step, because the phase of an impact within its step scatters errors.

    Returns
    -------
    tuple of Record
        One record for each setting.
    """
    compile_all()
    if settings is None:
        own = ADAPTIVE_TOLERANCES if isinstance(scheme, Adaptive) else TOLERANCES
        settings = own if isinstance(scheme, OwnStepsScheme) else case.steps
    # one run before, so that caches are warm
    if isinstance(scheme, OwnStepsScheme):
        _timed(case.started(0.0), scheme, case.duration, None)
        return tuple(_controlled(case, type(scheme), tolerance, repeats) for tolerance in settings)
    _timed(case.started(0.0), scheme, case.duration, settings[0])
    return tuple(_stepped(case, scheme, h, repeats) for h in settings)


def _stepped(case: Case, scheme: Scheme, h: float, repeats: int) -> Record:
    times, name = [], ""
    found: list[tuple[float, ...]] = []
    for k in range(repeats):
        late = k * h / repeats if case.solution is not None else 0.0
        cpu, run = _timed(case.started(late), scheme, case.duration - late, h)
        times.append(cpu)
        name = run.scheme + (", projected" if getattr(scheme, "project_positions", False) else "")
        if case.solution is not None or not found:
            found.append(case.judged(run))
    return record(case, name, _options(scheme), h, NOT_MEASURED, times, found)


def _controlled(case: Case, made: Callable[[float], OwnStepsScheme], tolerance: float, repeats: int) -> Record:
    times = []
    for _ in range(repeats):
        cpu, run = _timed(case.started(0.0), made(tolerance), case.duration, None)
        times.append(cpu)
    mean = case.duration / max(len(run.t) - 1, 1)
    setting = "; ".join(run.notes)
    return record(case, run.scheme, setting, mean, tolerance, times, [case.judged(run)])


def _timed(
    problem: Problem, scheme: Scheme | OwnStepsScheme, duration: float, step: float | None
) -> tuple[float, Trajectory]:
    with warnings.catch_warnings():
        # warnings are in the notes, too
        warnings.simplefilter("ignore", MbviWarning)
        begin = process_time()
        run = simulate(problem, scheme, duration=duration, step=step, progress=False)
        return process_time() - begin, run


def _options(scheme: object) -> str:
    return ", ".join(f"{name} = {value}" for name, value in vars(scheme).items() if name != "jump" and value)


def record(
    case: Case, scheme: str, setting: str, step: float, tolerance: float, times: Sequence[float],
    found: Sequence[tuple[float, ...]] | Array,
) -> Record:  # fmt: skip
    """Return the record of several runs: the median of their times, the largest of each error."""
    q, v, graph, energy, penetration = (float(x) for x in np.max(np.array(found), axis=0))
    return Record(
        case.name, case.restitution, case.duration, case.plotted, scheme, setting, float(step), float(tolerance),
        median(times), len(times), q, v, graph, energy, penetration, case.source,
    )  # fmt: skip
