"""Every row of an admissible set, near or far: what a scheme that locates impacts follows along a motion."""

from __future__ import annotations

from typing import Any

import numpy as np

from .active import Array
from .admissible_set import AdmissibleSet
from .half_space import HalfSpaceContacts
from .joint_limit import JointLimits
from .pairs import Pairs
from .signed_distance import SignedDistances
from .sphere_surface import SphereSurface
from .spheres import SphereContacts


class SmoothRows:
    """Gaps and gradients of every row, each a function of the configuration with a number of its own.

    A shape over a half-space has one row for each point it can stand on. Where a gradient jumps (polyhedra against each
    other) there is one row a pair, its least distance.

    Parameters
    ----------
    constraints : AdmissibleSet
        K.
    t : float
        Time [s].
    q : ndarray, shape (nq,)
        A configuration.

    Attributes
    ----------
    number : ndarray of int, shape (m,)
        Which constraint each row belongs to.
    restitution : ndarray, shape (m,)
        e of each row.
    smooth : ndarray of bool, shape (m,)
        Whether its gradient is continuous.
    reach : ndarray, shape (m, nv)
        How fast each velocity can change the gap; infinite where that is not known.
    """

    def __init__(self, constraints: AdmissibleSet, t: float, q: Array) -> None:
        self._system = constraints.system
        self._parts: list[tuple[Any, slice]] = []
        columns: list[tuple[Array, Array, Array, Array]] = []
        start = 0
        for constraint, first, e in constraints.numbered():
            number, own, smooth, reach = _describe(constraint, e, self._system.nv, t, q)
            columns.append((number + first, own, smooth, reach))
            self._parts.append((constraint, slice(start, start + len(number))))
            start += len(number)
        empty = (np.zeros(0, np.int64), np.zeros(0), np.zeros(0, bool), np.zeros((0, self._system.nv)))
        stacked = [np.concatenate(parts) for parts in zip(empty, *columns, strict=True)]
        self.number, self.restitution, self.smooth, self.reach = stacked
        self.all = np.arange(start)

    def gaps(self, t: float, q: Array, index: Array) -> Array:
        """Return f(q) of some rows in ascending order, shape (k,) [m or rad]."""
        return self._each(t, q, index, self._gaps, np.zeros(0))

    def gradients(self, t: float, q: Array, index: Array) -> Array:
        """Return grad f of some rows in ascending order, shape (k, nv)."""
        return self._each(t, q, index, self._gradients, np.zeros((0, self._system.nv)))

    def points(self, t: float, q: Array, index: Array) -> tuple[Array, Array]:
        """Return contact points and normals of some rows, shapes (k, 3); NaN where a row is no contact."""
        both = self._each(t, q, index, self._places, np.zeros((0, 6)))
        return both[:, :3], both[:, 3:]

    def _each(self, t: float, q: Array, index: Array, ask: Any, nothing: Array) -> Array:
        if len(self._parts) == 1:
            return np.asarray(ask(self._parts[0][0], t, q, index))
        ends = np.searchsorted(index, [rows.start for _, rows in self._parts] + [len(self.all)])
        found = [
            ask(constraint, t, q, index[low:high] - rows.start)
            for (constraint, rows), low, high in zip(self._parts, ends[:-1], ends[1:], strict=True)
            if high > low
        ]
        return np.concatenate([nothing, *found])

    def _gaps(self, constraint: Any, t: float, q: Array, own: Array) -> Array:
        if isinstance(constraint, Pairs):
            return _contacts(constraint, q, own)[0]
        return np.atleast_1d(np.asarray(constraint.gap(t, q), dtype=float))[own]

    def _gradients(self, constraint: Any, t: float, q: Array, own: Array) -> Array:
        if isinstance(constraint, Pairs):
            _, point, normal, pair = _contacts(constraint, q, own)
            first, second = constraint.sides(pair)
            return self._system.separation_rows(q, first, second, point, normal)
        return np.atleast_2d(np.asarray(constraint.gradient(t, q), dtype=float))[own]

    def _places(self, constraint: Any, t: float, q: Array, own: Array) -> Array:
        if isinstance(constraint, Pairs):
            return np.concatenate(_contacts(constraint, q, own)[1:3], axis=1)
        return np.full((len(own), 6), np.nan)


def _describe(constraint: Any, e: float, nv: int, t: float, q: Array) -> tuple[Array, Array, Array, Array]:
    """Return number, restitution, smoothness and reach of each row of one constraint."""
    if isinstance(constraint, SphereContacts):
        i, j = np.triu_indices(constraint.count, 1)
        number, own = i * constraint.count + j, constraint.restitution_of(i, j)
        return number, own, np.ones(len(i), bool), np.full((len(i), nv), np.inf)
    if isinstance(constraint, HalfSpaceContacts):
        pair = constraint.owner
        return pair, constraint.restitution[pair], np.ones(len(pair), bool), constraint.reach[pair]
    if isinstance(constraint, SignedDistances):
        pair = np.arange(len(constraint.names))
        return pair, constraint.restitution, constraint.round, constraint.reach
    if isinstance(constraint, SphereSurface):
        # which feature is nearest changes
        number = np.arange(constraint.size)
        return number, constraint.restitution, np.zeros(len(number), bool), np.full((len(number), nv), np.inf)
    size = len(np.atleast_1d(constraint.gap(t, q)))
    own = np.broadcast_to(np.asarray(getattr(constraint, "restitution", e), dtype=float), (size,))
    known = isinstance(constraint, JointLimits)
    reach = np.abs(constraint.gradient(t, q)) if known else np.full((size, nv), np.inf)
    return np.arange(size), own, np.ones(size, bool), reach


def _contacts(constraint: Pairs, q: Array, own: Array) -> tuple[Array, Array, Array, Array]:
    """Return gap, point, normal and pair of some rows of pairs: all points of a half-space's, the nearest of others."""
    if isinstance(constraint, HalfSpaceContacts):
        pairs = np.unique(constraint.owner[own])
        pair, gap, point, normal = constraint.contacts(q, pairs, 0.0)
        # the points of these pairs, in ascending order
        chosen = np.searchsorted(np.flatnonzero(np.isin(constraint.owner, pairs)), own)
        return gap[chosen], point[chosen], normal[chosen], pair[chosen]
    pair, gap, point, normal = constraint.nearest(q, own)
    return gap, point, normal, pair
