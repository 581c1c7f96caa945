"""Errors of a run against an exact solution, and their order."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from mbvi.run.simulate import simulate

from .graphs import graph_distance

if TYPE_CHECKING:
    from mbvi.reference.solution import Reference
    from mbvi.results.trajectory import Trajectory
    from mbvi.schemes import Scheme

Array = np.ndarray

# Gauss and Legendre on [0, 1]
_NODES, _WEIGHTS = (0.5 * (np.polynomial.legendre.leggauss(2)[0] + 1), 0.5 * np.polynomial.legendre.leggauss(2)[1])
# runs, of which the largest error counts
RUNS = 12


class Errors(NamedTuple):
    """Errors of a run against an exact solution.

    Attributes
    ----------
    q : float
        Largest difference of configurations, over all components and times [m, rad].
    v : float
        Integral of |v_h - v| over time; a jump at a slightly wrong time changes it little [m, rad].
    graph : float
        Hausdorff distance of the graphs of v_h and v in (t, v), with jumps as segments.
    """

    q: float
    v: float
    graph: float


def errors(run: Trajectory, reference: Reference) -> Errors:
    """Return the errors of a run against an exact solution; every step must be recorded.

    Parameters
    ----------
    run : Trajectory
        A run of `reference.problem`, or of one started later on its solution.
    reference : Reference
        The problem with its exact solution.

    Returns
    -------
    Errors
        Errors of configurations, of velocities, and of the graph of the velocity.
    """
    compared = _compared(run, reference)
    return Errors(*_path_errors(run, reference, compared), _graph_error(run, reference, compared))


def path_errors(run: Trajectory, reference: Reference) -> tuple[float, float]:
    """Return the errors of configurations and of velocities, as `errors` does without the graph, which costs more."""
    return _path_errors(run, reference, _compared(run, reference))


class _Compared(NamedTuple):
    """Times at which a run is compared, the exact states there, and the times at which its velocity jumps."""

    times: Array
    exact: list[tuple[Array, Array]]
    turns: Array


def _compared(run: Trajectory, reference: Reference) -> _Compared:
    turns = np.clip(run.t[1:] - (1.0 - run.record.timing.jump) * np.diff(run.t), run.t[:-1], run.t[1:])
    times = np.union1d(np.union1d(run.t, turns), _jumps(run, reference))
    return _Compared(times, [reference.at(t) for t in times.tolist()], turns)


def _jumps(run: Trajectory, reference: Reference) -> Array:
    """Return the times of the exact impacts during a run."""
    return reference.impacts[(reference.impacts > run.t[0]) & (reference.impacts <= run.t[-1])]


def _path_errors(run: Trajectory, reference: Reference, compared: _Compared) -> tuple[float, float]:
    difference, (times, exact, turns) = reference.problem.system.difference, compared
    own = dict(zip(run.t.tolist(), run.q, strict=True))
    own |= {t: run.at(t)[0] for t in np.setdiff1d(times, run.t).tolist()}
    q = max(float(np.abs(difference(a, own[t])).max()) for t, (a, _) in zip(times.tolist(), exact, strict=True))
    left, length = times[:-1], np.diff(times)
    # index of the recorded velocity; times are sorted
    index = np.searchsorted(turns, left, side="right")
    v = 0.0
    for node, weight in zip(_NODES, _WEIGHTS, strict=True):
        smooth = np.array([reference.at(float(t))[1] for t in left + node * length])
        v += weight * float(length @ np.linalg.norm(smooth - run.v[index], axis=1))
    return q, v


def _graph_error(run: Trajectory, reference: Reference, compared: _Compared) -> float:
    times, exact, turns = compared
    # velocities just before jumps
    before = {float(t): reference.at(float(np.nextafter(t, -np.inf)))[1] for t in _jumps(run, reference)}
    curve = []
    for t, (_, velocity) in zip(times.tolist(), exact, strict=True):
        curve += [(t, *before[t])] if t in before else []
        curve.append((t, *velocity))
    stairs = np.repeat(np.column_stack([run.t, run.v]), 2, axis=0)[:-1]
    stairs[1::2, 0] = stairs[2::2, 0] = turns
    stairs = np.concatenate([stairs, [[run.t[-1], *run.v[-1]]]])
    return graph_distance(stairs, np.array(curve))


def worst_errors(
    reference: Reference,
    scheme: Scheme | None,
    h: float,
    measure: Callable[[Trajectory, Reference], tuple[float, ...]] = errors,
    runs: int = RUNS,
) -> Array:
    """Return the largest errors of runs at steps near h with different starts within a step.

    The phase of an impact within its step scatters errors by a factor of two to five; the largest error of several runs
    is near the bound.

    Parameters
    ----------
    reference : Reference
        The problem with its exact solution.
    scheme : Scheme or None
        Scheme; None for the default.
    h : float
        Largest time step [s]; the least is 0.8 of it.
    measure : callable
        `errors` or `path_errors`.
    runs : int
        Number of runs.

    Returns
    -------
    ndarray
        The largest of each error.
    """
    found = []
    for k in range(runs):
        # steps between 0.8 h and h; starts spread twice over a step
        step, late = h * (1.0 - 0.2 * k / runs), h * (2 * k / runs % 1.0)
        problem = reference.started(reference.problem.t0 + late)
        run = simulate(problem, scheme, step=step, duration=reference.duration - late, progress=False)
        found.append(measure(run, reference))
    return np.max(found, axis=0)


def fitted_order(steps: Sequence[float] | Array, values: Sequence[float] | Array) -> float:
    """Return the slope of log(values) over log(steps), by least squares."""
    return float(np.polyfit(np.log(steps), np.log(values), 1)[0])


def sampled_errors(
    at: Callable[[float], tuple[Array, Array]], jumps: Array, reference: Reference, samples: int = 1000
) -> Errors:
    """Return the errors of a motion given at all times, as by `EventDriven` and engines with dense output.

    Parameters
    ----------
    at : callable
        at(t) -> (q, v).
    jumps : ndarray, shape (k,)
        Times at which its v jumps [s].
    reference : Reference
        The problem with its exact solution.
    samples : int
        Number of times that are compared, in addition to both sides of each jump.
    """
    difference, start = reference.problem.system.difference, reference.problem.t0
    end = start + reference.duration
    sides = np.union1d(jumps, reference.impacts)
    sides = sides[(sides > start) & (sides <= end)]
    times = np.sort(np.concatenate([np.linspace(start, end, samples + 1), sides, np.nextafter(sides, -np.inf)]))
    own, exact = [at(t) for t in times.tolist()], [reference.at(t) for t in times.tolist()]
    q = max(float(np.abs(difference(a, b)).max()) for (a, _), (b, _) in zip(exact, own, strict=True))
    v, w = (np.array([velocity for _, velocity in states]) for states in (own, exact))
    off = np.linalg.norm(v - w, axis=1)
    integral = float(np.diff(times) @ (off[1:] + off[:-1])) / 2
    # both sides of a jump belong to one time
    line = np.where(np.isin(times, np.nextafter(sides, -np.inf)), np.nextafter(times, np.inf), times)
    return Errors(q, integral, graph_distance(np.column_stack([line, v]), np.column_stack([line, w])))
