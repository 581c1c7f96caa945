"""What of a position projection can be tried where all rows together cannot be projected."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from ..constraints import Rows
from ..problem import Problem
from ..system.system import Array


def bounds_of_groups(problem: Problem, rows: Rows, floor: Array) -> list[list[Array]]:
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
    for group in _independent_groups(problem, rows):
        tried, failed = [], raised
        for some in (raised & group, raised & group & limits):
            if some.any() and not np.array_equal(some, failed):
                tried.append(np.where(some, floor, kept))
                failed = some
        every.append(tried)
    return every


def _independent_groups(problem: Problem, rows: Rows) -> list[Array]:
    """Return masks of rows, shape (k,), that act on mechanisms and free bodies on which no other rows act."""
    parts, count = [], 0
    for part, *_ in problem.system.located_parts():
        bodies = part.independent_bodies
        parts.append(count + np.repeat(np.arange(bodies), part.nv // bodies))
        count += bodies
    acts = csr_array(rows.jacobian)
    which = np.repeat(np.arange(acts.shape[0]), np.diff(acts.indptr)), np.concatenate(parts)[acts.indices]
    graph = csr_array((np.ones(len(acts.indices)), which), shape=(acts.shape[0], count))
    number, label = connected_components(graph @ graph.T, directed=False)
    return [label == k for k in range(number)]
