"""Errors of a run against an exact solution, and their order."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...run.simulate import simulate

if TYPE_CHECKING:
    from ...reference.solution import Reference
    from ...results.trajectory import Trajectory
    from ...schemes import Scheme

Array = np.ndarray

# Gauss and Legendre on [0, 1]
_NODES, _WEIGHTS = (0.5 * (np.polynomial.legendre.leggauss(2)[0] + 1), 0.5 * np.polynomial.legendre.leggauss(2)[1])
# points on each jump of the velocity
_POINTS = 33
# runs, of which the largest error counts
_RUNS = 12
# points compared at once
_CHUNK = 64


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
    difference = reference.problem.system.difference
    jumps = reference.impacts[(reference.impacts > run.t[0]) & (reference.impacts <= run.t[-1])]
    # times at which the velocity of the run jumps
    turns = np.clip(run.t[1:] - (1.0 - run.record.timing.jump) * np.diff(run.t), run.t[:-1], run.t[1:])
    times = np.union1d(np.union1d(run.t, turns), jumps)
    exact = [reference.at(t) for t in times.tolist()]
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
    # velocities just before jumps
    before = {float(t): reference.at(float(np.nextafter(t, -np.inf)))[1] for t in jumps}
    curve = []
    for t, (_, velocity) in zip(times.tolist(), exact, strict=True):
        curve += [(t, *before[t])] if t in before else []
        curve.append((t, *velocity))
    stairs = np.repeat(np.column_stack([run.t, run.v]), 2, axis=0)[:-1]
    stairs[1::2, 0] = stairs[2::2, 0] = turns
    stairs = np.concatenate([stairs, [[run.t[-1], *run.v[-1]]]])
    return Errors(q, v, graph_distance(stairs, np.array(curve)))


def worst_errors(reference: Reference, scheme: Scheme | None, h: float) -> Errors:
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
    """
    found = []
    for k in range(_RUNS):
        # steps between 0.8 h and h; starts spread twice over a step
        step, late = h * (1.0 - 0.2 * k / _RUNS), h * (2 * k / _RUNS % 1.0)
        problem = reference.started(reference.problem.t0 + late)
        found.append(errors(simulate(problem, scheme, step=step, duration=reference.duration - late), reference))
    return Errors(*np.max(found, axis=0).tolist())


def graph_distance(a: Array, b: Array) -> float:
    """Return the Hausdorff distance of two polylines.

    Parameters
    ----------
    a, b : ndarray, shapes (n, 1 + nv) and (m, 1 + nv)
        Vertices; the first column is time and does not decrease. Both begin and end at the same time.
    """
    return max(_farthest(_filled(a), b), _farthest(_filled(b), a))


def _filled(line: Array) -> Array:
    """Return the vertices of a polyline and further points along jumps."""
    jump = np.flatnonzero((line[1:, 0] == line[:-1, 0]) & (line[1:] != line[:-1]).any(axis=1))
    part = np.linspace(0.0, 1.0, _POINTS)[:, None, None]
    between = (1 - part) * line[jump] + part * line[jump + 1]
    return np.concatenate([line, between.reshape(-1, line.shape[1])])


def _farthest(points: Array, line: Array) -> float:
    """Return the largest distance of points from a polyline."""
    from scipy.spatial import cKDTree

    start, along = line[:-1], np.diff(line, axis=0)
    squared = np.einsum("ij,ij->i", along, along)
    squared[squared == 0.0] = 1.0
    # the distance from the nearest vertex bounds the distance from the line
    bound = cKDTree(_filled(line)).query(points)[0]
    order = np.argsort(-bound)
    farthest = 0.0
    for first in range(0, len(order), _CHUNK):
        some = order[first : first + _CHUNK]
        if bound[some[0]] <= farthest:
            break
        # slightly wider, so that rounding does not exclude the nearest jump
        t, window = points[some, 0], 1.001 * bound[some] + 1e-9 * (line[-1, 0] - line[0, 0])
        low = np.maximum(np.searchsorted(line[:, 0], t - window) - 1, 0)
        high = np.minimum(np.searchsorted(line[:, 0], t + window, side="right"), len(start))
        index = np.minimum(low[:, None] + np.arange(int((high - low).max())), high[:, None] - 1)
        offset = points[some, None] - start[index]
        share = np.clip(np.einsum("ijk,ijk->ij", offset, along[index]) / squared[index], 0.0, 1.0)
        offset -= share[:, :, None] * along[index]
        nearest = np.sqrt(np.einsum("ijk,ijk->ij", offset, offset).min(axis=1))
        farthest = max(farthest, float(nearest.max()))
    return farthest


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
