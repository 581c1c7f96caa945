"""The robots, bodies and spheres of a scene as blocks of q and v: systems, shapes, initial state, and omissions."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pinocchio as pin

from ..arguments import watched
from ..geometry.shapes.beside_meshes import beside_meshes
from ..geometry.shapes.shapes import Array, HalfSpace, PlacedShape, Sphere
from ..system import ArticulatedSystem, BlockSystem, FreeBodies, PlanarBodies, PlanarSpheres, Spheres, System
from ..system.mechanisms.equalities import Equality
from .forces.link_centres import centre_of, with_frames
from .items import BodyItem, RobotItem, SceneItems, SphereItem
from .meshes.simplified import Simplified
from .pairs.certified_disjoint import always_apart
from .plane import axes_of, beside, check_robot, on_planar_base
from .reductions import Omission
from .urdf.joint_friction import set_joint_friction
from .urdf.still_joints import counts_joints, without_still_joints

_PALETTE = (
    (0.20, 0.45, 0.70, 1.0),
    (0.90, 0.55, 0.20, 1.0),
    (0.30, 0.60, 0.40, 1.0),
    (0.75, 0.35, 0.40, 1.0),
    (0.50, 0.45, 0.70, 1.0),
    (0.85, 0.75, 0.35, 1.0),
)
_GREY = (0.7, 0.7, 0.72, 1.0)
_PLANAR = "the scene is planar"


@dataclass
class Blocks:
    """Systems, shapes and initial state, collected block by block.

    Attributes
    ----------
    items : SceneItems
        What the user added.
    reduce : tuple of str
        The kinds of reductions that are on.
    systems, q0, v0
        One each of what moves together.
    shapes : list of PlacedShape
        Of all of them, and of the world.
    walls : dict of str to HalfSpace
        Those that something may meet.
    omitted : list of Omission
        What was left out.
    apart : set of (str, str)
        Pairs that are left out of contact detection.
    limits
        Of each robot: where in q and in v, lower and upper limits, and names of its joints.
    spheres : list of int
        Which of the shapes are free spheres.
    sizes : list of float
        Of all shapes that move [m].
    axes : ndarray, shape (3, 3), or None
        In rows two axes and the normal of the plane that all moves in.
    centres : dict of str to (int, ndarray)
        Of each link that a force acts on the joint that carries it, and its centre of mass in that joint's frame [m].
    frames : dict of str to PlacedShape
        Of each link that a force or a connection acts on its frame, on the body that carries it.
    """

    items: SceneItems
    reduce: tuple[str, ...]
    walls: dict[str, HalfSpace]
    axes: Array | None
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
    centres: dict[str, tuple[int, Array]] = field(default_factory=dict)
    frames: dict[str, PlacedShape] = field(default_factory=dict)

    def connect(self, number: int, equalities: list[Equality]) -> None:
        """Give equalities to one of the robots."""
        robot = self.systems[number]
        assert isinstance(robot, ArticulatedSystem)
        self.systems[number] = ArticulatedSystem(robot.model, robot.name, robot.control, equalities, robot.springs)

    def counts(self) -> tuple[int, int, int]:
        """Return how many q, v and bodies there are so far."""
        return (
            sum(s.nq for s in self.systems),
            sum(s.nv for s in self.systems),
            sum(len(s.bodies) - 1 for s in self.systems),
        )

    def add_robot(self, item: RobotItem) -> None:
        """Add a robot."""
        nq, nv, nb = self.counts()
        marked = with_frames(item, self.items.links_acted_on())
        marks = len(marked.robot.shapes) - len(item.robot.shapes)
        item, still = without_still_joints(marked, self.reduce, counts_joints(item, self.items))
        if self.items.plane:
            check_robot(item, self.items.plane)
        if self.axes is not None and item.base == "free":
            item = on_planar_base(item, self.axes)
            still.append(Omission(f"motion of {item.robot.name}'s base out of the plane", _PLANAR, dofs=3))
        shapes = item.robot.shapes[: len(item.robot.shapes) - marks]
        frames = {s.name: s for s in item.robot.shapes[len(shapes) :]}
        forced = {force.body for force in self.items.forces}
        for name, s in frames.items():
            if name in forced:
                centre = centre_of(marked.robot, name.partition("/")[2])
                self.centres[name] = s.body, s.rotation @ centre + s.position
            self.frames[name] = replace(s, body=s.body + nb if s.body else 0)
        model = item.robot.model.copy()
        model.gravity.linear = self.items.gravity
        set_joint_friction(model, item.friction)
        self.systems.append(ArticulatedSystem(model, item.robot.name, item.control, (), item.springs))
        self.q0.append(item.q0)
        self.v0.append(item.v0)
        placed = [replace(s, body=s.body + nb if s.body else 0) for s in shapes]
        self.shapes += [self.simplify(s, item.tolerance) for s in watched(placed, f"hulls of {item.robot.name}")]
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

    @property
    def system(self) -> System:
        """All of them as one system."""
        return self.systems[0] if len(self.systems) == 1 else BlockSystem(self.systems)

    @property
    def placed(self) -> list[PlacedShape]:
        """The shapes, fixed ones with what meshes have beside them."""
        return beside_meshes(self.shapes, self.items.surfaces)

    @property
    def length(self) -> float:
        """The length of the scene: the median size of what moves [m]."""
        return float(np.median(self.sizes)) if self.sizes else 1.0

    def add_bodies(self, bodies: list[BodyItem]) -> None:
        """Add all bodies, fixed ones included."""
        moving = [b for b in bodies if not b.fixed]
        body = self.counts()[2]
        for k, b in enumerate(watched(bodies, "bodies")):
            body += not b.fixed
            for name, shape in b.shapes.items():
                if b.fixed:
                    placed = PlacedShape(name, shape, 0, b.rotation, b.position, _GREY, b.motion)
                else:
                    placed = PlacedShape(name, shape, body, np.eye(3), -b.centre, _PALETTE[k % len(_PALETTE)])
                self.shapes.append(self.simplify(placed, b.tolerance or 0.0))
            if b.parts:
                more = "" if b.larger is None else f", together {100 * b.larger:+.2g} % of its volume"
                self.omitted.append(Omission(f"mesh {b.name}", f"cut into {len(b.parts)} convex parts{more}"))
        if not moving:
            return
        if "rest" in self.reduce and not self.items.connections:
            self.omitted.append(Omission("free bodies at rest", "they sleep until something touches them"))
        masses = np.array([b.mass for b in moving])
        inertias = np.array([b.inertia for b in moving])
        names = tuple(b.name for b in moving)
        for b in moving:
            quaternion = pin.Quaternion(b.rotation).normalized().coeffs()
            self.q0.append(np.concatenate([b.position + b.rotation @ b.centre, quaternion]))
        if self.axes is None:
            self.systems.append(FreeBodies(masses, inertias, self.items.gravity, names))
            self.v0 += [np.concatenate([b.velocity, b.rotation.T @ b.angular_velocity]) for b in moving]
            return
        normals = np.array([b.rotation.T @ self.axes[2] for b in moving])
        self.systems.append(PlanarBodies(masses, inertias, self.items.gravity, names, self.axes, normals))
        along, normal = self.axes[:2], self.axes[2:]
        self.v0 += [np.concatenate([along @ b.velocity, normal @ b.angular_velocity]) for b in moving]
        what = f"motion of {len(moving)} bod{'ies' if len(moving) > 1 else 'y'} out of the plane"
        self.omitted.append(Omission(what, _PLANAR, dofs=3 * len(moving)))

    def add_spheres(self, spheres: list[SphereItem]) -> None:
        """Add all spheres, which come last."""
        if not spheres:
            return
        nb = self.counts()[2]
        names = [n for item in spheres for n in item.names()]
        radii = np.concatenate([s.radii for s in spheres])
        masses, velocities = (np.concatenate([getattr(s, name) for s in spheres]) for name in ("masses", "velocities"))
        rolling = self.items.frictional
        if rolling:
            self._add_rolling(masses, radii, tuple(names), velocities)
        elif self.axes is None:
            self.systems.append(Spheres(masses, self.items.gravity, tuple(names)))
            self.v0.append(velocities.ravel())
        else:
            self.systems.append(PlanarSpheres(masses, self.items.gravity, tuple(names), self.axes))
            self.v0.append((velocities @ self.axes[:2].T).ravel())
        colors = [_PALETTE[(k + 1) % len(_PALETTE)] for k, s in enumerate(spheres) for _ in s.radii]
        for k, (name, radius, color) in enumerate(zip(names, radii, colors, strict=True)):
            placed = PlacedShape(name, Sphere(float(radius)), nb + k + 1, np.eye(3), np.zeros(3), color)
            self.spheres.append(len(self.shapes))
            self.sizes.append(float(radius))
            self.shapes.append(placed)
        positions = np.concatenate([s.positions for s in spheres])
        if rolling:
            positions = np.hstack([positions, np.tile([0.0, 0.0, 0.0, 1.0], (len(radii), 1))])
        self.q0.append(positions.reshape(-1))
        what = f"of {len(radii)} sphere{'s' * (len(radii) > 1)}"
        if not rolling:
            self.omitted.append(Omission(f"rotation {what}", "no friction can turn them", dofs=3 * len(radii)))
        if self.axes is not None:
            out = 3 if rolling else 1
            self.omitted.append(Omission(f"motion {what} out of the plane", _PLANAR, dofs=out * len(radii)))

    def _add_rolling(self, masses: Array, radii: Array, names: tuple[str, ...], velocities: Array) -> None:
        """Add spheres that friction can turn, as free bodies: one system with those that there are."""
        n, gravity = len(masses), self.items.gravity
        inertias = (0.4 * masses * radii**2)[:, None, None] * np.eye(3)
        before = self.systems[-1] if self.systems else None
        if isinstance(before, FreeBodies):
            self.systems.pop()
            masses, names = np.concatenate([before.masses, masses]), (*before.bodies[1:], *names)
            inertias = np.concatenate([before.inertias, inertias])
        if self.axes is None:
            self.systems.append(FreeBodies(masses, inertias, gravity, names))
            self.v0.append(np.hstack([velocities, np.zeros((n, 3))]).ravel())
            return
        normals = np.tile(self.axes[2], (n, 1))
        if isinstance(before, PlanarBodies):
            normals = np.concatenate([before.normals, normals])
        self.systems.append(PlanarBodies(masses, inertias, gravity, names, self.axes, normals))
        self.v0.append(np.hstack([velocities @ self.axes[:2].T, np.zeros((n, 1))]).ravel())

    def simplify(self, placed: PlacedShape, tolerance: float | None) -> PlacedShape:
        """Return a simpler shape in place of another; the size of the original enters the length of the scene."""
        if placed.body:
            self.sizes.append(placed.shape.bound)
        return self.simplified.of(placed, tolerance) if "shapes" in self.reduce else placed

    def lines(self, system: System, q0: Array) -> dict[int, Array]:
        """Return the normal of a planar scene's plane in each body's axes, by the number of the body."""
        if self.axes is None:
            return {}
        bodies = np.arange(1, len(system.bodies))
        return dict(zip(bodies.tolist(), system.placements(q0, bodies)[:, :3] @ self.axes[2], strict=True))

    def leave_out_pairs(self, system: System, q0: Array) -> None:
        """Leave out the half-spaces and the pairs that can never meet."""
        if self.axes is not None:
            for name, omission in beside(self.walls, self.shapes, system, q0, self.axes):
                del self.walls[name]
                self.omitted.append(omission)
        if "pairs" not in self.reduce:
            return
        still = {name: wall for name, wall in self.walls.items() if wall.motion is None}
        for a, b, bound in always_apart(self.systems, self.shapes, still, self.apart):
            self.apart.add((a, b))
            # rounded down
            digit = 10.0 ** (np.floor(np.log10(bound)) - 1)
            why = f"always apart within the limits of their joints, by {digit * np.floor(bound / digit):.2g} m at least"
            self.omitted.append(Omission(f"pair {a} | {b}", why, pairs=1))


def blocks_of(items: SceneItems, reduce: tuple[str, ...]) -> Blocks:
    """Return the blocks of a scene, in the order of q and v."""
    planar = items.plane is not None and "plane" in reduce
    blocks = Blocks(items, reduce, dict(items.walls), axes_of(items.plane) if planar and items.plane else None)
    for robot in items.robots:
        blocks.add_robot(robot)
    blocks.add_bodies(items.bodies)
    blocks.add_spheres(items.spheres)
    return blocks
