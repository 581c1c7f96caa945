"""Walls with a prescribed motion as bodies of a mechanism, whose joints turn and slide at constant speeds.

The joints have an armature so large that no percussion changes their speeds: gaps to such walls change at the rate
J v as those to other bodies do. An oscillation A cos(phi) is the sum of two opposite circular motions: joints turn by
phi, -2 phi and phi, with A / 2 between them.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from ...compiled import record
from ...geometry.motion import Motion, Oscillation, Rotation, Translation
from ...geometry.same_motions import each_once
from ...geometry.shapes.shape_table import ShapeTable
from ...geometry.shapes.shapes import HalfSpace
from ...system import System
from ...system.mechanisms.articulated import ArticulatedSystem
from ..admissible_set import AdmissibleSet
from ..families.half_space import HalfSpaceContacts
from ..families.signed_distance import SignedDistances
from ..family import ConstraintFamily
from ..rebuilt import Rebuilt
from ..rows import Array

# armature of the joints of walls: a percussion p changes their speeds by p over this
_ARMATURE = 1e200
# reach of a half-space that turns [m/rad]: its points are anywhere
_ANYWHERE = 1e6


class WallBody(NamedTuple):
    """A wall as a body.

    Attributes
    ----------
    body : int
        Its number.
    origin : ndarray, shape (3,)
        Where its frame is while the wall is where it was added [m].
    reach : ndarray, shape (joints, 2)
        For each of its joints its place in v, and how far a half-space moves with it [m per unit]; see `System.reach`.
    swings : bool
        Whether the same reach applies to shapes: the joints of an oscillation move as one.
    """

    body: int
    origin: Array
    reach: Array
    swings: bool


@record("f8[:,::1], f8[:,::1]")
class PrescribedJoints(NamedTuple):
    """The joints of walls that move, which are the last ones of a mechanism.

    Attributes
    ----------
    motion : ndarray, shape (n, 2)
        Speed of each joint, and its coordinate at t = 0.
    changes : ndarray, shape (m, 6)
        For each wall that changes its velocity its first joint among these, its speed [rad/s], and of an oscillation
        the amplitude [m] and the direction; NaN for a rotation.
    """

    motion: Array
    changes: Array


class WallJoints(NamedTuple):
    """A mechanism with walls as bodies.

    Attributes
    ----------
    system : ArticulatedSystem
        The mechanism.
    prescribed : PrescribedJoints
        The joints of the walls.
    walls : dict of Motion to WallBody
        The walls; those with one motion are one body.
    """

    system: ArticulatedSystem
    prescribed: PrescribedJoints
    walls: dict[Motion, WallBody]


class HalfSpacesOnBodies(HalfSpaceContacts):
    """Half-spaces of which some are fixed to walls that are bodies; for kernels, which turn their normals.

    Attributes
    ----------
    planes : ndarray, shape (n, 4)
        Normal and offset [m] of each pair's half-space in the frame of its body.
    """

    wall: tuple[WallBody | None, ...] = ()
    planes: Array

    @cached_property
    def _reach(self) -> Any:
        return _with_walls(super()._reach, self.wall)

    def bodies_of(self, numbers: Array) -> tuple[Array, Array]:
        """Return the first and the second body of some pairs, shapes (k,)."""
        first = np.array([0 if one is None else one.body for one in self.wall], dtype=np.int64)
        return first[numbers], super().bodies_of(numbers)[1]


class DistancesOnBodies(SignedDistances):
    """Pairs of shapes of which some are fixed to walls that are bodies."""

    wall: tuple[WallBody | None, ...] = ()

    @cached_property
    def _reach(self) -> Any:
        swinging = tuple(one if one is not None and one.swings else None for one in self.wall)
        return _with_walls(super()._reach, swinging)


def _with_walls(reach: Any, walls: tuple[WallBody | None, ...]) -> Any:
    """Return reaches, shape (nv, n), with those of the walls of pairs; sparse ones, unknown to kernels, as given."""
    for pair, wall in enumerate(walls):
        if wall is not None and isinstance(reach, np.ndarray):
            reach[wall.reach[:, 0].astype(int), pair] = wall.reach[:, 1]
    return reach


class _WithWalls(ArticulatedSystem):
    """A mechanism with the joints of walls.

    Parameters
    ----------
    system, given : ArticulatedSystem and System
        It without these joints, and what it was joined of, which knows the reach of its parts.
    model : pinocchio.Model
        Its model.
    """

    def __init__(self, system: ArticulatedSystem, given: System, model: pin.Model) -> None:
        super().__init__(model, equalities=system.equalities)
        self._given = given

    def reach(self, body: int, centre: Array, radius: float) -> Array:
        if body >= len(self._given.bodies):
            return super().reach(body, centre, radius)
        return np.append(self._given.reach(body, centre, radius), np.zeros(self.nv - self._given.nv))

    def are_lengths(self) -> Array:
        return np.append(self._given.are_lengths(), super().are_lengths()[self._given.nv :])

    def go_straight(self) -> Array:
        return np.append(self._given.go_straight(), super().go_straight()[self._given.nv :])


def wall_joints(system: ArticulatedSystem, given: System, motions: list[Motion]) -> WallJoints:
    """Return a mechanism with the joints of walls of some motions; `given` is what it was joined of."""
    model = system.model.copy()
    speeds, changes, walls = list[tuple[float, float]](), list[tuple[float, ...]](), dict[Motion, WallBody]()

    def add(parent: int, joint: Any, origin: Array, speed: float, start: float) -> int:
        speeds.append((speed, start))
        return int(model.addJoint(parent, joint, pin.SE3(np.eye(3), origin), str(model.njoints)))

    for motion in motions:
        first, number, origin = model.nv, len(speeds), np.zeros(3)
        if isinstance(motion, Translation):
            direction, speed = _direction(motion.velocity)
            body = add(0, pin.JointModelPrismaticUnaligned(*direction), origin, speed, 0.0)
            reach = [1.0]
        elif isinstance(motion, Rotation):
            origin = np.asarray(motion.centre, dtype=float)
            body = add(0, pin.JointModelRevoluteUnaligned(*motion.axis), origin, motion.rate, 0.0)
            changes.append((number, motion.rate, *[np.nan] * 4))
            reach = [_ANYWHERE]
        else:
            assert isinstance(motion, Oscillation)
            direction, amplitude = _direction(motion.amplitude)
            across = np.cross(direction, np.eye(3)[np.abs(direction).argmin()])
            across /= np.linalg.norm(across)
            speed, body = 2.0 * np.pi * motion.frequency, 0
            # A sin(x) = A cos(x - pi / 2)
            start, arm = motion.phase - 0.5 * np.pi, 0.5 * amplitude * direction
            for turns, offset in ((1.0, origin), (-2.0, arm), (1.0, arm)):
                joint = pin.JointModelRevoluteUnaligned(*across)
                body = add(body, joint, offset, turns * speed, turns * start)
            changes.append((number, speed, amplitude, *direction))
            reach = [0.25 * amplitude] * 3
        each = np.array([(first + k, one) for k, one in enumerate(reach)])
        walls[motion] = WallBody(body, origin, each, isinstance(motion, Oscillation))
    armature = np.array(model.armature)
    armature[system.nv :] = _ARMATURE
    model.armature = armature
    prescribed = PrescribedJoints(np.array(speeds), np.array(changes).reshape(-1, 6))
    return WallJoints(_WithWalls(system, given, model), prescribed, walls)


def _direction(vector: Any) -> tuple[Array, float]:
    """Return a unit vector along another, and the length of that."""
    length = float(np.linalg.norm(vector))
    return (np.asarray(vector) / length, length) if length > 0.0 else (np.array([1.0, 0.0, 0.0]), 0.0)


def motions_of(constraints: AdmissibleSet) -> list[Motion] | None:
    """Return the motions of the walls that move, each once; None if some wall cannot be a body."""
    found = list[Motion]()
    for family in constraints.families:
        if not family.moving:
            continue
        if type(family.at_rest) not in (HalfSpaceContacts, SignedDistances):
            return None
        # contacts that the union of tiles has not are known of walls at rest only
        if family.at_rest.has_seams:
            return None
        if type(family.frame.motion) not in (Translation, Oscillation, Rotation):
            return None
        found.append(family.frame.motion)
    return each_once(found)


def with_wall_bodies(constraints: AdmissibleSet, joints: WallJoints) -> tuple[AdmissibleSet, Array]:
    """Return constraints in which walls are bodies, and for each of them its number in the given ones.

    Families of one kind become one; the others keep their order.
    """
    system, kinds = joints.system, (HalfSpaceContacts, SignedDistances)
    parts: list[list[tuple[int, ConstraintFamily]]] = []
    of_kind = dict[type, list[tuple[int, ConstraintFamily]]]()
    for k, family in enumerate(constraints.families):
        kind = type(family.at_rest or family)
        if kind in kinds and kind in of_kind:
            of_kind[kind].append((k, family))
            continue
        parts.append([(k, family)])
        of_kind[kind] = parts[-1]
    # those of moving walls come last, so that the places of others stay
    parts.sort(key=lambda part: part[0][1].moving)
    made, e, mu, numbers = list[ConstraintFamily](), [], [], list[Array]()
    starts = [start for _, start, _ in constraints.numbered()]
    for part in parts:
        k, family = part[0]
        kind = type(family.at_rest or family)
        if any(one.moving for _, one in part):
            made.append((_half_spaces if kind is HalfSpaceContacts else _distances)(constraints, part, joints))
        else:
            made.append(_moved(family, system))
        e.append(constraints.numbered()[k][2])
        mu.append(constraints.friction_where_none(k))
        numbers += [starts[j] + np.arange(one.size) for j, one in part]
    found = AdmissibleSet(system, made, np.array(e), np.array(mu))
    found.resistance = constraints.resistance
    return found, np.concatenate(numbers)


def _moved(family: ConstraintFamily, system: System) -> ConstraintFamily:
    """Return a family on another system."""
    assert isinstance(family, Rebuilt)
    if not family.of_joints:
        return family.rebuilt_with(family.system, system)
    (_, *arguments), options = family._arguments
    return type(family)(system.nv, *arguments, **options)


def _settings(constraints: AdmissibleSet, part: list[tuple[int, ConstraintFamily]]) -> tuple[Array, Array]:
    """Return e and mu of the pairs of some families."""
    e, mu = list[Array](), list[Array]()
    for k, family in part:
        own = np.broadcast_to(np.asarray(family.restitution, dtype=float), family.size)
        e.append(np.where(np.isnan(own), constraints.numbered()[k][2], own))
        mu.append(constraints.friction_of(k, np.arange(family.size)))
    return np.concatenate(e), np.concatenate(mu)


def _half_spaces(
    constraints: AdmissibleSet, part: list[tuple[int, ConstraintFamily]], joints: WallJoints
) -> HalfSpacesOnBodies:  # fmt: skip
    planes, shapes, names, walls = list[HalfSpace](), list[Any](), list[str](), list[WallBody | None]()
    lines = list[Array]()
    for _, family in part:
        own, wall = _at_rest(family, joints)
        arguments, _ = own._arguments
        origin = np.zeros(3) if wall is None else wall.origin
        planes += [HalfSpace(one.normal, one.offset - float(np.dot(one.normal, origin))) for one in arguments[1]]
        shapes += arguments[2]
        names += own.names
        lines += [] if arguments[5] is None else [arguments[5]]
        walls += [wall] * own.size
    e, mu = _settings(constraints, part)
    along = np.concatenate(lines) if lines else None
    made = HalfSpacesOnBodies(joints.system, planes, shapes, names, e, along, mu)
    made.wall, made.planes = tuple(walls), np.array([[*one.normal, one.offset] for one in planes])
    return made


def _distances(
    constraints: AdmissibleSet, part: list[tuple[int, ConstraintFamily]], joints: WallJoints
) -> DistancesOnBodies:  # fmt: skip
    placed, sides, walls, begin = list[Any](), list[Array](), list[WallBody | None](), 0
    for _, family in part:
        own, wall = _at_rest(family, joints)
        (_, table, pairs, _, line, at_rest, *_), _ = own._arguments
        for one in table.placed:
            fixed = wall is not None and one.body == 0
            placed.append(replace(one, body=wall.body, position=one.position - wall.origin) if wall and fixed else one)
        sides.append(pairs + begin)
        begin += len(table)
        walls += [wall] * own.size
    e, mu = _settings(constraints, part)
    made = DistancesOnBodies(joints.system, ShapeTable(placed), np.concatenate(sides), e, line, at_rest, friction=mu)
    made.wall = tuple(walls)
    return made


def _at_rest(family: ConstraintFamily, joints: WallJoints) -> tuple[Any, WallBody | None]:
    """Return a family as it is where walls stand still, and its wall."""
    return (family, None) if family.frame is None else (family.at_rest, joints.walls[family.frame.motion])
