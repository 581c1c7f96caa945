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
    return Errors(*_path_errors(run, reference, compared), _graph_error(run, compared))


def path_errors(run: Trajectory, reference: Reference) -> tuple[float, float]:
    """Return the errors of configurations and of velocities, as `errors` does without the graph, which costs more."""
    return _path_errors(run, reference, _compared(run, reference))


class _Compared(NamedTuple):
    """Times at which a run is compared, and exact states: there, at nodes between them, and just before impacts."""

    times: Array
    q: Array
    v: Array
    at_nodes: list[Array]
    impacts: Array
    before: Array
    # times at which the velocity of the run jumps
    turns: Array


def _compared(run: Trajectory, reference: Reference) -> _Compared:
    turns = np.clip(run.t[1:] - (1.0 - run.record.timing.jump) * np.diff(run.t), run.t[:-1], run.t[1:])
    impacts = reference.impacts[(reference.impacts > run.t[0]) & (reference.impacts <= run.t[-1])]
    times = np.union1d(np.union1d(run.t, turns), impacts)
    groups = [times, *(times[:-1] + node * np.diff(times) for node in _NODES), np.nextafter(impacts, -np.inf)]
    q, v = reference.at(np.concatenate(groups))
    at_times, *at_nodes, before = np.split(v, np.cumsum([len(group) for group in groups[:-1]]))
    return _Compared(times, q[: len(times)], at_times, at_nodes, impacts, before, turns)


def _path_errors(run: Trajectory, reference: Reference, compared: _Compared) -> tuple[float, float]:
    times = compared.times
    recorded = np.searchsorted(run.t, times, side="right") - 1
    own, between = run.q[recorded], run.t[recorded] < times
    if between.any():
        own[between] = run.at(times[between])[0]
    q = float(np.abs(reference.problem.system.difference_each(compared.q, own)).max())
    # times are sorted
    known = run.v[np.searchsorted(compared.turns, times[:-1], side="right")]
    off = [np.linalg.norm(exact - known, axis=1) for exact in compared.at_nodes]
    return q, float(np.diff(times) @ (_WEIGHTS @ off))


def _graph_error(run: Trajectory, compared: _Compared) -> float:
    before = np.column_stack([compared.impacts, compared.before])
    curve = np.column_stack([compared.times, compared.v])
    curve = np.insert(curve, np.searchsorted(compared.times, compared.impacts), before, axis=0)
    stairs = np.repeat(np.column_stack([run.t, run.v]), 2, axis=0)[:-1]
    stairs[1::2, 0] = stairs[2::2, 0] = compared.turns
    stairs = np.concatenate([stairs, [[run.t[-1], *run.v[-1]]]])
    return graph_distance(stairs, curve)


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
    start, end = reference.problem.t0, reference.problem.t0 + reference.duration
    sides = np.union1d(jumps, reference.impacts)
    sides = sides[(sides > start) & (sides <= end)]
    times = np.sort(np.concatenate([np.linspace(start, end, samples + 1), sides, np.nextafter(sides, -np.inf)]))
    own = [at(t) for t in times.tolist()]
    p, v = np.array([q for q, _ in own]), np.array([v for _, v in own])
    q, w = reference.at(times)
    far = float(np.abs(reference.problem.system.difference_each(q, p)).max())
    off = np.linalg.norm(v - w, axis=1)
    integral = float(np.diff(times) @ (off[1:] + off[:-1])) / 2
    # both sides of a jump belong to one time
    line = np.where(np.isin(times, np.nextafter(sides, -np.inf)), np.nextafter(times, np.inf), times)
    return Errors(far, integral, graph_distance(np.column_stack([line, v]), np.column_stack([line, w])))
