"""The projection onto the rows of many bodies: sparse, island by island, started from the percussions of the last one.

Rows are scaled to unit length in the metric. A small island is solved as `few_rows` solves: to rounding, by the rows
that press. A large one whose percussions of the last step still fit is left alone; others are solved by `mending` to
the residual that is asked.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.sparse import csr_array

from ..compiled import kernel
from ..errors import ProjectionError
from .gram import gram, islands
from .metric import Array, DiagonalMetric, Metric
from .nonnegative import exchange, settle
from .refinement import relax

# rows up to which an island is solved to rounding
_SMALL = 48
# unit rows with a product above this are the same
_SAME = 1.0 - 1e-13
# the share of the residual asked for that the solver is held to: the check is on the velocity, and rounds otherwise
_MARGIN = 0.9
# what a small island may be off by, relative to the largest speed
_ROUNDED = 1e-10
# rows up to which an island that fails is solved in full
_MOST_EXACT = 400
# the part of the last step's percussions that an island is started from where they no longer fit: all of them would
# store what changes nothing, stress among rows that depend on each other, more and more from step to step
_CARRIED = 0.8
# how many rows are looked at beyond those that ask or pressed, and the share of all from which on it is all of them
_NEXT, _MOST = 0.5, 0.5
# points of one constraint that are told apart
_POINTS = 64


@kernel("f8(u4[::1], u4[::1], f8[::1], f8[::1], i8[::1], i8, f8, f8, f8[::1])")
def _solve_islands(
    starts: Array, columns: Array, G: Array, d: Array, label: Array, count: int, target: float, carried: float, u: Array
) -> float:
    """Solve min u' G u / 2 - d' u over u >= 0 island by island; return the largest natural residual.

    Parameters
    ----------
    starts, columns, G : ndarray, shapes (m + 1,), (k,), (k,)
        Scaled Delassus matrix, row after row, columns ascending.
    d, u : ndarray, shape (m,)
        Missing rates; percussions to start from, which are written over.
    label : ndarray of int, shape (m,)
        The island of each row; -1 of one that is left out, and gets none.
    count : int
        How many islands there are.
    target : float
        The residual that is enough.
    carried : float
        The part of u that a large island is started from where all of it does not fit.
    """
    m, worst = len(d), 0.0
    # rows sorted by island
    first, order, local = np.zeros(count + 1, np.int64), np.empty(m, np.int64), np.empty(m, np.uint32)
    for a in range(m):
        if label[a] >= 0:
            first[label[a] + 1] += 1
        else:
            u[a] = 0.0
    for island in range(count):
        first[island + 1] += first[island]
    fill = first[:count].copy()
    for a in range(m):
        if label[a] >= 0:
            local[a] = fill[label[a]] - first[label[a]]
            order[fill[label[a]]] = a
            fill[label[a]] += 1
    chosen, nothing, full_d, part = np.empty(_SMALL, np.bool_), np.zeros(_SMALL), np.empty(_SMALL), np.empty(_SMALL)
    for island in range(count):
        size, begin = first[island + 1] - first[island], first[island]
        residual, entries = 0.0, 0
        for i in range(size):
            a = order[begin + i]
            value = -d[a]
            for k in range(starts[a], starts[a + 1]):
                if label[columns[k]] >= 0:
                    value += G[k] * u[columns[k]]
                    entries += 1
            residual = max(residual, abs(min(u[a], value)))
        if size <= _SMALL:
            full = np.zeros((size, size))
            for i in range(size):
                a = order[begin + i]
                full_d[i] = d[a]
                for k in range(starts[a], starts[a + 1]):
                    if label[columns[k]] >= 0:
                        full[i, local[columns[k]]] = G[k]
            if exchange(full, full_d[:size], chosen[:size]) and settle(
                full, full_d[:size], chosen[:size], nothing[:size], part[:size]
            ):
                residual = 0.0
                for i in range(size):
                    part[i] = max(part[i], 0.0)
                for i in range(size):
                    value = -full_d[i]
                    for j in range(size):
                        value += full[i, j] * part[j]
                    residual = max(residual, abs(min(part[i], value)))
                    u[order[begin + i]] = part[i]
        if residual > target:
            own_starts, own_columns = np.empty(size + 1, np.uint32), np.empty(entries, np.uint32)
            own, own_d, own_u, entry = np.empty(entries), np.empty(size), np.empty(size), 0
            own_starts[0] = 0
            for i in range(size):
                a = order[begin + i]
                own_d[i], own_u[i] = d[a], carried * u[a]
                for k in range(starts[a], starts[a + 1]):
                    if label[columns[k]] >= 0:
                        own_columns[entry], own[entry] = local[columns[k]], G[k]
                        entry += 1
                own_starts[i + 1] = entry
            residual = relax(own_starts, own_columns, own, own_d, target, own_u)
            for i in range(size):
                u[order[begin + i]] = own_u[i]
        worst = max(worst, residual)
    return worst


class Large:
    """Projections of many rows one after the other, each started from the last.

    Parameters
    ----------
    exact : callable
        exact(x, metric, J, lower) -> velocity, percussion, residual: the projection of a few full rows.
    """

    def __init__(self, exact: Callable[[Array, Metric, Array, Array], tuple[Array, Array, float]]) -> None:
        self._exact = exact
        self._keys, self._last = np.zeros(0, np.int64), np.zeros(0)
        # what was projected last: within one step it is the same again, and percussions are carried in full
        self._x = np.zeros(0)
        self._room = 0

    def project(
        self, x: Array, metric: Metric, J: csr_array, lower: Array, residual: float, contacts: Array | None
    ) -> tuple[Array, Array, float]:
        """Return velocity, percussions and the relative KKT residual of what was reached; see `project`."""
        m, speed = len(lower), J @ x
        if not (speed < lower).any():
            return x, np.zeros(m), 0.0
        U = metric.whiten_rows(J)
        columns, starts = U.indices.astype(np.uint32), U.indptr.astype(np.uint32)
        row = np.repeat(np.arange(m), np.diff(starts))
        lengths = np.sqrt(np.bincount(row, U.data**2, minlength=m))
        unit = np.where(lengths > 0.0, lengths, 1.0)
        data, d = U.data / unit[row], (lower - speed) / unit
        largest = float(((np.abs(speed) + np.abs(lower)) / unit).max())
        keys = None if contacts is None else _keys(contacts)
        u = self._carried(keys, m) * unit
        able = lengths > 0.0
        watched, tried, label = able & _near(d, u), set[int](), None
        carried, self._x = 1.0 if x is self._x else _CARRIED, x
        while True:
            if label is None:
                target = _MARGIN * residual * largest
                label = self._solved(data, columns, starts, len(x), d, watched, target, carried, u)
                carried = 1.0
                few = np.bincount(label + 1)[label + 1] <= _SMALL
                enough = np.where(few, min(residual, _ROUNDED), residual) * largest
            velocity = x + metric.unwhiten(np.bincount(columns, data * u[row], minlength=len(x)))
            # judged by the velocity itself
            rate = (J @ velocity - lower) / unit
            off = np.abs(np.minimum(u, rate))
            missed = able & ~watched & (rate < 0.0)
            if missed.any() and off[missed].max() > enough[label >= 0].max(initial=0.0):
                watched, label = watched | missed, None
                continue
            wrong = (off > enough) & (label >= 0)
            bad = set(label[wrong].tolist()) - tried if wrong.any() else None
            if not bad:
                break
            U = csr_array((data, columns, starts), shape=J.shape)
            for island in bad:
                self._solve_exactly(U, d, np.flatnonzero(label == island), u)
            tried |= bad
        percussion = u / unit
        self._keep(keys, percussion)
        return velocity, percussion, float(off.max()) / largest

    def _solved(
        self,
        data: Array,
        columns: Array,
        starts: Array,
        n: int,
        d: Array,
        watched: Array,
        target: float,
        carried: float,
        u: Array,
    ) -> Array:
        """Solve for the watched rows; return the island of each, -1 of the others and of what repeats one."""
        here = np.flatnonzero(watched)
        if len(here) < len(d):
            sizes = np.diff(starts)
            entries = np.repeat(watched, sizes)
            data, columns = data[entries], columns[entries]
            starts = np.concatenate([[0], np.cumsum(sizes[here])]).astype(np.uint32)
        rows, others, G = self._gram(data, columns, starts, n)
        kept, part = ~_repeated(rows, others, G, d[here]), u[here]
        label, within = np.full(len(d), -1), np.empty(len(here), np.int64)
        count = islands(columns, starts, n, kept, within)
        _solve_islands(rows, others, G, d[here], within, count, target, carried, part)
        u[:] = 0.0
        u[here], label[here] = part, within
        return label

    def _solve_exactly(self, U: csr_array, d: Array, rows: Array, u: Array) -> None:
        """Solve one island as few rows are solved: where masses differ by many powers of ten, G has lost them."""
        if len(rows) > _MOST_EXACT:
            return
        part = U[rows]
        touched = np.unique(part.indices)
        J = np.ascontiguousarray(part[:, touched].toarray())
        try:
            u[rows] = self._exact(np.zeros(len(touched)), DiagonalMetric(np.ones(len(touched))), J, d[rows])[1]
        except ProjectionError:
            # judged with all others
            return

    def _gram(self, data: Array, columns: Array, starts: Array, n: int) -> tuple[Array, Array, Array]:
        """Return the Delassus matrix row after row: starts, columns, values."""
        rows = np.empty(len(starts), np.uint32)
        while True:
            others, G = np.empty(self._room, np.uint32), np.empty(self._room)
            count = gram(data, columns, starts, n, rows, others, G)
            if count <= self._room:
                return rows, others[:count], G[:count]
            self._room = int(1.2 * count)

    def _carried(self, keys: Array | None, m: int) -> Array:
        """Return the percussions of the same contacts in the last projection."""
        if keys is None:
            return self._last.copy() if len(self._last) == m and not len(self._keys) else np.zeros(m)
        if not len(self._keys):
            return np.zeros(m)
        place = np.searchsorted(self._keys, keys)
        place[place == len(self._keys)] = 0
        return np.where(self._keys[place] == keys, self._last[place], 0.0)

    def _keep(self, keys: Array | None, percussion: Array) -> None:
        if keys is None:
            self._keys, self._last = np.zeros(0, np.int64), percussion
            return
        if (keys[1:] < keys[:-1]).any():
            order = np.argsort(keys, kind="stable")
            keys, percussion = keys[order], percussion[order]
        self._keys, self._last = keys, percussion


def _keys(contacts: Array) -> Array:
    """Return a number for each row that it has in the next projection too: its constraint, and which point of it."""
    m = len(contacts)
    ascending = not (contacts[1:] < contacts[:-1]).any()
    order = None if ascending else np.argsort(contacts, kind="stable")
    numbers, place = contacts if order is None else contacts[order], np.arange(m)
    first = place.copy()
    first[1:][numbers[1:] == numbers[:-1]] = 0
    keys = numbers * _POINTS + np.minimum(place - np.maximum.accumulate(first), _POINTS - 1)
    if order is not None:
        keys[order] = keys.copy()
    return keys


def _near(d: Array, u: Array) -> Array:
    """Tell which rows may press: those that ask or did, and half as many that come next."""
    watched = (d > 0.0) | (u > 0.0)
    count = int((1.0 + _NEXT) * np.count_nonzero(watched))
    if count >= _MOST * len(d):
        return np.ones(len(d), bool)
    return watched | (d >= np.partition(d, len(d) - count)[len(d) - count])


def _repeated(starts: Array, columns: Array, G: Array, d: Array) -> Array:
    """Tell which rows are the same as another that asks for as much or more, shape (m,)."""
    repeated, same = np.zeros(len(d), bool), np.flatnonzero(G >= _SAME)
    if len(same) == len(d):
        # each is the same as itself
        return repeated
    a, b = np.searchsorted(starts, same, "right") - 1, columns[same].astype(np.int64)
    other = a != b
    a, b = a[other], b[other]
    repeated[a[(d[b] > d[a]) | ((d[b] == d[a]) & (b < a))]] = True
    return repeated


def contradictory(metric: Metric, J: csr_array, lower: Array, percussion: Array) -> bool:
    """Tell whether percussions show that no velocity meets J w >= lower: they sum to nothing and would do work."""
    pull = metric.whiten_rows(J)
    size = np.abs(pull.T @ percussion).max(initial=0.0)
    terms = (abs(pull).T @ percussion).max(initial=0.0)
    return bool(size <= 1e-6 * terms and lower @ percussion > 1e-6 * np.abs(lower) @ percussion)
