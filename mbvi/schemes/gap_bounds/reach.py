"""How far each mechanism and free body can reach within a step, and groups of contacts that act on each other.

Steps of `StewartTrinkle` look farther where bodies are faster. What moves far away does not count: each part of the
system has a reach of its own, and contacts within reach give the larger of two to both.
"""

from __future__ import annotations

import numpy as np

from ...compiled import kernel, plain_array
from ...constraints import Rows
from ...problem import Problem
from ...system import System
from ...system.parts import parts_of
from ...system.system import Array
from ..positions.displacement_kernel import independent_groups


def parts_of_bodies(system: System, part: Array) -> Array:
    """Return which part of the system each body belongs to, shape (n,), given that of each velocity."""
    found, begin = [], 0
    for one in parts_of(system):
        count = one.independent_bodies
        labels = part[begin : begin + one.nv : one.nv // count]
        found.append(np.repeat(labels, (len(one.bodies) - 1) // count))
        begin += one.nv
    return np.concatenate(found)


@kernel("b1(f8[:,::1], f8[::1], i8[::1], f8[::1], b1[::1])")
def spread_reach(J: Array, length: Array, part: Array, reach: Array, near: Array) -> bool:
    """Find which rows are within reach, and give their parts the larger reach of both; return whether all rows are.

    Parameters
    ----------
    J : ndarray, shape (k, nv)
        The rows.
    length : ndarray, shape (k,)
        Their gaps as lengths [m].
    part : ndarray of int, shape (nv,)
        See `independent_parts`.
    reach : ndarray, shape (parts,)
        Of each part the reach of its own, which is raised [m].
    near : ndarray of bool, shape (k,)
        Receives which rows are within reach.
    """
    k, n = len(J), len(part)
    for a in range(k):
        near[a] = False
    more = True
    while more:
        more = False
        for a in range(k):
            largest = 0.0
            for j in range(n):
                if J[a, j] != 0.0:
                    largest = max(largest, reach[part[j]])
            near[a] = near[a] or length[a] <= largest
            for j in range(n if near[a] else 0):
                if J[a, j] != 0.0 and reach[part[j]] < largest:
                    reach[part[j]], more = largest, True
    for a in range(k):
        if not near[a]:
            return False
    return True


@kernel("void(f8[::1], i8[::1], f8[::1])")
def write_largest_of_groups(values: Array, group: Array, largest: Array) -> None:
    """Write of each row the largest value, at least 0, of its group, shape (k,).

    `group` has the first row of each; `values` and `largest` must be different arrays.
    """
    for a in range(len(values)):
        largest[a] = 0.0
    for a in range(len(values)):
        largest[group[a]] = max(largest[group[a]], values[a])
    for a in range(len(values)):
        largest[a] = largest[group[a]]


def groups(problem: Problem, rows: Rows) -> Array:
    """Return the first row of the group of each row, shape (k,): groups act on different parts of the system.

    Rows of many bodies, which are sparse, count as one group.
    """
    group = np.zeros(len(rows.gap), np.int64)
    if isinstance(rows.jacobian, np.ndarray) and problem.constraints.part[-1]:
        independent_groups(plain_array(rows.jacobian), problem.constraints.part, group)
    return group


def largest_of_groups(values: Array, group: Array) -> Array:
    """Return what `write_largest_of_groups` writes."""
    largest = np.empty(len(values))
    write_largest_of_groups(plain_array(np.asarray(values, float)), group, largest)
    return largest
