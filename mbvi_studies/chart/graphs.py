"""The Hausdorff distance of graphs of velocities, which are polylines with jumps."""

from __future__ import annotations

import numpy as np

Array = np.ndarray

# points on each jump
_POINTS = 33
# points compared at once
_CHUNK = 64


def graph_distance(a: Array, b: Array) -> float:
    """Return the Hausdorff distance of two polylines.

    Parameters
    ----------
    a, b : ndarray, shapes (n, 1 + nv) and (m, 1 + nv)
        Vertices; the first column is time and does not decrease. Both begin and end at the same time.
    """
    return max(_farthest(a, b), _farthest(b, a))


def _farthest(line: Array, other: Array) -> float:
    """Return the largest distance of the vertices of a polyline, and of points on its jumps, from another one."""
    others, jump = _Segments(other), _jumps_of(line)
    near = others.nearest(line)
    farthest = others.largest(line, near, 0.0)
    # the distance from one segment is convex along a jump, so that its ends bound it
    both = np.concatenate([near[jump], near[jump + 1]], axis=1)
    ends = np.maximum(others.distances(line[jump], both), others.distances(line[jump + 1], both))
    points = _between(line, jump[ends.min(axis=1) > farthest])
    return others.largest(points, others.nearest(points), farthest)


class _Segments:
    """The segments of a polyline."""

    def __init__(self, line: Array) -> None:
        from scipy.spatial import cKDTree

        self._line, self._start, self._along = line, line[:-1], np.diff(line, axis=0)
        self._squared = np.einsum("ij,ij->i", self._along, self._along)
        jump, length = _jumps_of(line), np.sqrt(self._squared)
        self._squared[self._squared == 0.0] = 1.0
        # no jump of the tree is long without a point between
        long = jump[length[jump] > length[jump].mean()] if len(jump) else jump
        self._tree = cKDTree(np.concatenate([line, _between(line, long)]))
        self._segment = np.concatenate([np.arange(len(line)), np.tile(long, _POINTS)])

    def nearest(self, points: Array) -> Array:
        """Return two segments that meet near each point, shape (n, 2)."""
        nearest = self._segment[self._tree.query(points)[1]]
        return np.clip(nearest[:, None] + [-1, 0], 0, len(self._start) - 1)

    def distances(self, points: Array, segments: Array) -> Array:
        """Return the distances of each point from segments of its own, shape (n, k)."""
        offset, along = points[:, None] - self._start[segments], self._along[segments]
        share = np.clip(np.einsum("ijk,ijk->ij", offset, along) / self._squared[segments], 0.0, 1.0)
        offset -= share[:, :, None] * along
        return np.sqrt(np.einsum("ijk,ijk->ij", offset, offset))

    def largest(self, points: Array, near: Array, least: float) -> float:
        """Return the largest distance of points from the line, or `least` if that is larger; `near` bounds them."""
        bound, t = self.distances(points, near).min(axis=1), self._line[:, 0]
        order, farthest = np.argsort(-bound), least
        for first in range(0, len(order), _CHUNK):
            some = order[first : first + _CHUNK]
            if bound[some[0]] <= farthest:
                break
            # slightly wider, so that rounding does not exclude the nearest jump
            at, window = points[some, 0], 1.001 * bound[some] + 1e-9 * (t[-1] - t[0])
            low = np.maximum(np.searchsorted(t, at - window) - 1, 0)
            high = np.minimum(np.searchsorted(t, at + window, side="right"), len(self._start))
            segments = np.minimum(low[:, None] + np.arange(int((high - low).max())), high[:, None] - 1)
            farthest = max(farthest, float(self.distances(points[some], segments).min(axis=1).max()))
        return farthest


def _jumps_of(line: Array) -> Array:
    """Return the indices of the segments that take no time."""
    return np.flatnonzero((line[1:, 0] == line[:-1, 0]) & (line[1:] != line[:-1]).any(axis=1))


def _between(line: Array, jump: Array) -> Array:
    """Return points along some jumps, the ends included."""
    part = np.linspace(0.0, 1.0, _POINTS)[:, None, None]
    return ((1 - part) * line[jump] + part * line[jump + 1]).reshape(-1, line.shape[1])
