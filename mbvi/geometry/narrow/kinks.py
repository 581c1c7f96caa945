"""The active set of kinks in the search for the separating normal n of two convex shapes (`refined_distance`).

The separation d(n) of `normal_search` has no derivative at a kink: where n is normal to a segment or to an edge of a
hull, or along the axis of a disk. Its maximum mostly lies on kinks. The search keeps n on the active kinks, as other
active-set methods keep a point on active constraints. The multiplier of an active kink says where on the segment, edge
or disk the nearest point lies; if it is out of bounds, the kink is released. Arguments that kernels here and in
`refined_distance` share:

d : Separation
    The separation of the two shapes.
kinks, count : ndarray of int, shape (3, 3), and int
    The active kinks, in the first `count` rows: the kind, the number of the segment or shape, and for an edge the
    vertex at its far end.
found, basis : ndarray, shapes (6, 3), (3, 3)
    The vectors that active kinks keep n normal to, and an orthonormal basis of them.
"""

from __future__ import annotations

import numpy as np

from ...arguments import Array
from ...compiled import kernel
from ..vectors import dot, normalise
from .normal_search import PARALLEL, Separation, make_normal, separation_along, span, swell_along

# angle within which kinks enter the first active set, and by which n is turned away from a disk that is released [rad]
NEAR_KINK = 1e-3
# rounding of angles, and of multipliers relative to their bounds
ROUNDING = 1e-12
# kinds of kinks: normal to a segment, along the axis of a disk, normal to an edge of a hull
SEGMENT, DISK, EDGE = 0, 1, 2


@kernel("b1(i8[:,::1], i8, i8, i8, i8)")
def has(kinks: Array, count: int, kind: int, who: int, vertex: int) -> bool:
    """Return whether a kink is active."""
    for i in range(count):
        if kinks[i, 0] == kind and kinks[i, 1] == who and kinks[i, 2] == vertex:
            return True
    return False


@kernel("b1(f8[:,::1])")
def is_disk(axes: Array) -> bool:
    """Return whether half axes, shape (3, 3), are those of a disk."""
    return dot(axes[2], axes[2]) == 0.0 and dot(axes[0], axes[0]) > 0.0


@kernel("f8(f8[:,::1], i8, i8, f8[::1])")
def _rise(points: Array, start: int, end: int, n: Array) -> float:
    """Return the cosine of the angle between n and the vector from one point to another, -1 where these coincide."""
    rise = square = 0.0
    for c in range(3):
        along = points[end, c] - points[start, c]
        rise, square = rise + along * n[c], square + along * along
    return rise / np.sqrt(square) if square > 0.0 else -1.0


@kernel("i8(i8[:,::1], i8, Separation, f8[:,::1])")
def directions(kinks: Array, count: int, d: Separation, found: Array) -> int:
    """Write the vectors that active kinks keep n normal to; return how many."""
    n = 0
    for k in range(count):
        kind, who, vertex = kinks[k, 0], kinks[k, 1], kinks[k, 2]
        for c in range(3):
            if kind == SEGMENT:
                found[n, c] = d.edge[who, c]
            elif kind == DISK:
                found[n, c], found[n + 1, c] = d.swell[who, 0, c], d.swell[who, 1, c]
            elif who == 0:
                found[n, c] = d.first[vertex, c] - d.first[d.base[0], c]
            else:
                found[n, c] = d.second[vertex, c] - d.second[d.base[1], c]
        n += 2 if kind == DISK else 1
    return n


@kernel("i8(f8[::1], i8[:,::1], i8, Separation, f8[:,::1], f8[:,::1])")
def turn_onto(n: Array, kinks: Array, count: int, d: Separation, found: Array, basis: Array) -> int:
    """Turn n onto kinks; return how many independent directions it is normal to there, -1 if it cannot be turned."""
    m = directions(kinks, count, d, found)
    if span(found, m, basis) < m or m > 2 or not make_normal(n, basis, m):
        return -1
    return m


@kernel("b1(f8[::1], f8, b1, i8[::1], i8[:,::1], i8, Separation)")
def next_kink(n: Array, within: float, disks: bool, kink: Array, kinks: Array, count: int, d: Separation) -> bool:
    """Write an inactive kink; return whether there is one.

    It is the one that n has crossed farthest, by more than -`within` [rad]. If n has crossed none and `within` is
    positive, it is the nearest one. Disks are searched only if `disks` is True.
    """
    best, found = within, False
    for k in range(6):
        length = np.sqrt(dot(d.edge[k], d.edge[k]))
        if length > 0.0 and not has(kinks, count, SEGMENT, k, 0):
            angle = d.sign[k] * dot(d.edge[k], n) / length
            if angle < best:
                best, found = angle, True
                kink[0], kink[1], kink[2] = SEGMENT, k, 0
    for who in range(2):
        points, base = d.first if who == 0 else d.second, d.base[who]
        for v in range(len(points)):
            if v != base and not has(kinks, count, EDGE, who, v):
                angle = -_rise(points, base, v, n)
                if angle < best:
                    best, found = angle, True
                    kink[0], kink[1], kink[2] = EDGE, who, v
        if disks and is_disk(d.swell[who]):
            angle = swell_along(d.swell[who], n) / np.sqrt(dot(d.swell[who, 0], d.swell[who, 0]))
            if angle < best:
                best, found = angle, True
                kink[0], kink[1], kink[2] = DISK, who, 0
    return found


@kernel("i8(f8[::1], i8, Separation, f8[:,::1])")
def _flat_directions(n: Array, who: int, d: Separation, basis: Array) -> int:
    """Write an orthonormal basis of the straight directions of one shape that n is normal to; return its size."""
    found, m, points, base = np.empty((8, 3)), 0, d.first if who == 0 else d.second, d.base[who]
    for k in range(3 * who, 3 * who + 3):
        length = np.sqrt(dot(d.edge[k], d.edge[k]))
        if length > 0.0 and abs(dot(d.edge[k], n)) <= PARALLEL * length:
            for c in range(3):
                found[m, c] = d.edge[k, c]
            m += 1
    if is_disk(d.swell[who]):
        radius = np.sqrt(dot(d.swell[who, 0], d.swell[who, 0]))
        if swell_along(d.swell[who], n) <= PARALLEL * radius:
            for c in range(3):
                found[m, c], found[m + 1, c] = d.swell[who, 0, c], d.swell[who, 1, c]
            m += 2
    for v in range(len(points)):
        # a few edges tell the plane of a face
        if m < 8 and v != base and abs(_rise(points, base, v, n)) <= PARALLEL:
            for c in range(3):
                found[m, c] = points[v, c] - points[base, c]
            m += 1
    return span(found, m, basis)


@kernel("i8(f8[::1], Separation, f8[::1])")
def common_directions(n: Array, d: Separation, common: Array) -> int:
    """Return the number of independent directions along which both shapes are straight at n.

    If it is not zero, the nearest points are not unique. A single direction is written to `common`, shape (3,).
    """
    one, other, both, basis = np.empty((3, 3)), np.empty((3, 3)), np.empty((6, 3)), np.empty((3, 3))
    a = _flat_directions(n, 0, d, one)
    b = _flat_directions(n, 1, d, other) if a else 0
    if a == 0 or b == 0:
        return 0
    for c in range(3):
        for i in range(a):
            both[i, c] = one[i, c]
        for i in range(b):
            both[a + i, c] = other[i, c]
    # the directions normal to n have two dimensions
    count = a + b - min(span(both, a + b, basis), 2)
    if count == 1:
        for c in range(3):
            common[c] = one[0, c] if a == 1 else other[0, c]
    return count


@kernel("void(f8[::1], f8[:,::1], i8, f8[::1])")
def multipliers(slope: Array, found: Array, m: int, t: Array) -> None:
    """Write the coefficients t of a slope that is a linear combination of one or two vectors."""
    if m == 1:
        t[0] = dot(slope, found[0]) / dot(found[0], found[0])
    elif m == 2:
        aa, ab, bb = dot(found[0], found[0]), dot(found[0], found[1]), dot(found[1], found[1])
        a, b = dot(slope, found[0]), dot(slope, found[1])
        det = aa * bb - ab * ab
        t[0], t[1] = (bb * a - ab * b) / det, (aa * b - ab * a) / det


@kernel("i8(f8[::1], f8[::1], f8[:,::1], i8[:,::1], i8, f8[::1])")
def clear_common(slope: Array, common: Array, found: Array, kinks: Array, count: int, t: Array) -> int:
    """Write the multipliers of two active kinks if one of them is along the common direction; return 1 then, else 0.

    Its multiplier is not unique. Zero, which is within bounds, is written for it, so that this kink stays active.
    """
    if count != 2 or kinks[0, 0] == DISK or kinks[1, 0] == DISK:
        return 0
    for i in range(2):
        length = np.sqrt(dot(found[i], found[i]))
        if abs(dot(found[i], common)) >= (1.0 - PARALLEL) * length:
            multipliers(slope, found, 2, t)
            t[i] = 0.0
            return 1
    return 0


@kernel("i8(f8[::1], f8[::1], i8[::1], i8[:,::1], i8, Separation)")
def add(n: Array, scratch: Array, kink: Array, kinks: Array, count: int, d: Separation) -> int:
    """Add a kink to the active ones; return their number, or -1 if that is impossible.

    If n cannot lie on all of them, another is released: the one without which d is largest.
    """
    found, basis, trial = np.empty((6, 3)), np.empty((3, 3)), np.empty((3, 3), np.int64)
    for c in range(3):
        kinks[count, c], scratch[c] = kink[c], n[c]
    if turn_onto(scratch, kinks, count + 1, d, found, basis) >= 0:
        return count + 1
    best, chosen = -np.inf, -1
    for out in range(count):
        size = 0
        for i in range(count + 1):
            if i != out:
                for c in range(3):
                    trial[size, c] = kinks[i, c]
                size += 1
        for c in range(3):
            scratch[c] = n[c]
        if turn_onto(scratch, trial, size, d, found, basis) < 0:
            continue
        apart = separation_along(scratch, d)
        if apart > best:
            best, chosen = apart, out
    if chosen < 0:
        return -1
    if kinks[chosen, 0] == SEGMENT:
        k = kinks[chosen, 1]
        d.sign[k] = 1 if dot(d.edge[k], n) >= 0.0 else -1
    for i in range(chosen, count):
        for c in range(3):
            kinks[i, c] = kinks[i + 1, c]
    return count


@kernel("i8(f8[::1], f8[::1], f8[:,::1], i8[:,::1], i8, Separation, b1[::1])")
def release(n: Array, t: Array, found: Array, kinks: Array, count: int, d: Separation, left: Array) -> int:
    """Release the active kink whose multiplier is farthest out of its bounds, if any; return how many stay active.

    When a disk is released, n is turned off its axis, and the disk is marked in `left`, shape (2,) of bool.
    """
    worst, out, sums = ROUNDING, -1, np.empty(2)
    sums[0] = sums[1] = 0.0
    for i in range(count):
        over = abs(t[i]) - 1.0
        if kinks[i, 0] == DISK:
            over = np.sqrt(t[0] ** 2 + t[1] ** 2) - 1.0
        elif kinks[i, 0] == EDGE:
            over = -t[i]
            sums[kinks[i, 1]] += t[i]
        if over > worst:
            worst, out = over, i
    for i in range(count):
        # the nearest point is beyond where the edges begin: they begin at the end of one of them
        if kinks[i, 0] == EDGE and sums[kinks[i, 1]] - 1.0 > worst:
            worst, out = sums[kinks[i, 1]] - 1.0, i
            d.base[kinks[i, 1]] = kinks[i, 2]
    if out < 0:
        return count
    if kinks[out, 0] == SEGMENT:
        d.sign[kinks[out, 1]] = 1 if t[out] > 0.0 else -1
    elif kinks[out, 0] == DISK:
        left[kinks[out, 1]] = True
        towards = np.sqrt((t[0] ** 2 + t[1] ** 2) * dot(found[0], found[0]))
        for c in range(3):
            n[c] += NEAR_KINK * (t[0] * found[0, c] + t[1] * found[1, c]) / towards
        normalise(n)
    for i in range(out, count - 1):
        for c in range(3):
            kinks[i, c] = kinks[i + 1, c]
    return count - 1
