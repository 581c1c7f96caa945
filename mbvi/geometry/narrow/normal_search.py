"""The separation d(n) = -h_1(n) - h_2(-n) of two convex shapes along a unit vector n, and its maximum on smooth parts.

h is the support function: the largest x . n of all points x of a shape. A shape is a Minkowski sum of segments, a disk
or an ellipsoid (here called a swell), a ball, and a hull of points (`separating_axis._support`). `n`, shape (3,), is a
unit vector from the first shape to the second.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...arguments import Array
from ...compiled import kernel, record
from ..vectors import cross, dot, normalise, within_plane

# directions with a smaller angle between them count as parallel [rad]
PARALLEL = 1e-9
# Newton steps, and the longest of them [rad]
_MOST_STEPS, _LONGEST = 40, 0.3
# a step below the first is the last one; after a step below the second, a falling value is due to rounding [rad]
_LAST_STEP, _SMALL_STEP = 1e-9, 1e-7


@record("f8[:,::1], f8[:,:,::1], f8[:,::1], f8[:,::1], f8[::1], f8, i8[::1], i8[::1]")
class Separation(NamedTuple):
    """The separation of two shapes, and the part of it that is smooth about some n.

    Attributes
    ----------
    edge : ndarray, shape (6, 3)
        Halves of the segments of both shapes, three each, as vectors [m]; zero where there is none.
    swell : ndarray, shape (2, 3, 3)
        Half axes of the ellipsoid or disk of each shape as vectors [m]; the third of a disk is zero.
    first, second : ndarray, shapes (k, 3)
        Points of the first shape about its origin, and those of the second times -1 [m].
    between : ndarray, shape (3,)
        The vector between the origins [m].
    ball : float
        The sum of the radii of the balls [m].
    sign : ndarray of int, shape (6,)
        The end of each segment, +1 or -1, that is nearest to the other shape.
    base : ndarray of int, shape (2,)
        The point of each hull that is nearest to the other shape; edges begin there.
    """

    edge: Array
    swell: Array
    first: Array
    second: Array
    between: Array
    ball: float
    sign: Array
    base: Array


@kernel("f8(f8[:,::1], f8[::1])")
def swell_along(axes: Array, n: Array) -> float:
    """Return the support function of an ellipsoid or disk of three half axes, shape (3, 3), along n [m]."""
    return np.sqrt(dot(axes[0], n) ** 2 + dot(axes[1], n) ** 2 + dot(axes[2], n) ** 2)


@kernel("i8(f8[:,::1], f8[::1])")
def farthest(points: Array, n: Array) -> int:
    """Return which of some points, shape (k, 3), is farthest along n."""
    best, far = 0, dot(points[0], n)
    for k in range(1, len(points)):
        along = dot(points[k], n)
        if along > far:
            best, far = k, along
    return best


@kernel("f8(f8[::1], Separation)")
def separation_along(n: Array, d: Separation) -> float:
    """Return d(n) [m]."""
    far = dot(d.first[farthest(d.first, n)], n) + dot(d.second[farthest(d.second, n)], n)
    far += swell_along(d.swell[0], n) + swell_along(d.swell[1], n)
    for k in range(6):
        far += abs(dot(d.edge[k], n))
    return dot(d.between, n) - d.ball - far


@kernel("i8(f8[:,::1], i8, f8[:,::1])")
def span(vectors: Array, count: int, basis: Array) -> int:
    """Write an orthonormal basis, shape (3, 3), of the first vectors, shape (k, 3); return its size."""
    rank = 0
    for i in range(count):
        if rank == 3:
            break
        b = basis[rank]
        for c in range(3):
            b[c] = vectors[i, c]
        whole = np.sqrt(dot(b, b))
        for _ in range(2):
            for k in range(rank):
                along = dot(b, basis[k])
                for c in range(3):
                    b[c] -= along * basis[k, c]
        if np.sqrt(dot(b, b)) > PARALLEL * whole:
            normalise(b)
            rank += 1
    return rank


@kernel("b1(f8[::1], f8[:,::1], i8)")
def make_normal(n: Array, basis: Array, rank: int) -> bool:
    """Make n normal to a basis of at most two vectors; return False if n lies in their span."""
    for k in range(rank):
        along = dot(n, basis[k])
        for c in range(3):
            n[c] -= along * basis[k, c]
    if not np.sqrt(dot(n, n)) > 1e-3:
        return False
    if rank == 2:
        only = np.empty(3)
        cross(basis[0], basis[1], only)
        side = 1.0 if dot(only, n) >= 0.0 else -1.0
        for c in range(3):
            n[c] = side * only[c]
    normalise(n)
    return True


@kernel("void(f8[::1], f8[:,:,::1], f8[::1], f8[:,::1], f8[::1])")
def gradient(n: Array, swell: Array, pull: Array, nearest: Array, slope: Array) -> None:
    """Write the point of each swell farthest along n, shape (2, 3), and the gradient of pull . n - their supports."""
    for c in range(3):
        slope[c] = pull[c]
    for i in range(2):
        reach = swell_along(swell[i], n)
        for c in range(3):
            nearest[i, c] = 0.0
        if reach > 0.0:
            for k in range(3):
                along = dot(swell[i, k], n) / reach
                for c in range(3):
                    nearest[i, c] += along * swell[i, k, c]
            for c in range(3):
                slope[c] -= nearest[i, c]


@kernel("void(f8[::1], f8[:,::1], i8, f8[:,::1])")
def _tangents(n: Array, basis: Array, rank: int, t: Array) -> None:
    """Write two unit vectors normal to n and to each other; if `rank` is 1, the first is also normal to the basis."""
    if rank == 1:
        cross(basis[0], n, t[0])
        normalise(t[0])
        cross(n, t[0], t[1])
    else:
        within_plane(n, t[0], t[1])


@kernel("b1(f8[::1], f8[::1], f8[:,:,::1], f8[:,::1], i8)")
def climb(n: Array, pull: Array, swell: Array, basis: Array, rank: int) -> bool:
    """Maximise pull . n - (supports of the swells) over unit vectors normal to a basis; return whether n is a maximum.

    Parameters
    ----------
    n : ndarray, shape (3,)
        Start of the search; receives the maximum.
    pull, basis : ndarray, shapes (3,) and (3, 3)
        The linear part [m], and orthonormal vectors in the first `rank` rows, at most one.
    """
    t, g, q, old = np.empty((2, 3)), np.empty(3), np.empty((2, 3)), np.empty(3)
    largest = 0.0
    for i in range(2):
        for k in range(3):
            for c in range(3):
                largest = max(largest, abs(swell[i, k, c]))
    size = np.sqrt(dot(pull, pull)) + largest
    step, value = 1.0, -np.inf
    for turn in range(_MOST_STEPS):
        gradient(n, swell, pull, q, g)
        new = dot(g, n)
        if turn > 0 and step < _SMALL_STEP and new <= value:
            return True
        if turn > 0 and new < value - 1e-14 * size:
            # too far: back by half
            for c in range(3):
                n[c] += old[c]
            normalise(n)
            continue
        value = new
        _tangents(n, basis, rank, t)
        # the negative Hessian in the tangents
        xx, xy, yy = value, 0.0, value
        for i in range(2):
            reach = swell_along(swell[i], n)
            if reach > 0.0:
                for k in range(4):
                    sign, axis = (1.0, swell[i, k]) if k < 3 else (-1.0, q[i])
                    x, y = dot(axis, t[0]), dot(axis, t[1])
                    xx, xy, yy = xx + sign * x * x / reach, xy + sign * x * y / reach, yy + sign * y * y / reach
        gx, gy = dot(g, t[0]), dot(g, t[1])
        if rank == 1:
            xy, gy, yy = 0.0, 0.0, max(xx, size)
        mean, apart = 0.5 * (xx + yy), np.sqrt(0.25 * (xx - yy) ** 2 + xy * xy)
        peak = mean - apart > 1e-10 * size
        if not peak:
            # no maximum about here: along the slope
            shift = apart - mean + 0.1 * max(abs(mean) + apart, 1e-3 * size)
            xx, yy = xx + shift, yy + shift
        det = xx * yy - xy * xy
        a, b = (yy * gx - xy * gy) / det, (xx * gy - xy * gx) / det
        step = np.sqrt(a * a + b * b)
        share = min(1.0, _LONGEST / max(step, 1e-300))
        for c in range(3):
            old[c] = n[c]
            n[c] += share * (a * t[0, c] + b * t[1, c])
        normalise(n)
        if step < _LAST_STEP and peak:
            return True
    return False
