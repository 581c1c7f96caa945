"""Contacts of the pairs of shapes of one mechanism in one kernel, as `SignedDistances` finds them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...compiled import kernel, record
from ...geometry.broad.separating_axis import keep_normals, separated
from ...geometry.closed_form.primitive_pairs import NONE, primitive_contacts
from ...geometry.narrow.pair_contacts import write_contacts
from ...geometry.narrow.pair_distances import distances_from_axes
from ...geometry.shapes.seams import Seams, at_seam
from ...geometry.shapes.shape_table import Shapes
from ...system.mechanisms.mechanism import Mechanism
from ...system.mechanisms.separation import row
from ..rows import Array
from .tables import FOUND, MOST_ROWS, TOO_MANY, UNRESOLVED, PairFamily, RowBuffer, has_clearance, way_of

# contact points, most of them far from touching, for which there is room
MOST_CONTACTS = 512


@record(
    "i8[::1], f8[:,:,::1], f8[:,:,::1], i8[::1], i8[::1], i8[::1], f8[:,::1], i8[::1], b1[::1], b1[::1],"
    " f8[::1], f8[::1], i8, f8[::1], f8[::1], f8[:,::1], f8[:,::1], i8[::1], i8[::1], f8[::1], f8[:,::1], f8[:,::1],"
    " Seams"
)
class PairShapes(NamedTuple):
    """What the kernel needs of pairs beside the fields of `Shapes`, and room.

    Attributes
    ----------
    bodies : ndarray of int, shape (b,)
        The bodies whose placements the shapes need.
    places, rounded : ndarray, shape (b, 4, 3)
        Room for these, and for the same rounded.
    unresolved, closed, others : ndarray of int, shape (n,)
        Room for pairs.
    axis : ndarray, shape (n, 3)
        See `SeparatingAxes`.
    form : ndarray of int, shape (n,)
        See `PrimitivePairs`.
    smooth, flat : ndarray of bool, shape (n,)
        Pairs with a continuous gradient, and those that can share more than one point.
    bound : ndarray, shape (n,)
        See `write_contacts`.
    grid : ndarray, shape (4,)
        Placements are rounded to multiples of 1 / this, row by row.
    mode : int
        `AS_THEY_ARE`, `ROUNDED`, or `LEFT_TO_PYTHON`.
    bounds : ndarray, shape (n,)
        Room for what `separated` writes.
    distance, normal, middle, state : ndarray, shapes (n,), (n, 3), (n, 3) and (n,)
        Room for results of `distances_from_axes`.
    owner, gap, point, normals : ndarray, shapes (MOST_CONTACTS,) and (MOST_CONTACTS, 3)
        Room for contacts.
    seams : Seams
        Where fixed shapes touch each other.
    """

    bodies: Array
    places: Array
    rounded: Array
    unresolved: Array
    closed: Array
    others: Array
    axis: Array
    form: Array
    smooth: Array
    flat: Array
    bound: Array
    grid: Array
    mode: int
    bounds: Array
    distance: Array
    normal: Array
    middle: Array
    state: Array
    owner: Array
    gap: Array
    point: Array
    normals: Array
    seams: Seams


AS_THEY_ARE, ROUNDED, LEFT_TO_PYTHON = range(3)


@kernel("i8(f8[:,:,::1], Tuple(Shapes), PairShapes, f8, i8, i8)")
def measured_in_closed_form(
    places: Array, tables: tuple[Array, ...], pairs: PairShapes, tolerance: float, count: int, begin: int
) -> int:
    """Write the contacts of the first `count` of `closed` from place `begin` on; return their end, -1 without room."""
    shapes, room = Shapes(*tables), MOST_CONTACTS - begin
    total = primitive_contacts(
        places, shapes.frame, shapes.fixed, shapes.sizes, shapes.sides, pairs.form, pairs.closed[:count], tolerance,
        pairs.owner[begin:], pairs.gap[begin:], pairs.point[begin:], pairs.normals[begin:],
    )  # fmt: skip
    if total > room:
        return -1
    j = begin
    for i in range(count):
        pair = pairs.closed[i]
        while pairs.owner[j] != pair:
            j += 1
        keep_normals(places, shapes.frame, shapes.sides, pairs.axis, pairs.closed[i : i + 1], pairs.normals[j : j + 1])
    return begin + total


@kernel("i8(f8[:,:,::1], Tuple(Shapes), PairShapes, f8, i8)")
def measured_from_axes(
    places: Array, tables: tuple[Array, ...], pairs: PairShapes, tolerance: float, count: int
) -> int:
    """Write the contacts of the first `count` of `others`; return how many, -1 without room."""
    shapes, chosen = Shapes(*tables), pairs.others[:count]
    distance, normal, middle, state = (
        pairs.distance[:count],
        pairs.normal[:count],
        pairs.middle[:count],
        pairs.state[:count],
    )
    distances_from_axes(places, tables, pairs.bound, chosen, pairs.axis, tolerance, distance, normal, middle, state)
    keep_normals(places, shapes.frame, shapes.sides, pairs.axis, chosen, normal)
    return write_contacts(
        places, tables, pairs.bound, pairs.flat, chosen, tolerance, distance, normal, middle, state,
        pairs.owner, pairs.gap, pairs.point, pairs.normals,
    )  # fmt: skip


@kernel("void(Mechanism, PairShapes)")
def place_bodies(mechanism: Mechanism, pairs: PairShapes) -> None:
    """Write where the bodies of the shapes are."""
    places, poses = pairs.places, mechanism.poses
    for b in range(len(pairs.bodies)):
        for r in range(4):
            for c in range(3):
                places[b, r, c] = poses[pairs.bodies[b], r, c]


@kernel("f8(Tuple(Shapes), PairShapes, i8, f8)")
def distance_of(tables: tuple[Array, ...], pairs: PairShapes, pair: int, near: float) -> float:
    """Return the distance of a pair where `place_bodies` has placed the bodies; a lower bound if it is not near [m].

    The axis is kept.
    """
    places, chosen, shapes = pairs.places, pairs.others[:1], Shapes(*tables)
    chosen[0] = pair
    distances_from_axes(
        places, tables, pairs.bound, chosen, pairs.axis, near, pairs.distance[:1], pairs.normal[:1], pairs.middle[:1],
        pairs.state[:1],
    )  # fmt: skip
    keep_normals(places, shapes.frame, shapes.sides, pairs.axis, chosen, pairs.normal[:1])
    return pairs.distance[0]


@kernel("b1(Tuple(Shapes), PairShapes, i8, f8)")
def is_beyond(tables: tuple[Array, ...], pairs: PairShapes, pair: int, distance: float) -> bool:
    """Return whether a pair is farther apart than a distance [m] where `place_bodies` has placed the bodies.

    The axis that separates it is kept, so that the next time most need one evaluation.
    """
    chosen = pairs.others[:1]
    chosen[0] = pair
    if separated(pairs.places, tables, pairs.axis, chosen, distance, pairs.bounds, pairs.unresolved) == 0:
        return True
    return distance_of(tables, pairs, pair, distance) > distance


@kernel("b1(Shapes, PairShapes, i8)")
def is_hidden(shapes: Shapes, pairs: PairShapes, contact: int) -> bool:
    """Return whether a contact that was measured is none of the union of fixed shapes."""
    if len(pairs.seams.first_neighbour) == 0:
        return False
    first, second = shapes.sides[pairs.owner[contact], 0], shapes.sides[pairs.owner[contact], 1]
    first = first if shapes.frame[first] < 0 else -1
    second = second if shapes.frame[second] < 0 else -1
    return at_seam(pairs.seams, first, second, pairs.gap[contact], pairs.point[contact], pairs.normals[contact])


@kernel("void(PairFamily, i8[::1], f8[::1], i8)")
def add_ways(family: PairFamily, pairs: Array, ways: Array, count: int) -> None:
    """Add ways since the candidates were listed to the clearances of the first `count` pairs, which are those now."""
    for i in range(count):
        family.clearance[pairs[i]] += ways[i]


@kernel("Tuple((i8, b1))(Mechanism, Tuple(Shapes), PairShapes, PairFamily, f8[::1], f8, RowBuffer)")
def pair_contacts(
    mechanism: Mechanism, tables: tuple[Array, ...], pairs: PairShapes, family: PairFamily, travel: Array,
    tolerance: float, rows: RowBuffer,
) -> tuple[int, bool]:  # fmt: skip
    """Append the contacts of the candidates; return a code, and whether a candidate has none.

    Parameters
    ----------
    mechanism : Mechanism
        Placed where the rows are wanted.
    tables : tuple
        The fields of `Shapes`.
    pairs, family : PairShapes and PairFamily
        The pairs.
    travel : ndarray, shape (nv,)
        Sum of |displacement| since the candidates were listed; see `list_candidates`.
    tolerance : float
        Gap at and below which a pair is in contact [m].
    rows : RowBuffer
        The rows.
    """
    listed = family.listed[0]
    if listed == 0:
        return FOUND, False
    chosen, ways, count = np.empty(listed, np.int64), np.empty(listed), 0
    for i in range(listed):
        pair = family.candidates[i]
        way = way_of(family, travel, pair)
        if not has_clearance(family, pair, way, tolerance):
            chosen[count], ways[count] = pair, way
            count += 1
    if count == 0:
        return FOUND, True
    place_bodies(mechanism, pairs)
    places = pairs.places
    left = separated(places, tables, pairs.axis, chosen[:count], tolerance, family.clearance, pairs.unresolved)
    if left == 0:
        add_ways(family, chosen, ways, count)
        return FOUND, True
    if pairs.mode == LEFT_TO_PYTHON:
        return UNRESOLVED, True
    shapes, smooth, closed, others = Shapes(*tables), True, 0, 0
    for i in range(left):
        pair = pairs.unresolved[i]
        smooth = smooth and pairs.smooth[pair]
        if pairs.form[pair] != NONE:
            pairs.closed[closed] = pair
            closed += 1
        else:
            pairs.others[others] = pair
            others += 1
    if pairs.mode == ROUNDED and not smooth:
        for b in range(len(pairs.bodies)):
            for r in range(4):
                for c in range(3):
                    pairs.rounded[b, r, c] = np.rint(places[b, r, c] * pairs.grid[r]) * (1.0 / pairs.grid[r])
        places = pairs.rounded
    end = 0
    if others > 0:
        end = measured_from_axes(places, tables, pairs, tolerance, others)
        if end < 0:
            return UNRESOLVED, True
    middle, total = end, end
    if closed > 0:
        total = measured_in_closed_form(places, tables, pairs, tolerance, closed, end)
        if total < 0:
            return UNRESOLVED, True
    # both lists ascend; contacts go pair after pair
    i, j, any_empty = 0, middle, left < listed
    for k in range(left):
        pair = pairs.unresolved[k]
        family.clearance[pair], start = np.inf, j if pairs.form[pair] != NONE else i
        a, last = start, total if pairs.form[pair] != NONE else middle
        while a < last and pairs.owner[a] == pair:
            family.clearance[pair] = min(family.clearance[pair], pairs.gap[a])
            if pairs.gap[a] <= tolerance and not is_hidden(shapes, pairs, a):
                if rows.size[0] == MOST_ROWS:
                    return TOO_MANY, True
                append_contact(mechanism, family, pair, pairs.gap[a], pairs.point[a], pairs.normals[a], rows)
            a += 1
        if pairs.form[pair] != NONE:
            j = a
        else:
            i = a
        any_empty = any_empty or family.clearance[pair] > tolerance
    add_ways(family, chosen, ways, count)
    return FOUND, any_empty


@kernel("void(Mechanism, PairFamily, i8, f8, f8[::1], f8[::1], RowBuffer)")
def append_contact(
    mechanism: Mechanism, family: PairFamily, pair: int, gap: float, point: Array, normal: Array, rows: RowBuffer
) -> None:
    """Append a contact of a pair; point and normal have shape (3,)."""
    m = rows.size[0]
    first, second = mechanism.support[family.bodies[0, pair]], mechanism.support[family.bodies[1, pair]]
    row(mechanism.columns, first, second, point, normal, rows.J[m])
    for c in range(3):
        rows.point[m, c], rows.normal[m, c] = point[c], normal[c]
    rows.number[m], rows.gap[m], rows.e[m] = family.number[pair], gap, family.e[pair]
    rows.lever[m], rows.mu[m] = 1.0, family.mu[pair]
    rows.size[0] = m + 1
