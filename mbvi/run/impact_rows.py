"""Finds the rows that take part in an impact, where many bodies rest on each other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components

from ..compiled import kernel
from ..schemes import Step
from ..schemes.contact_friction import friction_of, regime
from ..system import System, parts_of

Array = np.ndarray


@kernel("void(i8[::1], f8[::1], i8[::1], f8[::1])")
def _raise_levels(number: Array, percussion: Array, known: Array, level: Array) -> None:
    """Raise the level of each known constraint to its largest percussion.

    Parameters
    ----------
    number, percussion : ndarray, shape (k,)
        Constraints and percussions of rows.
    known : ndarray of int, shape (n,)
        Constraints, ascending, each once.
    level : ndarray, shape (n,)
        The largest percussion of each known constraint so far; raised in place.
    """
    for a in range(len(number)):
        if percussion[a] > 0.0:
            k = np.searchsorted(known, number[a])
            if k < len(known) and known[k] == number[a]:
                level[k] = max(level[k], percussion[a])


def exceeds_recent(number: Array, percussion: Array, recent: Sequence[tuple[Array, Array]]) -> Array:
    """Return which rows have a percussion above twice the largest that their constraint had in some earlier steps.

    Parameters
    ----------
    number, percussion : ndarray, shape (k,)
        Constraints and percussions of the rows.
    recent : sequence of (ndarray, ndarray), shapes (m,) and (m, 4)
        Constraints and rates of the rows of each of these steps.
    """
    known, place = np.unique(number, return_inverse=True)
    level = np.zeros(len(known))
    if recent:
        numbers, percussions = (np.concatenate(parts) for parts in zip(*((n, r[0]) for n, r in recent), strict=True))
        _raise_levels(numbers, percussions, known, level)
    return np.asarray(percussion > 2.0 * level[place])


def independent_parts(system: System) -> Array:
    """Return which part of a system each velocity belongs to, shape (nv,): a mechanism, or one free body."""
    parts, count = [], 0
    for one in parts_of(system):
        bodies = one.independent_bodies
        parts.append(count + np.repeat(np.arange(bodies), one.nv // bodies))
        count += bodies
    return np.concatenate(parts)


def linked(jacobian: Array | csr_array, seeds: Array, parts: Array) -> Array:
    """Return which rows are linked to a seed by a chain of rows, each acting on a part of the system with the next.

    Parameters
    ----------
    jacobian : ndarray or csr_array, shape (k, nv)
        Gradients of the rows.
    seeds : ndarray of bool, shape (k,)
        Which of them are seeds.
    parts : ndarray of int, shape (nv,)
        As returned by `independent_parts`.
    """
    row, column = jacobian.nonzero()
    count = len(seeds)
    size = count + int(parts.max(initial=-1)) + 1
    edges = coo_array((np.ones(len(row), bool), (row, count + parts[column])), shape=(size, size))
    label = connected_components(edges, directed=False)[1][:count]
    return np.isin(label, label[seeds])


def friction_of_impact(
    step: Step, chosen: Array
) -> tuple[Array, Array, Array, tuple[str, ...], Array] | tuple[None, None, None, None, None]:
    """Return the last five attributes of an `Impact` on the chosen rows of a step."""
    found = friction_of(step)
    if found is None:
        return None, None, None, None, None
    tangential, before, after, sticks = found.take(chosen)
    regimes = map(regime, sticks.tolist(), step.percussion[chosen].tolist())
    return tangential, before, after, tuple(regimes), step.active.restitution[chosen]
