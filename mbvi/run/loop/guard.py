"""The tunnelling guard as a kernel: whether a body may pass through another in a step, as `TunnellingGuard` has it."""

from __future__ import annotations

import numpy as np

from ...compiled import kernel, record_at
from ...constraints.mechanism.meshes import ShapesAtMesh, is_clear_of_mesh, place_at_mesh
from ...constraints.mechanism.pairs import distance_of, is_beyond, place_bodies
from ...constraints.mechanism.rows import MechanismConstraints
from ...constraints.mechanism.tables import BALLS, PAIRS, SHAPES_AT_MESH, way_of
from ...constraints.mechanism.ways import relative_way
from ...geometry.at_meshes.cores_at_mesh import free_way, travel_from, write_place
from ...geometry.at_meshes.surface_rows import lowest_gap
from ...schemes.kernels.records import MechanismStep
from ...system.mechanisms.by_address.pinocchio_address import retract, tangent
from ...system.mechanisms.mechanism import place
from ...system.system import Array
from ..control_stability import TURN
from ..meeting import DEEP, DEPTH
from ..tunnelling import HALF_TURN, RUNAWAY
from .loop_record import LoopRecord

# configurations at which a pair is measured along a displacement
_MOST_MEASURED = 40
# most that all coordinates together move in a step whose ways are bounded by their chords [rad, m]
_MOST_TURNED = 1.0
# how much longer a way may be than its chord: an arc of 1 rad is by 4.3 %
_CURVED = 1.1
# component of a vector up to which its length is below `HALF_TURN`
_HALF_TURN = HALF_TURN / 3.0**0.5
# parts of a way along which a shape may be followed at a mesh
_MOST_PARTS = 64


@kernel("f8(MechanismConstraints, i8)")
def clearance_of(constraints: MechanismConstraints, pair: int) -> float:
    """Return a lower bound of the distance of a pair of shapes at the last query [m]."""
    cache, family = constraints.cache, constraints.pairs
    bound = family.clearance[pair]
    for f in range(len(cache.kind)):
        if cache.kind[f] == PAIRS:
            bound -= way_of(family, cache.travel[cache.slot[f]], pair)
    return bound


@kernel("f8(MechanismStep, LoopRecord, i8, f8[::1], f8[::1], f8, f8)")
def distance_after(
    s: MechanismStep, log: LoopRecord, pair: int, q: Array, displacement: Array, share: float, near: float
) -> float:  # fmt: skip
    """Return the distance of a pair of shapes after a share of a displacement; a lower bound if it is not near [m]."""
    drift, there = log.tangents[2], log.places[1]
    for k in range(len(displacement)):
        drift[k] = share * displacement[k]
    retract(s.mechanism.calls, q, drift, there)
    place(s.mechanism, there)
    place_bodies(s.mechanism, s.constraints.near)
    return distance_of(s.constraints.shapes, s.constraints.near, pair, near)


@kernel("b1(MechanismStep, LoopRecord, i8, f8[::1], f8[::1], f8)")
def may_touch(s: MechanismStep, log: LoopRecord, column: int, q: Array, displacement: Array, travel: float) -> bool:
    """Return whether a pair of shapes that could pass through each other may touch on a displacement, shape (nv,).

    `column` is its place among those that the guard looks at, and `travel` how far it moves relative to each other.

    The search (conservative advancement) takes steps within which the pair cannot touch. A pair that touches at the
    start counts if it sinks at once, or if it does not part and may get deep, as what tips over its contact point.
    """
    pair, thickness = log.member[column], log.thickness[column]
    near, share, level = max(s.scales.tolerance, 0.1 * DEPTH * thickness), 0.0, 0.0
    gap = distance_after(s, log, pair, q, displacement, 0.0, np.inf)
    if gap <= near:
        share = min(DEPTH * thickness / travel, 1.0)
        after = distance_after(s, log, pair, q, displacement, share, np.inf)
        if after - gap < -near:
            return True
        if after - gap < near:
            level = min(gap, 0.0) - DEEP * thickness
        gap = after
    for _ in range(_MOST_MEASURED):
        if not gap > level + near:
            return True
        share += (gap - level) / travel
        if share >= 1.0:
            return False
        gap = distance_after(s, log, pair, q, displacement, share, level + near)
    return True


@kernel("b1(MechanismStep, ShapesAtMesh, LoopRecord, i8, f8[::1], f8[::1], f8)")
def may_get_deep(
    s: MechanismStep, shapes: ShapesAtMesh, log: LoopRecord, member: int, q: Array, displacement: Array, depth: float
) -> bool:
    """Return whether a shape may get deeper into a mesh by a depth [m], or touch it and get so deep, on its way.

    A gap falls and rises by no more than the shape moves: with those at both ends of a part of the way it is bounded.
    A vertex over a ridge has no row until it touches: parts are so short that it is found before it is deep.
    """
    at, drift, there, before = shapes.at, log.tangents[2], log.places[1], np.empty((4, 3))
    place(s.mechanism, q)
    place_at_mesh(s.mechanism, shapes)
    write_place(at, shapes.places, member, before)
    first = shapes.places.copy()
    retract(s.mechanism.calls, q, displacement, there)
    place(s.mechanism, there)
    place_at_mesh(s.mechanism, shapes)
    travel = _CURVED * travel_from(at, before, shapes.places, member)
    # of what is apart it need not be known how far
    gap = min(lowest_gap(at, first, member, 0.0), 0.0)
    level = gap - depth
    # written so that a NaN counts as sunk
    if not travel < _MOST_PARTS * depth or gap == -np.inf:
        return True
    if free_way(at, first, member) > travel:
        return False
    parts = 1 + int(travel / depth)
    for part in range(1, parts + 1):
        for k in range(len(displacement)):
            drift[k] = displacement[k] * part / parts
        retract(s.mechanism.calls, q, drift, there)
        place(s.mechanism, there)
        place_at_mesh(s.mechanism, shapes)
        way = _CURVED * travel_from(at, before, shapes.places, member)
        end = min(lowest_gap(at, shapes.places, member, 0.0), 0.0)
        if not 0.5 * (gap + end - way) >= level:
            return True
        gap = end
        write_place(at, shapes.places, member, before)
    return False


@kernel("b1(MechanismStep, LoopRecord, i8, f8[::1], f8[::1], f8)")
def may_enter(s: MechanismStep, log: LoopRecord, column: int, q: Array, v: Array, h: float) -> bool:
    """Return whether a shape may get deep into a mesh in a step, from q, v; `column` is that of `may_touch`."""
    member, thickness, turned = log.member[column], log.thickness[column], 0.0
    # most are far from the mesh, or move less than the bound of their travel
    far = 2.0 * log.travel[column] * thickness
    shapes = record_at(s.constraints.shapes_at_mesh, s.constraints.meshes[log.family[column]])
    if is_clear_of_mesh(s.mechanism, shapes, s.constraints.cache.q, member, far):
        return False
    moved, middle = log.tangents[1], log.places[0]
    for k in range(len(v)):
        moved[k] = log.jump * h * v[k]
        turned += abs(h * v[k])
    # along such arcs ways are longer than their chords by more than `_CURVED`
    if not turned < _MOST_TURNED:
        return True
    if log.jump > 0.0 and may_get_deep(s, shapes, log, member, q, moved, DEEP * thickness):
        return True
    if log.jump == 1.0:
        return False
    retract(s.mechanism.calls, q, moved, middle)
    tangent(s.mechanism.calls, middle, s.q, moved)
    return may_get_deep(s, shapes, log, member, middle, moved, DEEP * thickness)


@kernel("void(f8[:,::1], f8[::1], f8[::1])")
def write_travels(shares: Array, speed: Array, travel: Array) -> None:
    """Write how far the bodies of each pair travel at most, in thicknesses, shape (m,)."""
    for i in range(len(travel)):
        travel[i] = 0.0
    for k in range(len(speed)):
        fast = speed[k]
        for i in range(len(travel)):
            travel[i] += shares[k, i] * fast


@kernel("void(MechanismStep, LoopRecord, f8[::1], f8[::1], f8, i8)")
def write_ways(s: MechanismStep, log: LoopRecord, q: Array, displacement: Array, length: float, part: int) -> None:
    """Write how far the pairs that travel their thickness move relative to each other along a part of a step.

    The part begins at q, and `length` is its length in steps.
    """
    placed = False
    for i in range(len(log.travel)):
        log.ways[part, i] = 0.0
        kind = s.constraints.cache.kind[log.family[i]] if log.family[i] >= 0 else -1
        if log.travel[i] < 1.0 or length == 0.0 or (kind != PAIRS and kind != BALLS):
            continue
        if not placed:
            place(s.mechanism, q)
            placed = True
        family = s.constraints.pairs if kind == PAIRS else s.constraints.touching
        way = relative_way(s.mechanism, family, log.member[i], log.pairs, i, displacement, 1.0 / length)
        log.ways[part, i] = length * way


@kernel("b1(LoopRecord, i8, i8)")
def is_swift(log: LoopRecord, pair: int, part: int) -> bool:
    """Return whether a pair moves its thickness in a step at the rate of one of its parts."""
    length = log.jump if part == 0 else 1.0 - log.jump
    # written so that a NaN counts as swift
    return not log.ways[part, pair] <= length * log.thickness[pair]


@kernel("b1(MechanismStep, LoopRecord, f8[::1], f8[::1], f8, f8)")
def may_pass(s: MechanismStep, log: LoopRecord, q: Array, v: Array, h: float, limit: float) -> bool:
    """Return whether a body may pass through another in a step, or a velocity runs away.

    Parameters
    ----------
    s : MechanismStep
        After the step; the mechanism may be placed where the constraints were queried last.
    log : LoopRecord
        With the shares of the guard.
    q, v : ndarray, shapes (nq,) and (nv,)
        The state before the step.
    h : float
        Length of the step [s].
    limit : float
        See `TunnellingGuard`.
    """
    n, pairs = log.shares.shape
    w, speed, middle, before, after, total, fastest = s.v, log.tangents[0], log.places[0], 0.0, 0.0, 0.0, 0.0
    for k in range(n):
        before += v[k] * v[k]
        after += w[k] * w[k]
        speed[k] = max(abs(v[k]), abs(w[k]))
        fastest = max(fastest, speed[k])
        if pairs > 0:
            total += log.share[k] * speed[k]
    # written so that a NaN counts as swift
    if not after < RUNAWAY:
        return True
    if before < limit and after < limit:
        return False
    if pairs == 0:
        return not fastest < log.slow_speed
    if total < 1.0:
        return False
    if h * fastest > TURN or (1.0 - log.jump) * h * fastest >= _HALF_TURN:
        # gains may be what turns it, and the way of what turns so far is not known from its ends
        return True
    travel, placed, moved = log.travel, False, log.tangents[1]
    write_travels(log.shares, speed, travel)
    for k in range(n):
        speed[k] = log.jump * h * v[k]
    write_ways(s, log, q, speed, log.jump, 0)
    retract(s.mechanism.calls, q, speed, middle)
    tangent(s.mechanism.calls, middle, s.q, moved)
    write_ways(s, log, middle, moved, 1.0 - log.jump, 1)
    for i in range(pairs):
        if travel[i] < 1.0:
            continue
        kind = s.constraints.cache.kind[log.family[i]] if log.family[i] >= 0 else -1
        if kind == SHAPES_AT_MESH:
            placed = False
            if may_enter(s, log, i, q, v, h):
                return True
            continue
        if kind != PAIRS and kind != BALLS:
            return True
        first, second = is_swift(log, i, 0), is_swift(log, i, 1)
        if not (first or second):
            continue
        if kind == BALLS:
            return True
        # a pair that is farther apart than it travels, there and back, does not pass
        far = 2.0 * (log.ways[0, i] + log.ways[1, i])
        if far < clearance_of(s.constraints, log.member[i]):
            continue
        if not placed:
            place(s.mechanism, s.constraints.cache.q)
            place_bodies(s.mechanism, s.constraints.near)
            placed = True
        if is_beyond(s.constraints.shapes, s.constraints.near, log.member[i], far):
            continue
        placed = False
        if first and may_touch(s, log, i, q, speed, log.ways[0, i]):
            return True
        if second and may_touch(s, log, i, middle, moved, log.ways[1, i]):
            return True
    return False
