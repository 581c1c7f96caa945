"""The active rows of one mechanism in one kernel.

The kernel does what `AdmissibleSet.active` does, on the same arrays: clearances and candidates of `ClearanceCache`, the
support points of `HalfSpaceContacts`, the axes of `SignedDistances`. The compiled loop calls it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...compiled import kernel, record, record_at
from ...geometry.narrow.support_points import Points, lowest, points_below, spread_below
from ...geometry.shapes.shape_table import Shapes  # noqa: F401  (a signature names it)
from ...system.mechanisms.by_address.pinocchio_address import tangent
from ...system.mechanisms.frames import turned
from ...system.mechanisms.mechanism import Mechanism, place
from ...system.mechanisms.separation import row, turning_row
from ..cache import IDLE, consume_clearance
from ..families.candidates import list_candidates
from ..rows import Array
from ..tangents import write_axes
from .balls import Balls, touching_balls
from .meshes import ShapesAtMesh, SpheresAtMesh, touching_shapes, touching_spheres
from .pairs import PairShapes, pair_contacts
from .row_callback import RowCallback, rows_by_callback
from .tables import (
    BALLS,
    BALLS_AT_MESH,
    FOUND,
    GIVEN,
    HALF_SPACES,
    LIMITS,
    MOST_ROWS,
    PAIRS,
    SHAPES_AT_MESH,
    TOO_MANY,
    Clearances,
    Limits,
    PairFamily,
    RowBuffer,
    has_clearance,
    way_of,
)


@record(
    "Clearances, Limits, Points, PairFamily, Tuple(Shapes), PairFamily, PairShapes, Balls, PairFamily, RowCallback,"
    " SpheresAtMesh, ShapesAtMesh, i8[::1], f8[:,::1]"
)
class MechanismConstraints(NamedTuple):
    """The constraints of one mechanism: joint limits, half-spaces with their points, pairs with shapes and axes, balls.

    `touching` has the numbers of `SphereContacts`, which are not those of pairs one after the other. Rows of `given`
    functions come by a callback. `meshes`, shape (families,), has the addresses of spheres and of shapes at meshes, of
    which `spheres_at_mesh` and `shapes_at_mesh` are some; 0 for other families. `planes` are those of
    `HalfSpacesOnBodies`; of no size where half-spaces are fixed to the world.
    """

    cache: Clearances
    limits: Limits
    points: Points
    walls: PairFamily
    shapes: tuple[Array, ...]
    pairs: PairFamily
    near: PairShapes
    balls: Balls
    touching: PairFamily
    given: RowCallback
    spheres_at_mesh: SpheresAtMesh
    shapes_at_mesh: ShapesAtMesh
    meshes: Array
    planes: Array


@kernel("Tuple((i8, f8))(Limits, i8, f8[::1], f8, RowBuffer)")
def limit_rows(limits: Limits, family: int, q: Array, tolerance: float, rows: RowBuffer) -> tuple[int, float]:
    """Append the limits of a family within a tolerance [m].

    Return a code, and how far gaps may fall before the next query [m].
    """
    nearest, nv = np.inf, rows.J.shape[1]
    for a in range(limits.begin[family], limits.begin[family + 1]):
        gap = limits.sign[a] * q[limits.position[a]] + limits.offset[a]
        nearest = min(nearest, limits.lever[a] * gap)
        if limits.lever[a] * gap <= tolerance:
            m = rows.size[0]
            if m == MOST_ROWS:
                return TOO_MANY, -np.inf
            rows.number[m], rows.gap[m], rows.e[m] = limits.number[a], gap, limits.e[a]
            rows.lever[m], rows.mu[m] = limits.lever[a], 0.0
            for c in range(3):
                rows.point[m, c] = rows.normal[m, c] = np.nan
            for k in range(nv):
                rows.J[m, k] = 0.0
            rows.J[m, limits.velocity[a]] = limits.sign[a]
            rows.size[0] = m + 1
    # a row must be found at every step, so that no step can be skipped while there is one
    return FOUND, -np.inf if nearest <= tolerance else nearest - tolerance


@kernel("Tuple((i8, b1))(f8[:,:,::1], f8[:,::1], f8[:,::1], Points, PairFamily, f8[::1], f8, RowBuffer)")
def half_space_contacts(
    poses: Array, columns: Array, support: Array, points: Points, family: PairFamily, travel: Array, tolerance: float,
    rows: RowBuffer,
) -> tuple[int, bool]:  # fmt: skip
    """Append the contacts of the candidates with half-spaces; return a code, and whether a candidate has none.

    Parameters
    ----------
    poses, columns, support
        See `Kinematics`.
    points : Points
        The support points of the shapes.
    family : PairFamily
        The pairs.
    travel : ndarray, shape (nv,)
        Sum of |displacement| since the candidates were listed; see `list_candidates`.
    tolerance : float
        Gap at and below which a point is a contact [m].
    rows : RowBuffer
        The rows.
    """
    any_empty, out = False, points.out
    for i in range(family.listed[0]):
        pair = family.candidates[i]
        way = way_of(family, travel, pair)
        if has_clearance(family, pair, way, tolerance):
            any_empty = True
            continue
        count, least = points_below(poses, points, pair, tolerance, 0)
        family.clearance[pair] = least + way
        any_empty = any_empty or count == 0
        count = spread_below(poses, points, pair, tolerance, 0, count)
        if rows.size[0] + count > MOST_ROWS:
            return TOO_MANY, True
        for j in range(count):
            m, k = rows.size[0], points.found[j]
            lowest(poses, points.body[pair], points.numbers, k, out)
            for c in range(3):
                rows.point[m, c], rows.normal[m, c] = out[c], points.numbers[k, 12 + c]
            first = support[family.bodies[0, pair]]
            row(columns, first, support[points.body[pair]], out, points.numbers[k, 12:15], rows.J[m])
            rows.number[m], rows.gap[m], rows.e[m] = family.number[pair], out[3], family.e[pair]
            rows.lever[m], rows.mu[m] = 1.0, family.mu[pair]
            rows.size[0] = m + 1
    return FOUND, any_empty


@kernel("void(f8[:,:,::1], i8[:,::1], f8[:,::1], Points)")
def turn_half_spaces(poses: Array, bodies: Array, planes: Array, points: Points) -> None:
    """Write the normals and offsets of half-spaces that are fixed to bodies, where these are.

    Parameters
    ----------
    poses
        See `Kinematics`.
    bodies, planes
        See `PairFamily` and `HalfSpacesOnBodies`.
    points : Points
        The support points of the shapes.
    """
    for pair in range(len(planes)):
        pose, plane = poses[bodies[0, pair]], planes[pair]
        x, y, z = turned(pose, plane[0], plane[1], plane[2])
        offset = plane[3] + x * pose[3, 0] + y * pose[3, 1] + z * pose[3, 2]
        for k in range(points.begin[pair], points.begin[pair + 1]):
            numbers = points.numbers[k]
            numbers[12], numbers[13], numbers[14], numbers[16] = x, y, z, numbers[15] + offset


@kernel("void(f8[:,::1], f8[:,::1], PairFamily, i8, RowBuffer)")
def append_tangents(columns: Array, support: Array, family: PairFamily, begin: int, rows: RowBuffer) -> None:
    """Write the gradients along the tangents of the rows of one family, from row `begin` on; none where mu is 0."""
    end, nv, rough = rows.size[0], rows.J.shape[1], False
    for a in range(begin, end):
        rough = rough or rows.mu[a] > 0.0
    if rough:
        write_axes(rows.normal[begin:end], rows.axes[begin:end])
    for a in range(begin, end):
        for c in range(2):
            if rough:
                pair = rows.number[a] - family.number[0]
                first, second = support[family.bodies[0, pair]], support[family.bodies[1, pair]]
                row(columns, first, second, rows.point[a], rows.axes[a, c], rows.T[2 * a + c])
            else:
                for k in range(3):
                    rows.axes[a, c, k] = 1.0 if k == c else 0.0
                for k in range(nv):
                    rows.T[2 * a + c, k] = 0.0
        if len(rows.R) > 0:
            pair = rows.number[a] - family.number[0] if rough else -1
            write_rotations(columns, support, family, pair, rows, a)


@kernel("void(f8[:,::1], f8[:,::1], PairFamily, i8, RowBuffer, i8)")
def write_rotations(columns: Array, support: Array, family: PairFamily, pair: int, rows: RowBuffer, a: int) -> None:
    """Write the lengths of torsional and rolling friction of row a, and the gradients of what they resist.

    `pair` is its number in the family, -1 where it has no tangents.
    """
    resists = False
    for c in range(2):
        rows.resistance[a, c] = family.resistance[pair, c] if pair >= 0 and rows.mu[a] > 0.0 else 0.0
        resists = resists or rows.resistance[a, c] > 0.0
    for c in range(3):
        if resists:
            first, second = support[family.bodies[0, pair]], support[family.bodies[1, pair]]
            axis = rows.normal[a] if c == 0 else rows.axes[a, c - 1]
            turning_row(columns, first, second, axis, rows.R[3 * a + c])
        else:
            for k in range(rows.R.shape[1]):
                rows.R[3 * a + c, k] = 0.0


@kernel("void(Mechanism, PairFamily, RowBuffer, i8)")
def write_gradient_of(mechanism: Mechanism, family: PairFamily, rows: RowBuffer, a: int) -> None:
    """Write the gradients of row a if it is one of a family; see `write_gradients`."""
    pair = rows.number[a] - family.number[0] if len(family.number) > 0 else -1
    if 0 <= pair < len(family.number):
        first, second = mechanism.support[family.bodies[0, pair]], mechanism.support[family.bodies[1, pair]]
        row(mechanism.columns, first, second, rows.point[a], rows.normal[a], rows.J[a])
        if len(rows.T) > 0 and rows.mu[a] > 0.0:
            for c in range(2):
                row(mechanism.columns, first, second, rows.point[a], rows.axes[a, c], rows.T[2 * a + c])
        if len(rows.R) > 0:
            write_rotations(mechanism.columns, mechanism.support, family, pair, rows, a)


@kernel("void(Mechanism, MechanismConstraints, RowBuffer, i8)")
def write_gradients(mechanism: Mechanism, constraints: MechanismConstraints, rows: RowBuffer, a: int) -> None:
    """Write the gradients of row a for where the mechanism is placed, unless it is a joint limit.

    Its point, normal and tangents are as they stand.
    """
    for k in range(len(constraints.cache.kind)):
        kind = constraints.cache.kind[k]
        if kind == HALF_SPACES:
            write_gradient_of(mechanism, constraints.walls, rows, a)
        elif kind == PAIRS:
            write_gradient_of(mechanism, constraints.pairs, rows, a)
        elif kind == BALLS:
            write_gradient_of(mechanism, constraints.touching, rows, a)
        elif kind == BALLS_AT_MESH:
            write_gradient_of(mechanism, record_at(constraints.spheres_at_mesh, constraints.meshes[k]).family, rows, a)
        elif kind == SHAPES_AT_MESH:
            write_gradient_of(mechanism, record_at(constraints.shapes_at_mesh, constraints.meshes[k]).family, rows, a)


@kernel("i8(Mechanism, MechanismConstraints, f8[::1], f8[::1], f8[::1], f8, RowBuffer)")
def active_rows(
    mechanism: Mechanism, constraints: MechanismConstraints, origin: Array, displacement: Array, q: Array,
    tolerance: float, rows: RowBuffer,
) -> int:  # fmt: skip
    """Find the rows within a tolerance, family by family; return a code.

    Where the code is not `FOUND`, the caches are such that `AdmissibleSet.active` finds the rows.

    Parameters
    ----------
    mechanism : Mechanism
        The mechanism.
    constraints : MechanismConstraints
        The constraints.
    origin, displacement, q, tolerance
        See `AdmissibleSet.active`, where these are origin, moved, q and tolerance.
    rows : RowBuffer
        Receives the rows.
    """
    cache, walls = constraints.cache, constraints.walls
    same, code = len(origin) == len(q), FOUND
    for i in range(len(origin)):
        same = same and origin[i] == cache.q[i]
    moved = cache.moved
    if same:
        for i in range(len(moved)):
            moved[i] = displacement[i]
    else:
        tangent(mechanism.calls, cache.q, q, moved)
    for i in range(len(q)):
        cache.q[i] = q[i]
    exhausted = consume_clearance(moved, cache.envelope, cache.travel, cache.clearance, tolerance)
    rows.size[0], frictional = 0, len(rows.T) > 0
    for k in range(len(cache.kind)):
        kind, slot, begin, spent, any_empty = cache.kind[k], cache.slot[k], rows.size[0], True, False
        if slot >= 0:
            spent = exhausted >> slot & 1 > 0
            if not (spent or cache.always[slot]):
                continue
            if code != FOUND:
                # the query of this family is left to Python
                cache.clearance[slot] = -np.inf
        if code != FOUND:
            continue
        if kind == GIVEN:
            code = rows_by_callback(constraints.given, k, q, tolerance, rows)
            continue
        family = constraints.pairs if kind == PAIRS else constraints.touching if kind == BALLS else walls
        if kind == LIMITS:
            code, clearance = limit_rows(constraints.limits, k, q, tolerance, rows)
            cache.clearance[slot] = clearance + tolerance
        elif kind == BALLS:
            code = touching_balls(mechanism, constraints.balls, family, q, tolerance, rows)
        elif kind == BALLS_AT_MESH:
            spheres = record_at(constraints.spheres_at_mesh, constraints.meshes[k])
            family, code = spheres.family, touching_spheres(mechanism, spheres, q, tolerance, rows)
        elif kind == SHAPES_AT_MESH:
            shapes = record_at(constraints.shapes_at_mesh, constraints.meshes[k])
            family, code = shapes.family, touching_shapes(mechanism, shapes, q, tolerance, rows)
        else:
            place(mechanism, q)
            if spent:
                count, least = list_candidates(
                    family.clearance, family.reach, cache.travel[slot], tolerance, family.candidates
                )
                family.listed[0], cache.clearance[slot], cache.always[slot] = count, least + tolerance, count > 0
            if kind == HALF_SPACES:
                if len(constraints.planes) > 0:
                    turn_half_spaces(mechanism.poses, family.bodies, constraints.planes, constraints.points)
                code, any_empty = half_space_contacts(
                    mechanism.poses, mechanism.columns, mechanism.support, constraints.points, family,
                    cache.travel[slot], tolerance, rows,
                )  # fmt: skip
            else:
                code, any_empty = pair_contacts(
                    mechanism, constraints.shapes, constraints.near, family, cache.travel[slot], tolerance, rows
                )
            if code != FOUND:
                cache.clearance[slot] = -np.inf
        if frictional and code == FOUND:
            append_tangents(mechanism.columns, mechanism.support, family, begin, rows)
        if code == FOUND and (kind == HALF_SPACES or kind == PAIRS):
            family.listed[1] = family.listed[1] + 1 if any_empty else 0
            if family.listed[1] == IDLE:
                # a candidate without a row may be skipped: list the candidates again at the next query
                cache.clearance[slot], family.listed[1] = -np.inf, 0
    return code
