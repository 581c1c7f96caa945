"""From the things in a scene to a Problem: systems, pairs and rows, and what was left out."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pinocchio as pin

from ..compiled import load
from ..constraints import (
    Constraint,
    Crowd,
    HalfSpaceContacts,
    JointLimits,
    MovingWalls,
    SeenFrom,
    SignedDistances,
    SphereContacts,
    SphereSurface,
    SphereWalls,
)
from ..constraints.shapes import Array, Box, Capsule, HalfSpace, PlacedShape, Sphere
from ..errors import InputError
from ..problem import Problem
from ..system import ArticulatedSystem, BlockSystem, FreeBodies, Spheres, System
from .always_apart import always_apart
from .items import BodyItem, RobotItem, SceneItems, SphereItem, SurfaceItem
from .model import SceneModel
from .reductions import REDUCTIONS, Omission
from .simplified import Simplified
from .still_joints import without_still_joints

# more spheres than these meet their walls in bulk
_FEW_SPHERES = 33
# more pairs with shapes that move on their own are found when near
_MANY_PAIRS = 300
# more other shapes than these have their pairs listed when near
_FEW_SHAPES = 60
_PALETTE = (
    (0.20, 0.45, 0.70, 1.0),
    (0.90, 0.55, 0.20, 1.0),
    (0.30, 0.60, 0.40, 1.0),
    (0.75, 0.35, 0.40, 1.0),
    (0.50, 0.45, 0.70, 1.0),
    (0.85, 0.75, 0.35, 1.0),
)
_GREY = (0.7, 0.7, 0.72, 1.0)


@dataclass
class _Builder:
    """Systems, shapes and initial state, collected block after block."""

    items: SceneItems
    reduce: tuple[str, ...]
    systems: list[System] = field(default_factory=list)
    shapes: list[PlacedShape] = field(default_factory=list)
    q0: list[Array] = field(default_factory=list)
    v0: list[Array] = field(default_factory=list)
    omitted: list[Omission] = field(default_factory=list)
    apart: set[tuple[str, str]] = field(default_factory=set)
    limits: list[tuple[Array, Array, Array, Array, list[str]]] = field(default_factory=list)
    spheres: list[int] = field(default_factory=list)
    sizes: list[float] = field(default_factory=list)
    simplified: Simplified = field(default_factory=Simplified)

    def counts(self) -> tuple[int, int, int]:
        """Return how many q, v and bodies there are so far."""
        return (
            sum(s.nq for s in self.systems),
            sum(s.nv for s in self.systems),
            sum(len(s.bodies) - 1 for s in self.systems),
        )

    def add_robot(self, item: RobotItem) -> None:
        nq, nv, nb = self.counts()
        item, still = without_still_joints(item, self.reduce)
        model = item.robot.model.copy()
        model.gravity.linear = self.items.gravity
        self.systems.append(ArticulatedSystem(model, item.robot.name, item.control))
        self.q0.append(item.q0)
        self.v0.append(item.v0)
        placed = [replace(s, body=s.body + nb if s.body else 0) for s in item.robot.shapes]
        self.shapes += [self.simplify(s, item.tolerance) for s in placed]
        self.apart |= item.robot.apart
        self.omitted += [*item.robot.omitted, *still]
        joints = [j for j in range(1, model.njoints) if model.nqs[j] == 1 and model.nvs[j] == 1]
        here = np.array([model.idx_qs[j] for j in joints], dtype=np.intp)
        rate = np.array([model.idx_vs[j] for j in joints], dtype=np.intp)
        lower, upper = model.lowerPositionLimit[here], model.upperPositionLimit[here]
        names = [f"{item.robot.name}/{model.names[j]}" for j in joints]
        # Pinocchio writes "no limit" as the largest float
        lower, upper = np.where(lower < -1e100, -np.inf, lower), np.where(upper > 1e100, np.inf, upper)
        if joints and (np.isfinite(lower) | np.isfinite(upper)).any():
            self.limits.append((here + nq, rate + nv, lower, upper, names))

    def add_bodies(self, bodies: list[BodyItem]) -> None:
        moving = [b for b in bodies if not b.fixed]
        body = self.counts()[2]
        for k, b in enumerate(bodies):
            if b.fixed:
                placed = PlacedShape(b.name, b.shape, 0, b.rotation, b.position, _GREY, b.motion)
            else:
                body += 1
                placed = PlacedShape(b.name, b.shape, body, np.eye(3), -b.centre, _PALETTE[k % len(_PALETTE)])
            self.shapes.append(self.simplify(placed, b.tolerance))
        if not moving:
            return
        masses = np.array([b.mass for b in moving])
        inertias = np.array([b.inertia for b in moving])
        names = tuple(b.name for b in moving)
        self.systems.append(FreeBodies(masses, inertias, self.items.gravity, names))
        for b in moving:
            quaternion = pin.Quaternion(b.rotation).normalized().coeffs()
            self.q0.append(np.concatenate([b.position + b.rotation @ b.centre, quaternion]))
            self.v0.append(np.concatenate([b.velocity, b.rotation.T @ b.angular_velocity]))

    def add_spheres(self, spheres: list[SphereItem]) -> None:
        if not spheres:
            return
        nb = self.counts()[2]
        names = [n for item in spheres for n in item.names()]
        radii = np.concatenate([s.radii for s in spheres])
        self.systems.append(Spheres(np.concatenate([s.masses for s in spheres]), self.items.gravity, tuple(names)))
        colors = [_PALETTE[(k + 1) % len(_PALETTE)] for k, s in enumerate(spheres) for _ in s.radii]
        for k, (name, radius, color) in enumerate(zip(names, radii, colors, strict=True)):
            placed = PlacedShape(name, Sphere(float(radius)), nb + k + 1, np.eye(3), np.zeros(3), color)
            self.spheres.append(len(self.shapes))
            self.sizes.append(float(radius))
            self.shapes.append(placed)
        self.q0.append(np.concatenate([s.positions.reshape(-1) for s in spheres]))
        self.v0.append(np.concatenate([s.velocities.reshape(-1) for s in spheres]))
        what = f"rotation of {len(radii)} sphere{'s' * (len(radii) > 1)}"
        self.omitted.append(Omission(what, "no friction can turn them", dofs=3 * len(radii)))

    def simplify(self, placed: PlacedShape, tolerance: float | None) -> PlacedShape:
        """Return a shape that does for another, whose size still counts."""
        if placed.body:
            self.sizes.append(placed.shape.bound)
        return self.simplified.of(placed, tolerance) if "shapes" in self.reduce else placed

    def leave_out_pairs(self) -> None:
        """Leave out the pairs that can never meet."""
        if "pairs" not in self.reduce:
            return
        still = {name: wall for name, wall in self.items.walls.items() if wall.motion is None}
        for a, b, bound in always_apart(self.systems, self.shapes, still, self.apart):
            self.apart.add((a, b))
            # rounded down
            digit = 10.0 ** (np.floor(np.log10(bound)) - 1)
            why = f"always apart within the limits of their joints, by {digit * np.floor(bound / digit):.2g} m at least"
            self.omitted.append(Omission(f"pair {a} | {b}", why, pairs=1))

    def constraints(self, system: System) -> Iterator[Constraint]:
        items = self.items
        for here, rate, lower, upper, names in self.limits:
            yield JointLimits(system.nv, here, rate, lower, upper, names, items.restitution)
        bulk = self._bulk()
        single = [s for k, s in enumerate(self.shapes) if s.body and k not in bulk]
        moving = [s for s in self.shapes if s.body]
        still = {name: wall for name, wall in items.walls.items() if wall.motion is None}
        yield from self._at_walls(system, still, single)
        yield from self._at_surfaces(system, [s for s in items.surfaces if s.motion is None], moving)
        if len(self.shapes) - len(self.spheres) > _FEW_SHAPES or (bulk and len(self.shapes) > len(bulk)):
            yield self._crowd(system)
            pairs = []
        else:
            pairs = list(self._shape_pairs())
        if pairs:
            yield self._distances(system, pairs)
        if bulk:
            solid = [s for s in self.shapes if isinstance(s.shape, Box | Capsule) and s.motion is None]
            yield from self._sphere_walls(system, still, solid)
        if len(self.spheres) > 1:
            yield self._sphere_contacts(system)
        yield from self._moving_walls(system, single, moving)

    def _at_walls(self, system: Any, walls: dict[str, HalfSpace], shapes: list[PlacedShape]) -> Iterator[Any]:
        pairs = [(n, wall, s) for n, wall in walls.items() for s in shapes if (n, s.name) not in self.apart]
        if pairs:
            labels = [f"{s.name} | {name}" for name, _, s in pairs]
            e = np.array([self.items.restitution_of(name, s.name) for name, _, s in pairs])
            yield HalfSpaceContacts(system, [w for _, w, _ in pairs], [s for _, _, s in pairs], labels, e)

    def _at_surfaces(self, system: Any, surfaces: list[SurfaceItem], shapes: list[PlacedShape]) -> Iterator[Any]:
        for item in surfaces:
            others = [s.name for s in shapes if not isinstance(s.shape, Sphere)]
            if others:
                raise InputError(
                    f"{others[0]} would meet {item.name}, but a mesh as it is meets spheres only: take its hull by "
                    "add_mesh(..., fixed=True), several of these, or boxes"
                )
            e = np.array([self.items.restitution_of(item.name, s.name) for s in shapes])
            yield SphereSurface(system, shapes, item.placed(), item.name, e)

    def _distances(self, system: Any, pairs: list[tuple[PlacedShape, PlacedShape]]) -> SignedDistances:
        first, second = [a for a, _ in pairs], [b for _, b in pairs]
        e = np.array([self.items.restitution_of(a.name, b.name) for a, b in pairs])
        return SignedDistances(system, first, second, [f"{a.name} | {b.name}" for a, b in pairs], e)

    def _moving_walls(
        self, system: System, single: list[PlacedShape], moving: list[PlacedShape]
    ) -> Iterator[Constraint]:
        """Yield what meets walls that move on their own, those of one motion together.

        `single` are the shapes that meet walls and shapes one by one, of all that are moving.
        """
        fixed, bulk = [s for s in self.shapes if not s.body], len(single) < len(moving)
        given = [wall.motion for wall in self.items.walls.values()]
        given += [item.motion for item in self.items.surfaces] + [shape.motion for shape in fixed]
        for motion in {id(motion): motion for motion in given if motion is not None}.values():
            seen: Any = SeenFrom(system, motion, self._where_spheres(system))
            walls = {name: wall for name, wall in self.items.walls.items() if wall.motion is motion}
            shapes = [s for s in fixed if s.motion is motion]
            solid = [s for s in shapes if bulk and isinstance(s.shape, Box | Capsule)]
            pairs = [(a, b) for a in shapes for b in (single if a in solid else moving)]
            found = [*self._at_walls(seen, walls, single)]
            found += self._at_surfaces(seen, [s for s in self.items.surfaces if s.motion is motion], moving)
            if len(pairs) > _MANY_PAIRS:
                found.append(self._crowd_around(seen, shapes, solid, single, moving))
            elif pairs:
                found.append(self._distances(seen, pairs))
            found += self._sphere_walls(seen, walls, solid) if bulk else []
            yield from (MovingWalls(seen, constraint) for constraint in found)

    def _bulk(self) -> set[int]:
        """Return the spheres, if they are many: these meet walls, boxes and capsules in bulk."""
        return set(self.spheres) if len(self.spheres) > _FEW_SPHERES else set()

    def _shape_pairs(self) -> Iterator[tuple[PlacedShape, PlacedShape]]:
        spheres, bulk = set(self.spheres), self._bulk()
        closed = {k for k, s in enumerate(self.shapes) if bulk and isinstance(s.shape, Box | Capsule)}
        for i, a in enumerate(self.shapes):
            if i in spheres:
                # they come last, and two of them are found in bulk
                continue
            for j in range(i + 1, len(self.shapes)):
                b = self.shapes[j]
                # nothing of the world moves against the world
                if a.body == b.body or (i in closed and j in bulk) or a.motion or b.motion:
                    continue
                if (a.name, b.name) not in self.apart:
                    yield a, b

    def _crowd(self, system: System) -> Crowd:
        """Return the pairs of shapes that are no two spheres, none of them listed."""
        number = {s.name: k for k, s in enumerate(self.shapes)}
        apart = {(number[a], number[b]) for a, b in self.apart if a in number}
        n = len(self.shapes)
        known = np.sort(np.array([min(p) * n + max(p) for p in apart], dtype=np.int64))
        sphere, bulk = np.zeros(n, bool), self._bulk()
        sphere[self.spheres] = True
        closed = np.array([bool(bulk) and isinstance(s.shape, Box | Capsule) for s in self.shapes])
        driven = np.array([s.motion is not None for s in self.shapes])

        def left_out(i: Array, j: Array) -> Array:
            apart = np.isin(i * n + j, known)
            return sphere[i] & sphere[j] | closed[i] & sphere[j] | driven[i] | driven[j] | apart

        return Crowd(system, self.shapes, left_out, self.items.restitution_of)

    def _crowd_around(
        self,
        seen: Any,
        shapes: list[PlacedShape],
        solid: list[PlacedShape],
        single: list[PlacedShape],
        moving: list[PlacedShape],
    ) -> Crowd:
        """Return the pairs of some shapes of the world with all that are moving; solid ones meet single ones only."""
        everything, alone = shapes + moving, {id(s) for s in single}
        closed = np.array([any(s is one for one in solid) for s in everything])
        sphere = np.array([s.body > 0 and id(s) not in alone for s in everything])

        def left_out(i: Array, j: Array) -> Array:
            return (i >= len(shapes)) | closed[i] & sphere[j]

        return Crowd(seen, everything, left_out, self.items.restitution_of)

    def _all_spheres(self, system: System) -> tuple[slice, int, Array, tuple[str, ...], Array]:
        """Return the spheres' part of q, the first one's body, radii, names, and which entity each belongs to."""
        items = self.items.spheres
        group = np.repeat(np.arange(len(items)), [len(s.radii) for s in items])
        radii = np.concatenate([s.radii for s in items])
        names = tuple(n for s in items for n in s.names())
        return self._where_spheres(system), self.shapes[self.spheres[0]].body, radii, names, group

    def _where_spheres(self, system: System) -> slice:
        return slice(system.nq - 3 * len(self.spheres), system.nq)

    def _sphere_contacts(self, system: System) -> SphereContacts:
        where, first, radii, names, group = self._all_spheres(system)
        items = self.items.spheres
        e = np.array([[self.items.restitution_of(a.name, b.name) for b in items] for a in items])
        return SphereContacts(system, where, first, radii, names, group, e)

    def _sphere_walls(
        self, system: Any, halfspaces: dict[str, HalfSpace], solid: list[PlacedShape]
    ) -> Iterator[SphereWalls]:
        walls: dict[str, HalfSpace | PlacedShape] = {**halfspaces, **{s.name: s for s in solid}}
        if not walls:
            return
        where, first, radii, names, group = self._all_spheres(system)
        e = np.array([[self.items.restitution_of(w, s.name) for w in walls] for s in self.items.spheres])
        yield SphereWalls(system, where, first, radii, list(walls.values()), names, tuple(walls), group, e)


def assemble(items: SceneItems, reduce: tuple[str, ...] = REDUCTIONS) -> Problem:
    """Return the Problem of a scene, with the named kinds of what it does not need left out.

    Raises
    ------
    InputError
        If nothing moves.
    InadmissibleStartError
        If two things overlap at the start.
    """
    builder = _Builder(items, reduce)
    for robot in items.robots:
        builder.add_robot(robot)
    builder.add_bodies(items.bodies)
    builder.add_spheres(items.spheres)
    if not builder.systems:
        raise InputError("nothing in the scene moves: add a robot, a body or a sphere")
    if len(builder.spheres) > _FEW_SPHERES:
        # the plain forms of their kernels take all pairs at once
        load()
    builder.leave_out_pairs()
    builder.omitted += builder.simplified.omitted()
    system: Any = builder.systems[0] if len(builder.systems) == 1 else BlockSystem(builder.systems)
    constraints = list(builder.constraints(system))
    model = SceneModel(items, tuple(builder.shapes), tuple(builder.omitted), reduce)
    return Problem(
        system,
        constraints,
        np.concatenate(builder.q0),
        np.concatenate(builder.v0),
        restitution=items.restitution,
        length=float(np.median(builder.sizes)) if builder.sizes else 1.0,
        scene=model,
    )
