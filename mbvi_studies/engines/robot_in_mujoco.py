"""A robot of a scene in MuJoCo, built from mbvi's model, with MuJoCo's default contacts: for benchmarks of speed."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable
from itertools import combinations
from typing import Any

import mujoco
import numpy as np
import pinocchio as pin
from mujoco import rollout

from mbvi.arguments import Array
from mbvi.built_scene import BuiltScene
from mbvi.errors import InputError
from mbvi.geometry.shapes.shapes import Box, Capsule, Cylinder, Ellipsoid, Hull, PlacedShape, Sphere
from mbvi.problem import Problem
from mbvi.scene.items import SurfaceItem
from mbvi.system import ArticulatedSystem
from mbvi.system.mechanisms.articulated import Control

# mass matrix and gravity must agree to this, relative to their largest entries
_AGREEMENT = 1e-6
# MuJoCo's default time constant of a contact [s]
_TIME = 0.02


def time_of_steps(model: Any, data: Any, count: int) -> float:
    """Return the CPU time of one of MuJoCo's steps among `count` from a state on, the first excluded [s]."""
    mujoco.mj_step(model, data)
    start = time.process_time()
    mujoco.mj_step(model, data, nstep=count - 1)
    return (time.process_time() - start) / (count - 1)


class MuJoCoRobot:
    """One robot, its half-spaces and height fields, start and constant torques in MuJoCo; Euler, the default solver.

    With friction its cone is the elliptic one.

    Parameters
    ----------
    problem : Problem
        A scene of one robot, half-spaces and height fields.
    torque : ndarray, shape (nv,)
        What pushes the joints at all times [N, N m]; nothing pushes a free base.
    step : float
        Time step [s].

    Raises
    ------
    InputError
        If the scene is not of one robot, or its coefficients of friction differ.
    RuntimeError
        If MuJoCo's mass matrix or gravity at the start is another than Pinocchio's.
    """

    def __init__(self, problem: Problem, torque: Array, step: float) -> None:
        if not isinstance(problem.system, ArticulatedSystem) or problem.scene is None:
            raise InputError("the scene must be of one robot and half-spaces")
        self._source: pin.Model = problem.system.model
        self.model = self._compile(problem, problem.scene, step)
        self.data = mujoco.MjData(self.model)
        self._base = "FreeFlyer" in self._source.joints[1].shortname()
        self._coordinates()
        self._q = self.data.qpos.copy()
        self._q[self._here] = problem.q0[self._q_there]
        self._to_mujoco = np.zeros((self.model.nv, self.model.nv))
        self._to_mujoco[self._mine, self._v_there] = 1.0
        if self._base:
            x, y, z, w = problem.q0[3:7]
            self._q[:7] = *problem.q0[:3], w, x, y, z
            # MuJoCo's free joint has its linear velocity in world axes, Pinocchio's in body axes
            self._to_mujoco[:3, :3] = pin.Quaternion(w, x, y, z).matrix()
            self._to_mujoco[3:6, 3:6] = np.eye(3)
        self._v = self._to_mujoco @ problem.v0
        self._torque = self._to_mujoco @ torque
        self._check(problem)

    def hold_joints(self, q: Array, stiffness: float, damping: float) -> None:
        """Hold the joints behind a free base by MuJoCo's own springs and dampers.

        Parameters
        ----------
        q : ndarray, shape (nq,)
            A configuration in which the springs are slack [rad].
        stiffness, damping : float
            Of each joint [N m/rad, N m s/rad].
        """
        for joint in range(2, self._source.njoints):
            here = self.model.joint(self._source.names[joint]).id
            self.model.jnt_stiffness[here] = stiffness
            self.model.qpos_spring[self.model.jnt_qposadr[here]] = q[self._source.idx_qs[joint]]
            self.model.dof_damping[self.model.jnt_dofadr[here]] = damping

    def rows(self, count: int) -> float:
        """Return the mean number of active rows over `count` steps, the first excluded."""
        self._reset()
        rows = []
        for _ in range(count):
            mujoco.mj_step(self.model, self.data)
            rows.append(self.data.nefc)
        return float(np.mean(rows[1:]))

    def time(self, count: int) -> float:
        """Return the time of one step among `count`, the first excluded [s]."""
        self._reset()
        return time_of_steps(self.model, self.data, count)

    def time_controlled(self, control: Control, count: int) -> float:
        """Return the time of one step among `count` under a control of the joints, which sees a base of zeros [s]."""
        self._reset()
        q, v, h = np.zeros(self._source.nq), np.zeros(self._source.nv), self.model.opt.timestep
        mujoco.mj_step(self.model, self.data)
        start = time.process_time()
        for k in range(1, count):
            q[self._q_there], v[self._v_there] = self.data.qpos[self._here], self.data.qvel[self._mine]
            self.data.qfrc_applied[:] = self._to_mujoco @ control(k * h, q, v)
            mujoco.mj_step(self.model, self.data)
        return (time.process_time() - start) / (count - 1)

    def rollouts(self, v0: Array, steps: int, threads: int) -> Callable[[], None]:
        """Return a function that steps from the start at some velocities, shape (n, nv), by MuJoCo's own threads."""
        kind, count = mujoco.mjtState.mjSTATE_FULLPHYSICS, len(v0)
        states = np.empty((count, mujoco.mj_stateSize(self.model, kind)))
        for state, v in zip(states, v0, strict=True):
            self._reset()
            self.data.qvel[:] = self._to_mujoco @ v
            mujoco.mj_getState(self.model, self.data, state, kind)
        torque, data = np.tile(self._torque, (count, steps, 1)), [mujoco.MjData(self.model) for _ in range(threads)]

        def run() -> None:
            with rollout.Rollout(nthread=threads if threads > 1 else 0) as rolling:
                applied = mujoco.mjtState.mjSTATE_QFRC_APPLIED
                rolling.rollout(self.model, data, states, torque, control_spec=applied)

        return run

    def _reset(self) -> None:
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:], self.data.qvel[:], self.data.qfrc_applied[:] = self._q, self._v, self._torque

    def _compile(self, problem: Problem, scene: BuiltScene, step: float) -> mujoco.MjModel:
        spec = mujoco.MjSpec()
        spec.compiler.degree = False
        spec.option.timestep = step
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER
        spec.option.gravity = self._source.gravity.linear
        # fixed links are a body of their own, so that their pairs can be excluded and those of half-spaces kept
        bodies = [spec.worldbody.add_body(name="fixed")]
        for joint in range(1, self._source.njoints):
            bodies.append(self._add_body(bodies, spec.worldbody, joint))
        for placed in scene.shapes:
            _add_geom(spec, bodies[placed.body], placed)
        for wall in scene.walls.values():
            up = np.array(wall.normal)
            turn = pin.Quaternion.FromTwoVectors(np.array([0.0, 0.0, 1.0]), up).matrix()
            plane = mujoco.mjtGeom.mjGEOM_PLANE
            spec.worldbody.add_geom(type=plane, size=[0, 0, 1], pos=wall.offset * up, quat=_quaternion(turn))
        for item in scene.items.surfaces:
            _add_field(spec, item)
        _leave_out(spec, bodies, scene, self._source)
        if scene.items.pair_friction:
            raise InputError("the contacts must have one coefficient of friction")
        mu = scene.items.friction
        spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        for contact in (*spec.geoms, *spec.pairs):
            contact.condim, contact.friction[0] = 3 if mu else 1, mu
        for geom in spec.geoms:
            geom.solref = _TIME, _damping_ratio(float(problem.restitution.max()))
        return spec.compile()

    def deepest(self, count: int) -> float:
        """Return the greatest depth of a contact in `count` steps [m]."""
        self._reset()
        depth = 0.0
        for _ in range(count):
            mujoco.mj_step(self.model, self.data)
            depth = max(depth, -float(self.data.contact.dist.min(initial=0.0)))
        return depth

    def _add_body(self, bodies: list, world: Any, joint: int) -> Any:
        """Add the body that one of Pinocchio's joints carries."""
        source = self._source
        place, inertia = source.jointPlacements[joint], source.inertias[joint]
        parent = source.parents[joint]
        matrix = inertia.inertia
        body = (bodies[parent] if parent else world).add_body(
            name=source.names[joint],
            pos=place.translation,
            quat=_quaternion(place.rotation),
            mass=inertia.mass,
            ipos=inertia.lever,
            fullinertia=matrix[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]],
            explicitinertial=True,
        )
        if "FreeFlyer" in source.joints[joint].shortname():
            body.add_freejoint(name=source.names[joint])
            return body
        if source.nqs[joint] != 1 or source.nvs[joint] != 1:
            raise RuntimeError(f"joint {source.names[joint]} is neither a hinge nor a slide")
        # a joint's own column, in its own frame, is the same at every q
        q, v = source.idx_qs[joint], source.idx_vs[joint]
        column = pin.computeJointJacobian(source, source.createData(), pin.neutral(source), joint)[:, v]
        slides = bool(np.any(column[:3]))
        lower, upper = source.lowerPositionLimit[q], source.upperPositionLimit[q]
        body.add_joint(
            name=source.names[joint],
            type=mujoco.mjtJoint.mjJNT_SLIDE if slides else mujoco.mjtJoint.mjJNT_HINGE,
            axis=column[:3] if slides else column[3:],
            limited=bool(max(-lower, upper) < 1e100),
            range=[lower, upper],
            armature=source.armature[v],
            damping=source.damping[v],
        )
        return body

    def _coordinates(self) -> None:
        """Find the indices of joints with one coordinate in MuJoCo's q and v and in Pinocchio's."""
        joints = range(2 if self._base else 1, self._source.njoints)
        mine = [self.model.joint(self._source.names[j]) for j in joints]
        self._here = np.array([int(m.qposadr[0]) for m in mine])
        self._mine = np.array([int(m.dofadr[0]) for m in mine])
        self._q_there = np.array([self._source.idx_qs[j] for j in joints])
        self._v_there = np.array([self._source.idx_vs[j] for j in joints])

    def _check(self, problem: Problem) -> None:
        """Compare inertia and gravity at the start."""
        source, model, data, turn = self._source, self.model, self.data, self._to_mujoco
        self._reset()
        data.qvel[:] = 0.0
        mujoco.mj_forward(model, data)
        mass = np.empty((model.nv, model.nv))
        for k, unit in enumerate(np.eye(model.nv)):
            mujoco.mj_mulM(model, data, mass[k], unit)
        own = source.createData()
        theirs = np.array(pin.crba(source, own, problem.q0))
        weight = pin.computeGeneralizedGravity(source, own, problem.q0)
        for what, a, b in (("mass matrix", turn.T @ mass @ turn, theirs), ("gravity", turn.T @ data.qfrc_bias, weight)):
            off = np.abs(a - b).max() / max(np.abs(b).max(), 1e-300)
            if off > _AGREEMENT:
                raise RuntimeError(f"{source.name}: MuJoCo's {what} differs by {off:.1e} of its largest entry")


def _add_field(spec: Any, item: SurfaceItem) -> None:
    """Add a height field, which MuJoCo divides into the same triangles."""
    if item.heights is None or item.size is None or item.motion is not None:
        raise InputError(f"{item.name} must be a height field at rest")
    low, high = float(item.heights.min()), float(item.heights.max())
    rows, columns = item.heights.shape
    half, spread = [0.5 * length for length in item.size], max(high - low, 1e-9)
    spec.add_hfield(
        name=item.name, size=[*half, spread, 0.1], nrow=rows, ncol=columns,
        userdata=((item.heights - low) / spread).ravel(),
    )  # fmt: skip
    place = item.position + low * item.rotation[:, 2]
    kind = mujoco.mjtGeom.mjGEOM_HFIELD
    spec.worldbody.add_geom(type=kind, hfieldname=item.name, pos=place, quat=_quaternion(item.rotation))


def _add_geom(spec: Any, body: Any, placed: PlacedShape) -> None:
    geom = body.add_geom(name=placed.name, pos=placed.position, quat=_quaternion(placed.rotation))
    kinds, shape = mujoco.mjtGeom, placed.shape
    match shape:
        case Sphere():
            geom.type, geom.size = kinds.mjGEOM_SPHERE, [shape.radius, 0.0, 0.0]
        case Ellipsoid():
            geom.type, geom.size = kinds.mjGEOM_ELLIPSOID, shape.radii
        case Box():
            geom.type, geom.size = kinds.mjGEOM_BOX, 0.5 * np.array(shape.size)
        case Capsule():
            geom.type, geom.size = kinds.mjGEOM_CAPSULE, [shape.radius, 0.5 * shape.length, 0.0]
        case Cylinder():
            geom.type, geom.size = kinds.mjGEOM_CYLINDER, [shape.radius, 0.5 * shape.length, 0.0]
        case Hull():
            spec.add_mesh(name=placed.name, uservert=shape.vertices.ravel(), userface=shape.triangles.ravel())
            geom.type, geom.meshname = kinds.mjGEOM_MESH, placed.name


def _leave_out(spec: Any, bodies: list, scene: BuiltScene, model: pin.Model) -> None:
    """Leave out the pairs of shapes that mbvi leaves out; MuJoCo excludes pairs of bodies only."""
    (robot,) = scene.items.robots
    out: dict[tuple[int, int], list[tuple[str, str]]] = defaultdict(list)
    kept: dict[tuple[int, int], list[tuple[str, str]]] = defaultdict(list)
    for a, b in combinations(scene.shapes, 2):
        if a.body != b.body:
            side = out if (a.name, b.name) in robot.robot.apart else kept
            side[a.body, b.body].append((a.name, b.name))
    parents = model.parents
    for pair in out:
        # MuJoCo itself excludes the pair of a moving body and its parent
        if pair[0] and parents[pair[1]] == pair[0]:
            continue
        spec.add_exclude(bodyname1=bodies[pair[0]].name, bodyname2=bodies[pair[1]].name)
        for first, second in kept.get(pair, ()):
            spec.add_pair(geomname1=first, geomname2=second)


def _damping_ratio(e: float) -> float:
    """Return the damping at which a linear spring has the restitution e; critical damping at 0."""
    return abs(np.log(e)) / np.hypot(np.pi, np.log(e)) if e > 0.0 else 1.0


def _quaternion(rotation: Array) -> Array:
    x, y, z, w = pin.Quaternion(np.ascontiguousarray(rotation)).coeffs()
    return np.array([w, x, y, z])
