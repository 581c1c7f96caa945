"""From the things in a scene to a Problem: systems, pairs and rows, and what was left out."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np

from ..constraints import (
    BroadPhasePairs,
    ConstraintFamily,
    HalfSpaceContacts,
    JointLimits,
    MovingFrame,
    MovingWalls,
    ShapeSurface,
    SignedDistances,
    SphereCentres,
    SphereContacts,
    SphereSurface,
    SphereWalls,
)
from ..errors import InputError, MbviError
from ..geometry.same_motions import each_once, same
from ..geometry.shapes.shape_table import ShapeTable, indexed
from ..geometry.shapes.shapes import Array, Box, Capsule, HalfSpace, PlacedShape, Sphere
from ..problem import Problem
from ..system import ConnectedSystem, HingedSystem, System
from ..system.mechanisms.equalities import Equality
from .blocks import Blocks, blocks_of
from .connected.equalities import check_reversed, equalities_between
from .connected.hinges import acting_hinges, hinge_limits
from .forces.actuation import actuated
from .items import SceneItems, SurfaceItem
from .model import SceneModel, Start
from .pairs.passing import passing_robots
from .pairs.rules import refuse_others, resistances_of
from .pairs.settings import LeftOut, LeftOutAround, PairSetting
from .plane import check_plane, collinear_points
from .reductions import DEFAULT_REDUCTIONS, Omission
from .resolve import closed_start, resolved

# more spheres than these meet their walls in bulk
_FEW_SPHERES = 33
# more pairs with shapes that move on their own are found when near
_MANY_PAIRS = 300
# of more boxes and capsules than these that move, spheres meet only the near ones
_FEW_SOLIDS = 20
# more other shapes than these have their pairs listed when near
_FEW_SHAPES = 60


class _ConstraintBuilder:
    """What in a scene meets what."""

    def __init__(self, blocks: Blocks, lines: dict[int, Array]) -> None:
        self.blocks, self.items, self.lines = blocks, blocks.items, lines
        self.line = None if blocks.axes is None else blocks.axes[2]
        self.at_rest = "rest" in blocks.reduce
        # points over half-spaces that are left out, in all families made so far
        self.collinear_points = 0
        self.shapes, self.spheres, self.walls, self.apart = blocks.placed, blocks.spheres, blocks.walls, blocks.apart

    def constraints(self, system: System) -> Iterator[ConstraintFamily]:
        items = self.items
        if self.blocks.limits:
            turns = ~system.are_lengths()
        for here, rate, lower, upper, names in self.blocks.limits:
            lever = np.where(turns[rate], self.blocks.length, 1.0)
            yield JointLimits(system.nv, here, rate, lower, upper, names, items.restitution, lever)
        bulk = self._bulk()
        single = [s for k, s in enumerate(self.shapes) if s.body and k not in bulk]
        moving = [s for s in self.shapes if s.body]
        still = {name: wall for name, wall in self.walls.items() if wall.motion is None}
        yield from self._at_walls(system, still, single)
        yield from self._at_surfaces(system, [s for s in items.surfaces if s.motion is None], moving)
        # of one sphere all pairs are listed
        some_excluded = not self._without_exclusion and len(self.spheres) > 1
        others = len(self.shapes) - len(self.spheres)
        if others > _FEW_SHAPES or (bulk and others) or some_excluded:
            yield from self._crowd(system)
            pairs = []
        else:
            pairs = list(self._shape_pairs())
        if pairs:
            yield self._distances(system, pairs)
        if bulk:
            yield from self._sphere_walls(system, still, self._solids())
        if len(self.spheres) > 1 and not some_excluded:
            yield self._sphere_contacts(system)
        yield from self._moving_walls(system, single, moving)

    def _at_walls(self, system: Any, walls: dict[str, HalfSpace], shapes: list[PlacedShape]) -> Iterator[Any]:
        pairs = [(n, wall, s) for n, wall in walls.items() for s in shapes if self._meet(n, s.name)]
        if pairs:
            labels = [f"{s.name} | {name}" for name, _, s in pairs]
            e, mu = self._settings([(name, s.name) for name, _, s in pairs])
            lines = np.array([self.lines[s.body] for _, _, s in pairs]) if self.lines else None
            made = HalfSpaceContacts(system, [w for _, w, _ in pairs], [s for _, _, s in pairs], labels, e, lines, mu)
            self.collinear_points += made.collinear_points
            yield made

    def _at_surfaces(self, system: Any, surfaces: list[SurfaceItem], shapes: list[PlacedShape]) -> Iterator[Any]:
        for item in surfaces:
            meeting = [s for s in shapes if self._meet(item.name, s.name)]
            refuse_others(item.name, meeting)
            for kind, round_ones in ((SphereSurface, True), (ShapeSurface, False)):
                some = [s for s in meeting if isinstance(s.shape, Sphere) == round_ones]
                if some:
                    e, mu = self._settings([(item.name, s.name) for s in some])
                    yield kind(system, some, item.placed(), item.name, e, mu)

    def _meet(self, a: str, b: str) -> bool:
        """Return whether the pair of two shapes, or a wall and a shape, is not left out."""
        return (a, b) not in self.apart and not self.items.excludes(a, b)

    def _distances(self, system: Any, pairs: list[tuple[PlacedShape, PlacedShape]]) -> SignedDistances:
        first, second = [a for a, _ in pairs], [b for _, b in pairs]
        e, mu = self._settings([(a.name, b.name) for a, b in pairs])
        return SignedDistances(system, *indexed(first, second), e, self.line, self.at_rest, friction=mu)

    def _settings(self, pairs: list[tuple[str, str]]) -> tuple[Array, Array]:
        """Return e and mu of pairs of shapes, shapes (n,)."""
        e, mu = np.empty(len(pairs)), np.zeros(len(pairs))
        for k, (a, b) in enumerate(pairs):
            e[k] = self.items.restitution_of(a, b)
            if self.items.frictional:
                mu[k] = self.items.friction_of(a, b)
        return e, mu

    def _moving_walls(
        self, system: System, single: list[PlacedShape], moving: list[PlacedShape]
    ) -> Iterator[ConstraintFamily]:
        """Yield what meets walls that move on their own, those of one motion together.

        `single` are the shapes that meet walls and shapes one by one, of all that are moving.
        """
        fixed, bulk = [s for s in self.shapes if not s.body], len(single) < len(moving)
        items: list[Any] = [*self.walls.values(), *self.items.surfaces, *fixed]
        for motion in each_once(item.motion for item in items):
            seen: Any = MovingFrame(system, motion, self._where_spheres(system))
            walls = {name: wall for name, wall in self.walls.items() if same(wall.motion, motion)}
            shapes = [s for s in fixed if same(s.motion, motion)]
            solid = [s for s in shapes if bulk and isinstance(s.shape, Box | Capsule)]
            pairs = [
                (a, b)
                for a in shapes
                for b in (single if a in solid else moving)
                if not self.items.excludes(a.name, b.name)
            ]
            found = [*self._at_walls(seen, walls, single)]
            found += self._at_surfaces(seen, [s for s in self.items.surfaces if same(s.motion, motion)], moving)
            if len(pairs) > _MANY_PAIRS:
                found.append(self._crowd_around(seen, shapes, solid, single, moving))
            elif pairs:
                found.append(self._distances(seen, pairs))
            found += self._sphere_walls(seen, walls, solid) if bulk else []
            yield from (MovingWalls(seen, constraint) for constraint in found)

    def _bulk(self) -> set[int]:
        """Return the spheres, if they are many and meet all others: walls, boxes and capsules meet them in bulk."""
        some = len(self.spheres) <= _FEW_SPHERES or not self._without_exclusion
        return set() if some else set(self.spheres)

    @property
    def _without_exclusion(self) -> bool:
        """Whether no pair with a free sphere is excluded."""
        named = {name for pair in self.items.excluded for name in pair}
        return not any(item.name in named for item in self.items.spheres)

    def _solids(self) -> list[PlacedShape]:
        """Return the boxes and capsules that spheres meet in bulk: those of the world, and few others."""
        solids = [s for s in self.shapes if isinstance(s.shape, Box | Capsule) and s.motion is None]
        few = sum(s.body > 0 for s in solids) <= _FEW_SOLIDS
        return [s for s in solids if few or not s.body]

    def _shape_pairs(self) -> Iterator[tuple[PlacedShape, PlacedShape]]:
        spheres = set(self.spheres)
        for i, a in enumerate(self.shapes):
            if i in spheres:
                # they come last, and two of them are found in bulk
                continue
            for j in range(i + 1, len(self.shapes)):
                b = self.shapes[j]
                # nothing of the world moves against the world
                if a.body == b.body or a.motion or b.motion:
                    continue
                if self._meet(a.name, b.name):
                    yield a, b

    def _crowd(self, system: System) -> Iterator[BroadPhasePairs]:
        """Yield the pairs of shapes that are no two spheres, none of them listed, if there are any."""
        # two spheres of which some pairs are excluded are found here
        free = {self.shapes[k].name for k in self.spheres} if self._without_exclusion else set()
        bulk = bool(self._bulk())
        solid = {s.name for s in self._solids()} if bulk else set()
        # where spheres meet all others in bulk, these are among themselves
        alone = bulk and all(s.name in free or s.motion or s.name in solid for s in self.shapes)
        shapes = [s for s in self.shapes if not (alone and s.name in free)]
        if len({s.body for s in shapes}) < 2:
            return
        sphere = np.array([s.name in free for s in shapes])
        closed = np.array([s.name in solid for s in shapes])
        number = {s.name: k for k, s in enumerate(shapes)}
        n = len(shapes)
        apart = {(number[a], number[b]) for a, b in self.apart if a in number and b in number}
        known = np.sort(np.array([min(p) * n + max(p) for p in apart], dtype=np.int64))
        driven = np.array([s.motion is not None for s in shapes])
        left_out = LeftOut(sphere, closed, driven, known, self._excluded(shapes))
        yield self._found_when_near(system, shapes, left_out)

    def _crowd_around(
        self,
        seen: Any,
        shapes: list[PlacedShape],
        solid: list[PlacedShape],
        single: list[PlacedShape],
        moving: list[PlacedShape],
    ) -> BroadPhasePairs:
        """Return the pairs of some shapes of the world with all that are moving; solid ones meet single ones only."""
        everything, alone = shapes + moving, {id(s) for s in single}
        walls = {id(s) for s in solid}
        closed = np.array([id(s) in walls for s in everything])
        sphere = np.array([s.body > 0 and id(s) not in alone for s in everything])
        left_out = LeftOutAround(len(shapes), sphere, closed, self._excluded(everything))
        return self._found_when_near(seen, everything, left_out)

    def _excluded(self, shapes: list[PlacedShape]) -> PairSetting | None:
        """Return which pairs of some shapes the user leaves out; None if no pair at all."""
        names = tuple(s.name for s in shapes)
        return PairSetting(self.items, names, "excluded") if self.items.excluded else None

    def _found_when_near(self, system: Any, shapes: list[PlacedShape], left_out: Any) -> BroadPhasePairs:
        names, items = tuple(s.name for s in shapes), self.items
        e, most = PairSetting(items, names), max(items.friction, *items.pair_friction.values(), 0.0)
        mu = PairSetting(items, names, "friction") if most > 0.0 else None
        return BroadPhasePairs(system, ShapeTable(shapes), left_out, e, self.line, self.at_rest, mu, most)

    def _all_spheres(self, system: System) -> tuple[SphereCentres, int, Array, tuple[str, ...], Array]:
        """Return the spheres' part of q, the first one's body, radii, names, and which entity each belongs to."""
        items = self.items.spheres
        group = np.repeat(np.arange(len(items)), [len(s.radii) for s in items])
        radii = np.concatenate([s.radii for s in items])
        names = tuple(n for s in items for n in s.names())
        return self._where_spheres(system), self.shapes[self.spheres[0]].body, radii, names, group

    def _where_spheres(self, system: System) -> SphereCentres:
        count, stride = len(self.spheres), 7 if self.items.frictional else 3
        return SphereCentres(system.nq - stride * count, count, stride)

    def _between(self, first: list[str], second: list[str]) -> tuple[Array, Array | None]:
        """Return e and mu of each thing with each other thing, shapes (n, m); None without friction."""
        e = np.array([[self.items.restitution_of(a, b) for b in second] for a in first])
        if not self.items.frictional:
            return e, None
        return e, np.array([[self.items.friction_of(a, b) for b in second] for a in first])

    def _sphere_contacts(self, system: System) -> SphereContacts:
        where, first, radii, names, group = self._all_spheres(system)
        items = [item.name for item in self.items.spheres]
        return SphereContacts(system, where, first, radii, names, group, *self._between(items, items))

    def _sphere_walls(
        self, system: Any, halfspaces: dict[str, HalfSpace], solid: list[PlacedShape]
    ) -> Iterator[SphereWalls]:
        walls: dict[str, HalfSpace | PlacedShape] = {**halfspaces, **{s.name: s for s in solid}}
        if not walls:
            return
        where, first, radii, names, group = self._all_spheres(system)
        settings = self._between([s.name for s in self.items.spheres], list(walls))
        yield SphereWalls(system, where, first, radii, list(walls.values()), names, tuple(walls), group, *settings)


def start_picture(items: SceneItems) -> str:
    """Return a picture of the start of a scene as the text of an svg element, "" for one that cannot be built."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            problem = assemble(items)
    except MbviError:
        # a scene that is not finished
        return ""
    return "" if problem.scene is None else problem.scene.picture(problem.q0, problem.t0)


def assemble(
    items: SceneItems, reduce: tuple[str, ...] = DEFAULT_REDUCTIONS, resolve: bool = False, start: Start | None = None,
    at: Array | None = None, t0: float = 0.0,
) -> Problem:  # fmt: skip
    """Return the Problem of a scene, with the named kinds of what it does not need left out.

    `resolve` moves a start that overlaps; `start` is one that was moved before. `at`, shape (nq,), is the configuration
    of a run instead, which may penetrate, at the time t0 [s].

    Raises
    ------
    InputError
        If nothing moves, or something leaves the scene's plane.
    InadmissibleStartError
        If two things overlap at the start.
    """
    check_plane(items)
    blocks = blocks_of(items, reduce)
    if not blocks.systems:
        raise InputError("nothing in the scene moves: add a robot, a body or a sphere")
    system: Any = blocks.system
    q0, v0 = np.concatenate(blocks.q0), np.concatenate(blocks.v0)
    between = list[Equality]()
    if items.connections or items.couplings:
        within, between = equalities_between(items, system, blocks.frames, blocks.shapes, q0)
        for number, equalities in within.items():
            blocks.connect(number, equalities)
        system = blocks.system
    blocks.leave_out_pairs(system, q0)
    builder = _ConstraintBuilder(blocks, blocks.lines(system, q0))
    constraints = list(builder.constraints(system))
    constraints += hinge_limits(items, system, blocks.frames, blocks.shapes, q0, blocks.length)
    omitted = (
        *passing_robots(items),
        *(Omission(f"pairs of {pair[0]} and {pair[-1]}", "excluded") for pair in sorted(map(sorted, items.excluded))),
        *blocks.simplified.added_to(blocks.omitted),
        *collinear_points(builder.collinear_points),
    )
    acted = actuated(blocks, system, blocks.length)
    if between:
        hinges = acting_hinges(items, system, blocks.frames, blocks.shapes, np.concatenate(blocks.q0))
        acted = ConnectedSystem(acted, between) if hinges is None else HingedSystem(acted, between, hinges)
    if start is None and at is None:
        start = closed_start(acted, q0)
        check_reversed(items, system, blocks.frames, blocks.shapes, q0, q0 if start is None else start.q)
    if resolve:
        start = resolved(acted, constraints, q0 if start is None else start.q, blocks.length) or start
    q0 = at if at is not None else q0 if start is None else start.q
    v0 = acted.tangent(q0, v0)
    scene = SceneModel(items, tuple(blocks.shapes), omitted, reduce, acted, tuple(constraints), start, at is not None)
    problem = Problem(
        acted,
        constraints,
        q0,
        v0,
        restitution=items.restitution,
        energy_cap=items.energy_cap,
        t0=t0,
        length=blocks.length,
        scene=scene,
    )
    problem.constraints.resistance = resistances_of(items)
    return problem
