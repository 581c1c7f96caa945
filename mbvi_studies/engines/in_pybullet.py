"""Adapter to PyBullet: impulses with restitution, in reduced coordinates."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pybullet as p
from scipy.spatial.transform import Rotation

from mbvi.geometry.shapes.shapes import Box, Capsule, Sphere

from .bodies import Bodies, Body, Poses
from .rig import Array, Rig, State

NAME = f"PyBullet {version('pybullet')}"
# errors of runs that the engine gives up
FAILURES: tuple[type[Exception], ...] = (p.error,)
_ITERATIONS, _RESIDUAL = 500, 1e-16
# contactBreakingThreshold; at 0 an edge that lands flat on a plane is missed [m]
_BREAKING = 1e-3
# edge of the box that stands for a plane [m]
_WIDE = 20.0
_SETTINGS = (
    "restitutionVelocityThreshold = contactSlop = erp = contactERP = 0, "
    f"at most {_ITERATIONS} solver iterations, residual {_RESIDUAL:g}, friction and damping 0"
)


class PyBullet:
    """A rig in PyBullet."""

    settings = f"{_SETTINGS}, contactBreakingThreshold 0, joint motors 0, restitution e on the rig and 1 on planes"

    continuous = False

    def __init__(self, rig: Rig, e: float, h: float) -> None:
        _world(np.array([0.0, 0.0, -9.81]), rig.planes, 1.0, h, 0.0)
        self._rig = UrdfBody(rig.urdf, rig.joints, rig.free)
        for link in self._rig.links:
            _slippery(self._rig.number, link, e)
        self._rig.release()

    def start(self, state: State) -> None:
        """Set the state."""
        self._rig.set(state)

    def advance(self) -> None:
        """Advance by one step."""
        p.stepSimulation()

    def read(self) -> State:
        """Return the state."""
        return self._rig.read()


Peer = PyBullet


class PyBulletBodies:
    """Free bodies in PyBullet; a wide box stands for a plane, because a plane finds one point of a box per step."""

    continuous = False

    def __init__(self, model: Bodies, h: float) -> None:
        own = float(np.sqrt(model.e))
        boxes = any(isinstance(body.shape, Box) for body in model.bodies)
        _world(model.gravity, () if boxes else model.planes, own, h, _BREAKING)
        solids = [p.createMultiBody(0, collision_shape(x), basePosition=place.tolist()) for x, place in model.fixed]
        for solid in (*solids, *(wide_boxes(model.planes) if boxes else ())):
            _slippery(solid, -1, own)
        self.settings = (
            f"{_SETTINGS}, contactBreakingThreshold {_BREAKING:g} m, {'boxes for planes, ' if boxes else ''}"
            "restitution sqrt(e) on everything, for it multiplies both"
        )
        self._bodies = []
        for body in model.bodies:
            one = len(body.places) == 1
            number = p.createMultiBody(body.mass, collision_shape(body.shape)) if one else _loaded(body)
            p.changeDynamics(number, -1, localInertiaDiagonal=body.inertia.tolist())
            _slippery(number, -1, own)
            # never sleeps
            p.changeDynamics(number, -1, activationState=p.ACTIVATION_STATE_DISABLE_SLEEPING)
            self._bodies.append(number)

    def start(self, state: Poses) -> None:
        """Set poses and velocities."""
        for body, place, turn, linear, spin in zip(self._bodies, *(x.tolist() for x in state), strict=True):
            p.resetBasePositionAndOrientation(body, place, turn)
            p.resetBaseVelocity(body, linear, spin)

    def advance(self) -> None:
        """Advance by one step."""
        p.stepSimulation()

    def read(self) -> Poses:
        """Return poses and velocities."""
        poses = [p.getBasePositionAndOrientation(body) for body in self._bodies]
        rates = [p.getBaseVelocity(body) for body in self._bodies]
        return Poses(*(np.array(x, dtype=float) for both in (poses, rates) for x in zip(*both, strict=True)))


Free = PyBulletBodies


class UrdfBody:
    """A robot or body of a URDF in the world; `number` is its own, `links` those of its links.

    Parameters
    ----------
    urdf : str
        Text of the URDF.
    joints : sequence of str
        Names of joints, in the order of `State.angles`.
    free : bool
        Whether the root link floats.
    """

    def __init__(self, urdf: str, joints: Sequence[str], free: bool) -> None:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "body.urdf"
            file.write_text(urdf)
            self.number: int = p.loadURDF(str(file), useFixedBase=not free, flags=p.URDF_USE_INERTIA_FROM_FILE)
        self.links = range(-1, p.getNumJoints(self.number))
        names = {p.getJointInfo(self.number, k)[1].decode(): k for k in self.links[1:]}
        self._joints, self._free = [names[name] for name in joints], free
        info = p.getDynamicsInfo(self.number, -1)
        # PyBullet's base frame is the centre of mass with principal axes
        self._centre, self._axes = np.array(info[3]), Rotation.from_quat(info[4])

    def release(self) -> None:
        """Switch off the motors of the joints."""
        if self._joints:
            none = [0.0] * len(self._joints)
            p.setJointMotorControlArray(self.number, self._joints, p.VELOCITY_CONTROL, forces=none)

    def push(self, torques: Array) -> None:
        """Apply torques to the joints for one step."""
        if self._joints:
            p.setJointMotorControlArray(self.number, self._joints, p.TORQUE_CONTROL, forces=torques.tolist())

    def set(self, state: State) -> None:
        """Set the state."""
        if self._free:
            turn = Rotation.from_quat(state.quaternion)
            arm = turn.apply(self._centre)
            place = (state.position + arm).tolist(), (turn * self._axes).as_quat().tolist()
            p.resetBasePositionAndOrientation(self.number, *place)
            linear = state.linear + np.cross(state.angular, arm)
            p.resetBaseVelocity(self.number, linear.tolist(), state.angular.tolist())
        for joint, angle, rate in zip(self._joints, state.angles, state.rates, strict=True):
            p.resetJointState(self.number, joint, float(angle), float(rate))

    def angles(self) -> tuple[Array, Array]:
        """Return angles and rates of the joints."""
        states = p.getJointStates(self.number, self._joints) if self._joints else ()
        return np.array([s[0] for s in states]), np.array([s[1] for s in states])

    def read(self) -> State:
        """Return the state."""
        angles, rates = self.angles()
        if not self._free:
            still: Array = np.zeros(3)
            return State(still, np.array([0.0, 0.0, 0.0, 1.0]), angles, still, still, rates)
        centre, axes = (np.array(x) for x in p.getBasePositionAndOrientation(self.number))
        linear, spin = (np.array(x) for x in p.getBaseVelocity(self.number))
        turn = Rotation.from_quat(axes) * self._axes.inv()
        arm = turn.apply(self._centre)
        return State(centre - arm, turn.as_quat(), angles, linear - np.cross(spin, arm), spin, rates)


def new_world(gravity: Array, h: float, **options: float) -> None:
    """Create an empty world with a time step and other options of `setPhysicsEngineParameter`."""
    if p.isConnected():
        p.disconnect()
    p.connect(p.DIRECT)
    p.setGravity(*gravity.tolist())
    p.setPhysicsEngineParameter(fixedTimeStep=h, numSubSteps=0, **options)


def wide_boxes(planes: Sequence[tuple[Array, float]]) -> list[int]:
    """Add a wide box for each plane; return their numbers."""
    up, numbers = np.array([[0.0, 0.0, 1.0]]), []
    solid = collision_shape(Box((_WIDE, _WIDE, _WIDE)))
    for normal, offset in planes:
        turn = Rotation.align_vectors(normal[None], up)[0].as_quat().tolist()
        place = ((offset - 0.5 * _WIDE) * normal).tolist()
        numbers.append(p.createMultiBody(0, solid, basePosition=place, baseOrientation=turn))
    return numbers


def collision_shape(shape: Sphere | Box | Capsule) -> int:
    """Return the number of a new shape."""
    if isinstance(shape, Sphere):
        return int(p.createCollisionShape(p.GEOM_SPHERE, radius=shape.radius))
    if isinstance(shape, Capsule):
        return int(p.createCollisionShape(p.GEOM_CAPSULE, radius=shape.radius, height=shape.length))
    return int(p.createCollisionShape(p.GEOM_BOX, halfExtents=(0.5 * np.array(shape.size)).tolist()))


def _world(gravity: Array, planes: Sequence[tuple[Array, float]], e: float, h: float, breaking: float) -> None:
    """Create a world with planes of a restitution."""
    new_world(
        gravity, h, numSolverIterations=_ITERATIONS, solverResidualThreshold=_RESIDUAL,
        restitutionVelocityThreshold=0.0, contactBreakingThreshold=breaking, contactSlop=0.0, erp=0.0, contactERP=0.0,
        frictionERP=0.0, globalCFM=0.0,
    )  # fmt: skip
    for normal, offset in planes:
        shape = p.createCollisionShape(p.GEOM_PLANE, planeNormal=normal.tolist())
        plane = p.createMultiBody(0, shape, basePosition=(offset * normal).tolist())
        p.changeDynamics(plane, -1, restitution=e, lateralFriction=0.0)


def _slippery(body: int, link: int, e: float) -> None:
    p.changeDynamics(
        body, link, lateralFriction=0.0, spinningFriction=0.0, rollingFriction=0.0,
        linearDamping=0.0, angularDamping=0.0, jointDamping=0.0, maxJointVelocity=1e6,
    )  # fmt: skip
    # a separate call, because links ignore it together with the other parameters
    p.changeDynamics(body, link, restitution=e)


def _loaded(body: Body) -> int:
    """Return the number of a body of several balls, loaded from a file, because arrays are cut after 16 balls."""
    assert isinstance(body.shape, Sphere)
    x, y, z = body.inertia.tolist()
    parts = [
        f'<robot name="body"><link name="body"><inertial><mass value="{body.mass}"/>',
        f'<inertia ixx="{x}" iyy="{y}" izz="{z}" ixy="0" ixz="0" iyz="0"/></inertial>',
        *(
            f'<collision><origin xyz="{" ".join(map(repr, place))}"/>'
            f'<geometry><sphere radius="{body.shape.radius}"/></geometry></collision>'
            for place in body.places.tolist()
        ),
        "</link></robot>",
    ]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "body.urdf"
        # PyBullet cuts long lines
        file.write_text("\n".join(parts))
        number = int(p.loadURDF(str(file), flags=p.URDF_USE_INERTIA_FROM_FILE))
    assert len(p.getCollisionShapeData(number, -1)) == len(body.places)
    return number
