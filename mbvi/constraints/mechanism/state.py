"""The constraints of one mechanism as the compiled loop takes them; it shares the arrays of their caches."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache, cached_property
from typing import Any, cast

import numpy as np

from ...compiled import held, record_at
from ...geometry.meshes.triangles import Surface
from ...geometry.shapes.shape_table import Shapes, ShapeTable
from ...system import System
from ..admissible_set import AdmissibleSet
from ..families.given import GivenConstraint, GivenRows
from ..families.half_space import HalfSpaceContacts
from ..families.hinge_limit import HingeLimits
from ..families.joint_limit import JointLimits
from ..families.shape_surface import ShapeSurface
from ..families.signed_distance import SignedDistances
from ..families.spheres import SphereContacts
from ..families.surface import SphereSurface
from ..family import ConstraintFamily
from ..rows import Array
from .balls import Balls
from .meshes import ShapesAtMesh, SpheresAtMesh
from .row_callback import RowCallback
from .rows import MechanismConstraints
from .tables import (
    BALLS,
    BALLS_AT_MESH,
    GIVEN,
    HALF_SPACES,
    LIMITS,
    MOST_ROWS,
    PAIRS,
    SHAPES_AT_MESH,
    Clearances,
    Limits,
    PairFamily,
    RowBuffer,
)
from .walls import DistancesOnBodies, HalfSpacesOnBodies, motions_of
from .ways import PairWays, pair_ways

_KINDS: dict[type, int] = {
    JointLimits: LIMITS, HalfSpaceContacts: HALF_SPACES, SignedDistances: PAIRS, SphereContacts: BALLS,
    GivenConstraint: GIVEN, GivenRows: GIVEN, HingeLimits: GIVEN,
    SphereSurface: BALLS_AT_MESH, ShapeSurface: SHAPES_AT_MESH,
    HalfSpacesOnBodies: HALF_SPACES, DistancesOnBodies: PAIRS,
}  # fmt: skip
# kinds that are queried at every step
_ALWAYS = BALLS, GIVEN, BALLS_AT_MESH, SHAPES_AT_MESH
# kinds of which there may be several families
_SEVERAL = LIMITS, GIVEN, BALLS_AT_MESH, SHAPES_AT_MESH


def _kind_of(family: ConstraintFamily) -> int | None:
    """Return what a family is to kernels; None if they do not take it."""
    kind = _KINDS.get(type(family))
    return None if kind == GIVEN and family.moving else kind


def row_buffer(nv: int, frictional: bool, resisting: bool = False) -> RowBuffer:
    """Return room for rows of a mechanism with nv velocities."""
    turning = MOST_ROWS if resisting else 0
    gap, e, lever, mu = np.zeros((4, MOST_ROWS))
    point, normal = np.zeros((2, MOST_ROWS, 3))
    J, T = np.zeros((MOST_ROWS, nv)), np.zeros((2 * MOST_ROWS if frictional else 0, nv))
    count, number, axes = np.zeros(1, np.int64), np.zeros(MOST_ROWS, np.int64), np.zeros((MOST_ROWS, 2, 3))
    resistance, R = np.zeros((turning, 2)), np.zeros((3 * turning, nv))
    return RowBuffer(count, number, gap, e, lever, mu, point, normal, J, T, axes, resistance, R)


class MechanismState:
    """The constraints of one mechanism in arrays.

    Parameters
    ----------
    constraints : AdmissibleSet
        Of which `can_be_compiled` is true.

    Attributes
    ----------
    arrays : MechanismConstraints
        As kernels take them.
    """

    def __init__(self, constraints: AdmissibleSet) -> None:
        self._set, cache, families = constraints, constraints.cache, constraints.families
        # one object, which tells whether the arrays have the state
        self._leave = self.leave
        nq, nv = constraints.system.nq, constraints.system.nv
        kinds, slot = [_kind_of(family) for family in families], cache.slots
        where, count = {kind: k for k, kind in enumerate(kinds)}, len(cache.arrays[0])
        tables: dict[int, Any] = {}
        self._listed: list[Array | None] = [None] * count
        self._candidates: list[Array] = [np.zeros(0, np.int64)] * count
        for kind in (HALF_SPACES, PAIRS):
            tables[kind] = _no_pairs(nv)
            if kind in where:
                k = where[kind]
                tables[kind] = table = _pair_family(constraints, k, cache.candidates(slot[k]))
                self._listed[slot[k]], self._candidates[slot[k]] = table.listed, table.candidates
        walls: Any = families[where[HALF_SPACES]] if HALF_SPACES in where else _no_walls()
        pairs: Any = families[where[PAIRS]] if PAIRS in where else None
        shapes, near = _no_shapes() if pairs is None else pairs.loop_tables()
        # elsewhere bodies are counted among those of the walls' pairs
        points = walls.points._replace(body=tables[HALF_SPACES].bodies[1].copy())
        self._clearances = Clearances(
            np.array(kinds, np.int64), np.array(slot, np.int64), *cache.arrays, np.zeros(nq), np.zeros(count, bool),
            np.zeros(nv),
        )  # fmt: skip
        some = row_buffer(nv, constraints.frictional) if GIVEN in kinds else row_buffer(0, False)
        given = RowCallback(np.zeros(1, np.int64), np.zeros(1), some)
        self.arrays = MechanismConstraints(
            self._clearances, _limits(constraints), points, tables[HALF_SPACES], shapes, tables[PAIRS], near,
            *_balls(constraints), given, _no_spheres_at_mesh(), _no_shapes_at_mesh(),
            record_at.addresses(_at_meshes(constraints)),
            walls.planes if isinstance(walls, HalfSpacesOnBodies) else np.zeros((0, 4)),
        )  # fmt: skip

    def enter(self) -> bool:
        """Copy the state of the caches to the arrays; return False if the loop cannot start from it."""
        if any(family.some_rest for family in self._set.families):
            return False
        cache, state = self._set.cache, self._clearances
        if cache.reclaim is not None:
            cache.reclaim()
        if not cache.lend(state.q, state.always, self._listed):
            return False
        for k, room in enumerate(self._candidates):
            candidates = cache.candidates(k)
            if candidates is not None:
                room[: len(candidates.index)] = candidates.index
        cache.reclaim = self._leave
        return True

    @property
    def entered(self) -> bool:
        """Whether the arrays have the state, which a function of the user may have reclaimed."""
        return self._set.cache.reclaim is self._leave

    @property
    def memory(self) -> list[Array]:
        """The arrays that queries change, and that later queries depend on."""
        cache, _, points, walls, shapes, pairs, near = self.arrays[:7]
        return [
            cache.travel, cache.clearance, cache.q, cache.always, walls.clearance, walls.candidates, walls.listed,
            pairs.clearance, pairs.candidates, pairs.listed, points.start, Shapes(*shapes).start, near.axis,
        ]  # fmt: skip

    @cached_property
    def reach(self) -> Array:
        """The reach of each constraint, shape (n, nv): positive where its gradient may have an entry."""
        parts: Any = [family.reach_of(np.arange(family.size)) for family in self._set.families]
        return np.concatenate([np.zeros((0, self._set.system.nv)), *parts])

    def leave(self) -> None:
        """Copy the state back to the caches, if the arrays have it."""
        if not self.entered:
            return
        self._set.cache.reclaim = None
        self._set.cache.take_back(self._clearances.q, self._clearances.always, self._listed, self._candidates)


def columns_of(
    constraints: AdmissibleSet, families: Sequence[ConstraintFamily]
) -> tuple[Array, Array, Array, PairWays]:  # fmt: skip
    """Return of all pairs of some families which these are, the numbers in these, and thicknesses [m], shapes (n,).

    A family is -1, and the thickness infinite, where kernels do not know how a pair moves. The last are `pair_ways`.
    """
    which, numbers, thickness = [np.zeros(0, np.int64)], [np.zeros(0, np.int64)], [np.zeros(0)]
    for family in families:
        kind, listed = _kind_of(family), family.all_pairs()
        known = kind in (PAIRS, BALLS, SHAPES_AT_MESH)
        which.append(np.full(len(listed), constraints.families.index(family) if known else -1))
        numbers.append(listed)
        thickness.append(family.thickness_of(listed) if known else np.full(len(listed), np.inf))
    ways = pair_ways(constraints.system, families, numbers[1:])
    return np.concatenate(which), np.concatenate(numbers), np.concatenate(thickness), ways


def can_be_compiled(constraints: AdmissibleSet) -> bool:
    """Return whether the loop takes every family: joint limits, meshes, and at most one of each other kind.

    Of one mechanism it also takes functions of the user, unless they have a `rate`, or something has torsional or
    rolling friction.
    """
    cache, kinds = constraints.cache, [_kind_of(family) for family in constraints.families]
    several = [kind for kind in kinds if kind not in _SEVERAL]
    if None in kinds or len(set(several)) < len(several):
        return False
    if GIVEN in kinds and (constraints.resistance is not None or not constraints.system.single_mechanism):
        return False
    if any(slot < 0 for slot, kind in zip(cache.slots, kinds, strict=True) if kind not in _ALWAYS):
        return False
    found = (cache.candidates(k) for k in range(len(cache.arrays[0])))
    return all(one is None or isinstance(one.reach, np.ndarray) for one in found)


def walls_can_be_bodies(constraints: AdmissibleSet) -> bool:
    """Return whether the loop may take every family where walls that move are bodies; then see `can_be_compiled`."""
    kinds = [_kind_of(family) for family in constraints.families if not family.moving]
    return None not in kinds and GIVEN not in kinds and motions_of(constraints) is not None


def has_given_rows(constraints: AdmissibleSet) -> bool:
    """Return whether some rows are those of functions of the user."""
    return any(_kind_of(family) == GIVEN for family in constraints.families)


def _pair_family(constraints: AdmissibleSet, k: int, candidates: Any) -> PairFamily:
    family, start, e = constraints.numbered()[k]
    n = family.size
    numbers = np.arange(n)
    own = family.restitution_of(numbers)
    resistance = np.zeros((0, 2))
    if constraints.resistance is not None:
        resistance = constraints.resistance.of(start + numbers, constraints.name)
    return PairFamily(
        candidates.reach, candidates.clearance, np.zeros(n, np.int64), np.zeros(2, np.int64), start + numbers,
        np.array(family.bodies_of(numbers), dtype=np.int64).reshape(2, n), np.where(np.isnan(own), e, own),
        constraints.friction_of(k, numbers), resistance, *_levers(candidates.reach.T),
    )  # fmt: skip


def _levers(reach: Array) -> tuple[Array, Array, Array]:
    """Return `begin`, `velocity` and `lever` of pairs of some reach, shape (n, nv)."""
    moving = reach != 0.0
    return np.append(0, moving.sum(axis=1).cumsum()), moving.nonzero()[1].copy(), reach[moving]


# what there is none of is held once for all problems: kernels write nothing to it


@cache
def _no_pairs(nv: int) -> PairFamily:
    no, none = np.zeros(0, np.int64), np.zeros(0)
    bodies, resistance = np.zeros((2, 0), np.int64), np.zeros((0, 2))
    listed, begin = np.zeros(2, np.int64), np.zeros(1, np.int64)
    return held(PairFamily(np.zeros((nv, 0)), none, no, listed, no, bodies, none, none, resistance, begin, no, none))


@cache
def _no_balls() -> Balls:
    no, numbers, vectors = np.zeros(0), np.zeros(0, np.int64), np.zeros((0, 3))
    return held(Balls(numbers, no, numbers, vectors, numbers, no, vectors, vectors))


def _balls(constraints: AdmissibleSet) -> tuple[Balls, PairFamily]:
    k = next((k for k, family in enumerate(constraints.families) if _kind_of(family) == BALLS), None)
    none = _no_pairs(constraints.system.nv)
    if k is None:
        return _no_balls(), none
    last: Any = constraints.families[k]
    pairs, where, n = last.all_pairs(), last.where, len(last.radii)
    count, position = len(pairs), where.start + where.stride * np.arange(n)
    room: Any = np.zeros(count, np.int64), np.zeros(count), *np.zeros((2, count, 3))
    # they have no clearances
    family, reach = _pair_family(constraints, k, none), np.zeros((last.size, constraints.system.nv))
    reach[pairs] = last.reach_of(pairs)
    begin, velocity, lever = _levers(reach)
    family = family._replace(begin=begin, velocity=velocity, lever=lever)
    return Balls(position, last.radii, pairs, np.zeros((n, 3)), *room), family


def _nothing_at_mesh(kind: type[ShapeSurface | SphereSurface]) -> Any:
    return kind(System(), [], Surface(np.eye(3), np.array([[0, 1, 2]])), "", np.zeros(0))


@cache
def _no_spheres_at_mesh() -> SpheresAtMesh:
    return held(SpheresAtMesh(_nothing_at_mesh(SphereSurface).loop_table(), _no_pairs(0)))


@cache
def _no_shapes_at_mesh() -> ShapesAtMesh:
    nothing = _nothing_at_mesh(ShapeSurface)
    return held(ShapesAtMesh(nothing.at_mesh, _no_pairs(0), nothing.frames, np.zeros((0, 4, 3))))


def _at_meshes(constraints: AdmissibleSet) -> list[Any]:
    """Return of each family the held record of spheres or shapes at a mesh, None of others."""
    found: list[Any] = [None] * len(constraints.families)
    for k, each in enumerate(constraints.families):
        kind, family = _kind_of(each), cast("Any", each)
        if kind in (BALLS_AT_MESH, SHAPES_AT_MESH):
            pairs = _pair_family(constraints, k, _no_pairs(constraints.system.nv))
            if kind == BALLS_AT_MESH:
                found[k] = held(SpheresAtMesh(family.loop_table(), pairs))
            else:
                # all of them are looked at
                pairs, places = pairs._replace(listed=np.arange(family.size)), np.zeros((len(family.frames), 4, 3))
                found[k] = held(ShapesAtMesh(family.at_mesh, pairs, family.frames, places))
    return found


@cache
def _no_walls() -> HalfSpaceContacts:
    return HalfSpaceContacts(System(), [], [], [], np.zeros(0))


@cache
def _no_shapes() -> tuple[Any, Any]:
    """Return what `loop_tables` returns of no pairs."""
    shapes, near = SignedDistances(System(), ShapeTable([]), np.zeros((0, 2), np.int64), np.zeros(0)).loop_tables()
    return shapes, held(near)


def _limits(constraints: AdmissibleSet) -> Limits:
    begin, no, none = [0], np.zeros(0), np.zeros(0, np.int64)
    parts: Any = [(no, no, no, none, none, no, none)]
    for family, start, e in constraints.numbered():
        begin.append(begin[-1])
        if _kind_of(family) == LIMITS:
            limits: Any = family
            own, number = family.restitution_of(np.arange(family.size)), start + np.arange(family.size)
            parts.append((*limits.arrays, np.where(np.isnan(own), e, own), number))
            begin[-1] += family.size
    fields: Any = *(np.concatenate(part) for part in zip(*parts, strict=True)), np.array(begin, dtype=np.int64)
    return Limits(*fields)
