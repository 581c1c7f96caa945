"""The tunnelling guard as a kernel: whether a body may pass through another in a step, as `TunnellingGuard` has it."""

from __future__ import annotations

import numpy as np

from ...compiled import kernel, record_at
from ...constraints.mechanism.meshes import ShapesAtMesh, is_clear_of_mesh, place_at_mesh
from ...constraints.mechanism.pairs import distance_of, is_beyond, place_bodies
from ...constraints.mechanism.rows import MechanismConstraints
from ...constraints.mechanism.tables import PAIRS, SHAPES_AT_MESH, way_of
from ...geometry.at_meshes.cores_at_mesh import free_way, travel_from, write_place
from ...geometry.at_meshes.surface_rows import lowest_gap
from ...schemes.kernels.records import MechanismStep
from ...system.mechanisms.mechanism import place
from ...system.mechanisms.pinocchio_address import retract, tangent
from ...system.system import Array
from ..control_stability import TURN
from ..tunnelling import DEEP, DEPTH, HALF_TURN, RUNAWAY
from .loop_record import LoopRecord

# configurations at which a pair is measured along a displacement
_MOST_MEASURED = 40
# most that all coordinates together move in a step whose ways are bounded by their chords [rad, m]
_MOST_TURNED = 1.0
# how much longer a way may be than its chord: an arc of 1 rad is by 4.3 %
_CURVED = 1.1
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
def may_touch(s: MechanismStep, log: LoopRecord, column: int, q: Array, displacement: Array, length: float) -> bool:
    """Return whether a pair of shapes that could pass through each other may touch on a displacement, shape (nv,).

    `column` is its place among those that the guard looks at, and `length` that of the displacement in steps: pairs
    pass through each other in a whole one.

    The search (conservative advancement) takes steps within which the pair cannot touch. A pair that touches at the
    start counts only if it sinks.
    """
    travel, thickness, family, tolerance = 0.0, log.thickness[column], s.constraints.pairs, s.scales.tolerance
    pair = log.member[column]
    for i in range(family.begin[pair], family.begin[pair + 1]):
        travel += abs(displacement[family.velocity[i]]) * family.lever[i]
    if not travel > length * thickness:
        return False
    near, share = max(tolerance, 0.1 * DEPTH * thickness), 0.0
    gap = distance_after(s, log, pair, q, displacement, 0.0, np.inf)
    if gap <= tolerance:
        share = min(DEPTH * thickness / travel, 1.0)
        rise = distance_after(s, log, pair, q, displacement, share, np.inf) - gap
        if rise < near:
            return rise < -near
        gap += rise
    for _ in range(_MOST_MEASURED):
        if not gap > near:
            return True
        share += gap / travel
        if share >= 1.0:
            return False
        gap = distance_after(s, log, pair, q, displacement, share, near)
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
    if h * fastest > TURN or (1.0 - log.jump) * h * fastest >= HALF_TURN:
        # gains may be what turns it, and the way of what turns so far is not known from its ends
        return True
    travel, placed = log.travel, False
    write_travels(log.shares, speed, travel)
    for i in range(pairs):
        # a pair that is farther apart than it travels, there and back, does not pass
        far = 2.0 * travel[i] * log.thickness[i]
        if travel[i] < 1.0:
            continue
        kind = s.constraints.cache.kind[log.family[i]] if log.family[i] >= 0 else -1
        if kind == SHAPES_AT_MESH:
            placed = False
            if may_enter(s, log, i, q, v, h):
                return True
            continue
        if kind != PAIRS:
            return True
        if far < clearance_of(s.constraints, log.member[i]):
            continue
        if not placed:
            place(s.mechanism, s.constraints.cache.q)
            place_bodies(s.mechanism, s.constraints.near)
            placed = True
        if is_beyond(s.constraints.shapes, s.constraints.near, log.member[i], far):
            continue
        placed, moved = False, log.tangents[1]
        for k in range(n):
            moved[k] = log.jump * h * v[k]
        if may_touch(s, log, i, q, moved, log.jump):
            return True
        retract(s.mechanism.calls, q, moved, middle)
        tangent(s.mechanism.calls, middle, s.q, moved)
        if may_touch(s, log, i, middle, moved, 1.0 - log.jump):
            return True
    return False
