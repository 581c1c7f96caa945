"""The least displacement in the kinetic metric that moves rows out of penetration, and what to try where none does."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from ...constraints import Rows
from ...constraints.rows import match_contacts
from ...errors import ProjectionError
from ...problem import Problem
from ...projection import Metric, Projector
from ...projection.positions.held_rows import FARTHEST, HARDLY
from ...projection.positions.travel import MOST_LINEARISATIONS
from ...projection.row_speeds import times
from ...system.system import Array
from .nearby_rows import NearbyRows

# squares of lengths below this part of the largest are rounding
_DEPENDENT = 1e-12


class SunkRows(NamedTuple):
    """Where a position projection starts.

    Attributes
    ----------
    problem : Problem
        System and constraints.
    q : ndarray, shape (nq,)
        Configuration.
    metric : Metric
        M.
    marks : Rows
        The rows of the law at the end of the step.
    active : Rows
        The active rows at q.
    margins : ndarray, shape (parts,)
        Of each part, gaps up to which rows take part in the projection [m].
    projector : Projector
        Solves the projections.
    nearby : NearbyRows
        The rows at the end of the step, as far as they are known.
    """

    problem: Problem
    q: Array
    metric: Metric
    marks: Rows
    active: Rows
    margins: Array
    projector: Projector
    nearby: NearbyRows


class Displaced(NamedTuple):
    """A projected configuration.

    Attributes
    ----------
    q : ndarray, shape (nq,)
        The configuration.
    displacement : ndarray, shape (nv,)
        Tangent vector to it from the configuration before the projection.
    near : Rows
        The rows there that took part in the last projection.
    residual : float
        Relative KKT residual of that projection.
    """

    q: Array
    displacement: Array
    near: Rows
    residual: float


def least_displacement(sunken: SunkRows, floor: Array, sticking: Array | None = None) -> Displaced | None:
    """Return the nearest configuration in which no gap is below its lower bound; None if the iteration fails.

    Parameters
    ----------
    sunken : SunkRows
        Where it starts.
    floor : ndarray, shape (k,)
        Lower bounds of the gaps of the active rows; that of rows that become active during the projection is 0.
    sticking : ndarray of bool, shape (n,), optional
        Rows of the law that are held along their tangents.

    Notes
    -----
    The rows are taken again at the configuration of each projection. The iteration ends when no gap there is below its
    lower bound, and those of all rows with a positive percussion equal it, to within the activation tolerance.
    Equality matters: a contact whose gap remained open would not be active, and its body would fall.
    """
    problem, q, metric, marks, active, margins, projector, nearby = sunken
    system, tolerance = problem.system, problem.tolerance
    moved = still = np.zeros(system.nv)
    near, bound = active, floor
    for i in range(MOST_LINEARISATIONS):
        J = near.jacobian if sticking is None else _held(metric, near, sticking, match_contacts(near, marks))
        lower = times(near.jacobian, moved) + bound - near.gap
        # where linearisations alternate, each of the others adds to the displacement before
        origin = still if 2 * i < MOST_LINEARISATIONS else moved
        try:
            moved, percussion, residual = projector.project(origin, metric, J, lower)
        except ProjectionError:
            return None
        if sticking is not None and not _raises(metric, near.jacobian, moved, lower, tolerance):
            return None
        place, last = system.integrate(q, moved), near
        near = nearby.at(place, margins)
        owner, pushed = match_contacts(near, active), match_contacts(near, last)
        bound = np.where(owner >= 0, floor[owner], 0.0)
        excess = problem.constraints.levers(near.constraint) * (near.gap - bound)
        pushed = (pushed >= 0) & (percussion[pushed] > 0.0)
        if (excess >= -tolerance).all() and (excess[pushed] <= tolerance).all():
            return Displaced(place, moved, near, residual)
    return None


def displacement_of_groups(sunken: SunkRows, floor: Array) -> Displaced | None:
    """Project independent groups of rows one by one, and of those that cannot be projected the joint limits.

    The arguments are those of `least_displacement`, which has failed for all rows together. None if nothing can be
    projected.
    """
    problem = sunken.problem
    moved, residual, some = np.zeros(problem.system.nv), 0.0, False
    for bounds in _bounds_of_groups(problem, sunken.active, floor):
        tried = (least_displacement(sunken, bound) for bound in bounds)
        found = next((one for one in tried if one is not None), None)
        if found is not None:
            # groups move different bodies
            moved, residual, some = moved + found.displacement, max(residual, found.residual), True
    if not some:
        return None
    place = problem.system.integrate(sunken.q, moved)
    return Displaced(place, moved, sunken.nearby.at(place, sunken.margins), residual)


def _bounds_of_groups(problem: Problem, rows: Rows, floor: Array) -> list[list[Array]]:
    """Return for each independent group of rows the lower bounds that are to be tried in turn, each of shape (k,).

    The first raise all rows of the group, the second its joint limits alone. All other rows keep their gaps.

    Parameters
    ----------
    rows : Rows
        The active rows.
    floor : ndarray, shape (k,)
        Lower bounds of their gaps, which cannot be kept all together.
    """
    kept, limits = np.minimum(rows.gap, 0.0), np.isnan(rows.point).any(axis=1)
    raised, every = floor > kept, []
    label = independent_groups(rows.jacobian, problem.constraints.part)
    for group in (label == k for k in np.unique(label)):
        tried, failed = [], raised
        for some in (raised & group, raised & group & limits):
            if some.any() and not np.array_equal(some, failed):
                tried.append(np.where(some, floor, kept))
                failed = some
        every.append(tried)
    return every


def independent_groups(acts: Array | csr_array, part: Array) -> Array:
    """Return the group of each row, shape (k,): rows act on parts of the system on which no other group acts.

    Parameters
    ----------
    acts : ndarray or csr_array, shape (k, nv)
        The rows.
    part : ndarray of int, shape (nv,)
        See `independent_parts`.
    """
    acts = csr_array(acts)
    which = np.repeat(np.arange(acts.shape[0]), np.diff(acts.indptr)), part[acts.indices]
    graph = csr_array((np.ones(len(acts.indices)), which), shape=(acts.shape[0], part[-1] + 1))
    return np.asarray(connected_components(graph @ graph.T, directed=False)[1])


def _raises(metric: Metric, J: Array | csr_array, moved: Array, lower: Array, tolerance: float) -> bool:
    """Return whether a displacement that holds tangents raises gaps, and is not much longer than one that does not.

    Held, the rows of two contacts of a ball in a groove oppose each other: to raise both takes a displacement that is
    very long, or mere rounding.
    """
    if (times(J, moved) < lower - tolerance).any():
        return False
    if not isinstance(J, np.ndarray):
        return True
    squares = np.vecdot(J, metric.solve_rows(J))
    some = (lower > 0.0) & (squares > 0.0)
    least = (lower[some] ** 2 / squares[some]).max(initial=0.0)
    return bool(moved @ metric.apply(moved) <= FARTHEST**2 * least)


def _held(metric: Metric, near: Rows, sticking: Array, owner: Array) -> Array | csr_array:
    """Return the gradients of rows along displacements that do not move sticking contacts along their tangents.

    These are J P, where P projects onto such displacements in the metric. Gradients of which nothing is left become
    zero. Many bodies are not held: their rows are sparse, and J P is not.

    Parameters
    ----------
    metric : Metric
        M.
    near : Rows
        The rows.
    sticking : ndarray of bool, shape (n,)
        Which rows of the law stick.
    owner : ndarray of int, shape (k,)
        For each row that of the law, -1 where there is none.
    """
    J, held = near.jacobian, np.flatnonzero((owner >= 0) & sticking[owner])
    if near.tangents is None or not isinstance(J, np.ndarray) or not held.size:
        return J
    A = near.tangents.take(held).sliding().jacobian
    solved = metric.solve_rows(A)
    left = J - (J @ solved.T) @ np.linalg.pinv(solved @ A.T, HARDLY, hermitian=True) @ A
    lengths, before = (np.vecdot(rows, metric.solve_rows(rows)) for rows in (left, J))
    return np.where((lengths > _DEPENDENT * before)[:, None], left, 0.0)
