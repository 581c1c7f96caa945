"""Checked data of the robots, bodies, spheres, walls and forces that were added to a scene."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

import pinocchio as pin

from ..arguments import label, made_label
from ..errors import InputError
from ..geometry.meshes.triangles import Surface
from ..geometry.motion import Motion
from ..geometry.shapes.shapes import Array, Convex, HalfSpace, Hull
from ..system.joint_forces import JointForce
from ..system.mechanisms.articulated import Control
from .connected.items import ConnectionItem, CouplingItem
from .state import State
from .urdf.robot import Robot

# what is set of pairs: a number or several
Setting = TypeVar("Setting")
SceneControl = Callable[[State], Mapping[str, Any] | None]
Force = Callable[[float, Array, Array], Any]


@dataclass(frozen=True)
class RobotItem:
    """A robot with its pose, its initial state, its locked joints and its springs.

    `tolerance` is that of simpler shapes than its hulls [m]; None is 1e-4 of the size of each, 0 exact. `friction` is
    the largest torque or force of dry friction of some joints [N m, N].
    """

    robot: Robot
    base: str
    position: Array
    rotation: Array
    q0: Array
    v0: Array
    control: Control | None
    locked: tuple[str, ...] = ()
    tolerance: float | None = None
    springs: tuple[JointForce, ...] = ()
    friction: Mapping[str, float] = field(default_factory=dict)

    def links(self) -> dict[str, bool]:
        """Return the names of the links, "robot/link", and whether each can move."""
        model, moves = self.robot.model, [False]
        for joint in range(1, model.njoints):
            moves.append(moves[model.parents[joint]] or model.names[joint] not in self.locked)
        links = (f for f in model.frames if f.type == pin.FrameType.BODY)
        return {f"{self.robot.name}/{f.name}": moves[f.parentJoint] for f in links}


@dataclass(frozen=True)
class BodyItem:
    """A rigid body of one shape; `centre` is its centre of mass in the shape's frame, `motion` that of a fixed one.

    `tolerance` is that of a simpler shape than its hull [m]; None is exact. A body with `parts` touches as these,
    which have by a part `larger` more volume than the mesh that they were cut from, if that is closed.
    """

    name: str
    shape: Convex
    mass: float
    inertia: Array
    centre: Array
    position: Array
    rotation: Array
    velocity: Array
    angular_velocity: Array
    fixed: bool
    motion: Motion | None = None
    tolerance: float | None = None
    parts: tuple[Hull, ...] = ()
    larger: float | None = None

    @property
    def shapes(self) -> dict[str, Convex]:
        """What it touches as, by name."""
        return {f"{self.name}[{k}]": part for k, part in enumerate(self.parts)} or {self.name: self.shape}


@dataclass(frozen=True)
class SurfaceItem:
    """A mesh of the world with its pose and its motion; of a height field also what it was made from.

    `heights` has the shape (rows, columns) [m], `size` are the lengths along x and y [m].
    """

    name: str
    surface: Surface
    position: Array
    rotation: Array
    motion: Motion | None = None
    heights: Array | None = None
    size: tuple[float, float] | None = None

    def placed(self) -> Surface:
        """Return the mesh at its pose."""
        return self.surface.placed(self.rotation, self.position)


@dataclass(frozen=True)
class SphereItem:
    """Spheres under one name."""

    name: str
    positions: Array
    radii: Array
    masses: Array
    velocities: Array

    def names(self) -> list[str]:
        """Return one name for each sphere."""
        if len(self.radii) == 1:
            return [self.name]
        return [f"{self.name}[{k}]" for k in range(len(self.radii))]


@dataclass(frozen=True)
class ForceItem:
    """An external force on a body, a group of them, or a link "robot/link"."""

    body: str
    function: Force


@dataclass
class SceneItems:
    """Everything that was added to a scene, in order."""

    gravity: Array
    restitution: float
    plane: str | None = None
    walls: dict[str, HalfSpace] = field(default_factory=dict)
    surfaces: list[SurfaceItem] = field(default_factory=list)
    robots: list[RobotItem] = field(default_factory=list)
    bodies: list[BodyItem] = field(default_factory=list)
    spheres: list[SphereItem] = field(default_factory=list)
    pair_restitution: dict[frozenset[str], float] = field(default_factory=dict)
    controls: list[SceneControl] = field(default_factory=list)
    forces: list[ForceItem] = field(default_factory=list)
    friction: float = 0.0
    pair_friction: dict[frozenset[str], float] = field(default_factory=dict)
    # lengths of torsional and of rolling friction [m]
    resistance: tuple[float, float] = (0.0, 0.0)
    pair_resistance: dict[frozenset[str], tuple[float, float]] = field(default_factory=dict)
    energy_cap: bool = False
    excluded: set[frozenset[str]] = field(default_factory=set)
    connections: list[ConnectionItem] = field(default_factory=list)
    couplings: list[CouplingItem] = field(default_factory=list)
    # the pairs that each connection leaves out
    left_out: dict[str, set[frozenset[str]]] = field(default_factory=dict)

    def names(self) -> set[str]:
        """Return the names in use."""
        return {
            *map(entity, self.walls),
            *(s.name for s in self.surfaces),
            *(r.robot.name for r in self.robots),
            *(entity(b.name) for b in self.bodies),
            *(s.name for s in self.spheres),
            *self.switchable,
        }

    @property
    def switchable(self) -> dict[str, bool]:
        """Whether each connection and each coupling is on, by name."""
        return {c.name: c.active for c in self.connections} | {c.name: c.active for c in self.couplings}

    @property
    def active_connections(self) -> list[ConnectionItem]:
        """The connections that are not switched off."""
        return [c for c in self.connections if c.active]

    def links_acted_on(self) -> set[str]:
        """Return the names of the links and bodies that forces and connections act on."""
        sides = {name for c in self.connections for name in (c.first, c.second)}
        return sides | {force.body for force in self.forces}

    def parts(self) -> set[str]:
        """Return the names of links, of single bodies of many, and of a container's walls."""
        shapes = (s.name for r in self.robots for s in r.robot.shapes)
        return {*shapes, *(name for b in self.bodies for name in b.shapes), *self.walls}

    def shapes_of_links(self) -> dict[str, list[str]]:
        """Return the names of the shapes of each link "robot/link" that has several, or none."""
        found: dict[str, list[str]] = {link: [] for item in self.robots for link in item.links()}
        for item in self.robots:
            for shape in item.robot.shapes:
                link, _, number = shape.name.rpartition("_")
                if shape.name not in found and number.isdigit() and link in found:
                    found[link].append(shape.name)
        return found

    def carriers(self, name: str) -> list[tuple[str, str | tuple[str, int], bool]]:
        """Return the shapes that a name stands for: name, what carries each, and whether that moves; two of a group."""
        found: list[tuple[str, str | tuple[str, int], bool]] = []
        for item in self.robots:
            own = item.robot.name
            shapes = item.robot.shapes if name == own else [s for s in item.robot.shapes if s.name == name]
            found += [(s.name, (own, s.body), s.body > 0) for s in shapes]
        several = [b for b in self.bodies if name in (b.name, entity(b.name), *b.shapes)]
        found += [(b.name, b.name, not b.fixed) for b in several[:2]]
        for spheres in self.spheres:
            found += [(s, s, True) for s in spheres.names()[:2] if spheres.name == name]
        if not found:
            found.append((name, (name, 0), False))
        return found

    def can_meet(self, first: str, second: str) -> bool:
        """Return whether some shapes that two names stand for can touch, as far as files leave them in."""
        apart: set[tuple[str, str]] = set().union(*(item.robot.apart for item in self.robots))
        return any(
            here != there and (moves or others_move) and not {(a, b), (b, a)} & apart
            for a, here, moves in self.carriers(first)
            for b, there, others_move in self.carriers(second)
        )

    def leave_out(self, first: str, second: str, why: str) -> None:
        """Let all shapes of two bodies or links pass through each other, because a connection of a name demands it."""
        if "world" in (first, second):
            return
        links = self.shapes_of_links()
        sides = [links.get(name) or [name] for name in (first, second)]
        pairs = {frozenset((a, b)) for a in sides[0] for b in sides[1] if self.can_meet(a, b)}
        others = set().union(*self.left_out.values())
        # what the user has excluded stays so
        self.left_out[why] = {pair for pair in pairs if pair not in self.excluded or pair in others}
        self.excluded |= pairs

    def excludes(self, a: str, b: str) -> bool:
        """Return whether the user leaves out the pair of two shapes."""
        return bool(self.excluded) and _setting(dict.fromkeys(self.excluded, 1.0), a, b, 0.0) > 0.0

    def new_name(self, name: str | None, default: str) -> str:
        """Return an unused name.

        Raises
        ------
        InputError
            If the wanted name is in use, or is no name.
        """
        # "world" is what connections and controls call the world
        taken = {"world", *self.names()}
        if name is not None:
            if label(name) in taken:
                raise InputError(f"the name {name!r} is taken; give another one")
            return name
        default, number = made_label(default), 1
        while default in taken:
            number += 1
            default = f"{default.removesuffix(f'_{number - 1}')}_{number}"
        return default

    def restitution_of(self, a: str, b: str) -> float:
        """Return e between two shapes: the setting of a shape takes precedence over that of its robot or body."""
        return _setting(self.pair_restitution, a, b, self.restitution)

    def friction_of(self, a: str, b: str) -> float:
        """Return the coefficient of friction between two shapes, found as e is."""
        return _setting(self.pair_friction, a, b, self.friction)

    def resistance_of(self, name: str) -> tuple[float, float]:
        """Return the lengths of torsional and rolling friction of a contact "a | b", found as mu is [m]."""
        a, _, b = name.partition(" | ")
        return _setting(self.pair_resistance, a, b, self.resistance)

    @property
    def resists_turning(self) -> bool:
        """Whether a pair has torsional or rolling friction."""
        return any(max(one) > 0.0 for one in (self.resistance, *self.pair_resistance.values()))

    @property
    def frictional(self) -> bool:
        """Whether a pair has friction."""
        return max(self.friction, *self.pair_friction.values(), 0.0) > 0.0

    @property
    def elastic(self) -> bool:
        """Whether every pair has e = 1 and no friction."""
        return min(self.restitution, *self.pair_restitution.values(), 1.0) == 1.0 and not self.frictional


def set_last(settings: dict[frozenset[str], Setting], pairs: Sequence[frozenset[str]], value: Setting) -> None:
    """Set a value of some pairs, and make them the last ones that were set."""
    for pair in pairs:
        settings.pop(pair, None)
        settings[pair] = value


def _setting(pairs: Mapping[frozenset[str], Setting], a: str, b: str, common: Setting) -> Setting:
    own, one_sided = frozenset((a, b)), (frozenset((a, entity(b))), frozenset((entity(a), b)))
    if own in pairs:
        return pairs[own]
    found = [pair for pair in one_sided if pair in pairs]
    if len(found) == 2:
        # neither is nearer to the pair than the other: the last one that was said holds
        found.sort(key=list(pairs).index, reverse=True)
    return pairs[found[0]] if found else pairs.get(frozenset((entity(a), entity(b))), common)


def entity(name: str) -> str:
    """Return the name of the robot or of the group of bodies that a shape belongs to."""
    return name.split("/", 1)[0].split("[", 1)[0]
