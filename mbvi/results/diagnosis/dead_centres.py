"""Dead centres of closed loops: configurations where gradients of equalities that are independent elsewhere depend."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.linalg import solve_triangular

from ...errors import ProjectionError
from ...system import System
from ...system.mechanisms.loop_margin import with_equalities
from ..run_data import RunData
from .diagnosis import Array

# singular values of unit gradients, relative to the largest, that count as zero where rows always depend on each other,
# and those below which one that falls may reach zero
_ZERO, _SMALL = 1e-7, 0.05
# parts of a step of a scheme that chooses its steps
_WITHIN = 10
# size of the displacement to a configuration nearby
_ASIDE = 0.01


def dead_centres(run: RunData, dense: Array | None = None) -> tuple[float, ...]:
    """Return the times at which the rank of the equalities drops [s], in order; a stay gives its first time.

    `dense` is the dense output of the run, if it has one.
    """
    assert run.problem is not None
    found, parts = set[float](), with_equalities(run.problem.system)
    if not parts:
        return ()
    times, states = _sampled(run, dense)
    for part, where in parts:
        values = np.array([_singular_values(part, q[where]) for q in states])
        rank = max(_rank(values), _rank_nearby(part, states[0, where]))
        found.update(times[_drops(values, rank)].tolist())
    return tuple(sorted(found))


def _sampled(run: RunData, dense: Array | None) -> tuple[Array, Array]:
    """Return times and configurations of a run: those of its states, and of points within steps that may be long."""
    if dense is None:
        return run.t, run.q
    times = np.unique(run.t[:-1, None] + np.diff(run.t)[:, None] * np.linspace(0.0, 1.0, _WITHIN + 1))
    times = np.append(times[times < run.t[-1]], run.t[-1])
    return times, replace(run, record=replace(run.record, dense=dense)).at(times)[0]


def _singular_values(system: System, q: Array) -> Array:
    """Return the singular values of the gradients of the equalities, each of unit length in the kinetic metric."""
    L = np.linalg.cholesky(system.metric(q).dense())
    rows = solve_triangular(L, system.equality_gradients(q).T, lower=True).T
    return np.linalg.svd(rows / np.linalg.norm(rows, axis=1)[:, None], compute_uv=False)


def _rank(values: Array) -> int:
    """Return the largest rank of the gradients of some configurations, of which `values` are the singular values."""
    return int((values > _ZERO * values[:, :1]).sum(axis=1).max())


def _rank_nearby(system: System, q: Array) -> int:
    """Return the rank at a configuration beside q, because runs may stay at a dead centre; 0 if not found."""
    aside = np.random.default_rng(0).normal(size=system.nv)
    aside *= _ASIDE / np.linalg.norm(aside)
    try:
        return _rank(_singular_values(system, system.integrate(q, aside))[None])
    except ProjectionError:
        return 0


def _drops(values: Array, rank: int) -> Array:
    """Return where the singular value that makes the rank is zero, or crosses zero within a step.

    `values`, shape (n, m), are those of the states in order. Near a dead centre it is linear in the distance:
    it crosses zero where it is smaller than it changes to a neighbour.
    """
    least = values[:, rank - 1] / values[:, 0]
    at = least <= _ZERO
    found = np.flatnonzero(at & ~np.concatenate([[False], at[:-1]]))
    inner = np.arange(1, len(least) - 1)
    before, here, after = least[:-2], least[1:-1], least[2:]
    crosses = (here <= np.minimum(before, after)) & (here <= np.maximum(before, after) - here) & (here <= _SMALL)
    near = at[:-2] | at[1:-1] | at[2:]
    return np.union1d(found, inner[crosses & ~near])
