"""Adapter to Drake: compliant point contact, integrated with error control."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.metadata import version

import numpy as np
from pydrake.geometry import (
    AddContactMaterial,
    Box,
    CollisionFilterDeclaration,
    GeometryId,
    GeometrySet,
    HalfSpace,
    ProximityProperties,
    SceneGraphConfig,
    Shape,
    Sphere,
)
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, ContactModel, CoulombFriction, MultibodyPlant
from pydrake.multibody.tree import RevoluteJoint, RigidBody, RotationalInertia, SpatialInertia
from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator
from pydrake.systems.framework import Context, DiagramBuilder
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from mbvi.geometry.shapes import shapes as ours

from .bodies import Bodies, Poses
from .rig import Array, Rig, State

NAME = f"Drake {version('drake')}"
# errors of runs that the engine gives up
FAILURES: tuple[type[Exception], ...] = (RuntimeError,)
_ACCURACY = 1e-3
_METHOD = "runge_kutta3"
_LEAST = 0.05


class Drake:
    """A rig in Drake; h sets the stiffness of contacts by omega h = 1."""

    continuous = True

    def __init__(self, rig: Rig, e: float, h: float) -> None:
        stiffness, dissipation = rig.mass / h**2, _dissipation(e, rig.closing)
        builder = DiagramBuilder()
        plant, graph = AddMultibodyPlantSceneGraph(builder, 0.0)
        config = SceneGraphConfig()
        # two contacts in series, so each is twice as stiff
        config.default_proximity_properties.point_stiffness = 2 * stiffness
        config.default_proximity_properties.hunt_crossley_dissipation = dissipation
        config.default_proximity_properties.dynamic_friction = 0.0
        config.default_proximity_properties.static_friction = 0.0
        graph.set_config(config)
        Parser(plant).AddModelsFromString(rig.urdf, "urdf")
        if not rig.free:
            plant.WeldFrames(plant.world_frame(), plant.GetFrameByName(rig.base))
        _finish(plant, rig.planes, _material(2 * stiffness, dissipation), np.array([0.0, 0.0, -9.81]))
        self._plant, self._body, self._free, self._h = plant, plant.GetBodyByName(rig.base), rig.free, h
        self._simulator = _simulator(builder, h)
        self._context = plant.GetMyMutableContextFromRoot(self._simulator.get_mutable_context())
        self._joints = [plant.GetJointByName(name) for name in rig.joints]
        self.settings = _settings(f"{rig.mass:.3g} kg", dissipation, rig.closing)

    def start(self, state: State) -> None:
        """Set the state."""
        set_state(self._context, self._body if self._free else None, self._joints, state)
        self._simulator.get_mutable_context().SetTime(0.0)
        self._simulator.Initialize()
        self._taken = 0

    def advance(self) -> None:
        """Advance by h."""
        self.many(1)

    def many(self, count: int) -> None:
        """Advance by several h, in the engine's own steps."""
        self._taken += count
        self._simulator.AdvanceTo(self._taken * self._h)

    def read(self) -> State:
        """Return the state."""
        return read_state(self._context, self._body, self._joints)


Peer = Drake


class DrakeBodies:
    """Free bodies in Drake; corners of boxes are points, because Drake finds one contact point per pair of shapes."""

    continuous = True

    def __init__(self, model: Bodies, h: float) -> None:
        dissipation = _dissipation(model.e, model.closing)
        builder = DiagramBuilder()
        plant, graph = AddMultibodyPlantSceneGraph(builder, 0.0)
        self._bodies, shapes, boxes, corners = [], [], [], []
        for k, body in enumerate(model.bodies):
            inertia = SpatialInertia.MakeFromCentralInertia(body.mass, np.zeros(3), RotationalInertia(*body.inertia))
            here = plant.AddRigidBody(f"body {k}", inertia)
            material = _material(2 * body.mass / h**2, dissipation)
            own = _add(plant, here, _shape(body.shape), body.places, f"shape {k}", material)
            shapes += own
            if isinstance(body.shape, ours.Box):
                boxes += own
                corners += _add(plant, here, Sphere(0.0), body.shape.vertices, f"corner {k}", material)
            self._bodies.append(here)
        # fixed shapes are as stiff as the heaviest body
        material = _material(2 * max(body.mass for body in model.bodies) / h**2, dissipation)
        for k, (solid, centre) in enumerate(model.fixed):
            shapes += _add(plant, plant.world_body(), _shape(solid), centre[None], f"solid {k}", material)
        planes = GeometrySet(_finish(plant, model.planes, material, model.gravity))
        apart, points = CollisionFilterDeclaration(), GeometrySet(corners)
        apart.ExcludeBetween(GeometrySet(boxes), planes).ExcludeBetween(points, GeometrySet(shapes)).ExcludeWithin(
            points
        )
        graph.collision_filter_manager().Apply(apart)
        self._plant, self._h = plant, h
        self._simulator = _simulator(builder, h)
        self._context = plant.GetMyMutableContextFromRoot(self._simulator.get_mutable_context())
        first = np.array(
            [[body.floating_positions_start(), body.floating_velocities_start_in_v()] for body in self._bodies]
        )
        # quaternions with w first, and angular velocities, come first
        self._q, self._v = first[:, :1] + np.array([4, 5, 6, 1, 2, 3, 0]), first[:, 1:] + np.array([3, 4, 5, 0, 1, 2])
        settings = _settings("a body's mass, in series with the other's", dissipation, model.closing)
        self.settings = settings + ("; boxes touch planes with balls of no radius in their corners" if boxes else "")

    def start(self, state: Poses) -> None:
        """Set poses and velocities."""
        q, v = np.zeros(self._plant.num_positions()), np.zeros(self._plant.num_velocities())
        q[self._q] = np.hstack([state.position, state.quaternion])
        v[self._v] = np.hstack([state.linear, state.angular])
        self._plant.SetPositions(self._context, q)
        self._plant.SetVelocities(self._context, v)
        self._simulator.get_mutable_context().SetTime(0.0)
        self._simulator.Initialize()
        self._taken = 0

    def advance(self) -> None:
        """Advance by h, in the engine's own steps."""
        self._taken += 1
        self._simulator.AdvanceTo(self._taken * self._h)

    def read(self) -> Poses:
        """Return poses and velocities."""
        q = self._plant.GetPositions(self._context)[self._q]
        v = self._plant.GetVelocities(self._context)[self._v]
        # Drake's integrated quaternions leave the unit sphere; their direction counts
        return Poses(q[:, :3], q[:, 3:] / np.linalg.norm(q[:, 3:], axis=1)[:, None], v[:, :3], v[:, 3:])


Free = DrakeBodies


def set_state(context: Context, body: RigidBody | None, joints: Sequence[RevoluteJoint], state: State) -> None:
    """Set the joints, and pose and velocity of a body that floats, if any."""
    if body is not None:
        turn = Rotation.from_quat(state.quaternion).as_matrix()
        pose = RigidTransform(np.vstack([np.column_stack([turn, state.position]), [0, 0, 0, 1]]))
        plant = body.GetParentPlant()
        plant.SetFreeBodyPose(context, body, pose)
        speed = SpatialVelocity(np.array(state.angular), np.array(state.linear))
        plant.SetFreeBodySpatialVelocity(context, body, speed)
    for joint, angle, rate in zip(joints, state.angles, state.rates, strict=True):
        joint.set_angle(context, float(angle))
        joint.set_angular_rate(context, float(rate))


def read_state(context: Context, body: RigidBody, joints: Sequence[RevoluteJoint]) -> State:
    """Return the state of joints and of the body that they begin at."""
    angles = np.array([joint.get_angle(context) for joint in joints])
    rates = np.array([joint.get_angular_rate(context) for joint in joints])
    pose, speed = body.EvalPoseInWorld(context), body.EvalSpatialVelocityInWorld(context)
    turn = Rotation.from_matrix(pose.rotation().matrix()).as_quat()
    # arrays of Drake are read-only
    place, linear, spin = (np.array(x) for x in (pose.translation(), speed.translational(), speed.rotational()))
    return State(place, turn, angles, linear, spin, rates)


def _material(stiffness: float, dissipation: float) -> ProximityProperties:
    properties = ProximityProperties()
    AddContactMaterial(dissipation, stiffness, CoulombFriction(0.0, 0.0), properties)
    return properties


def _add(
    plant: MultibodyPlant, body: RigidBody, shape: Shape, places: Array, name: str, material: ProximityProperties
) -> list[GeometryId]:
    """Add a shape to a body at several positions; return the numbers of these geometries."""
    return [
        plant.RegisterCollisionGeometry(body, RigidTransform(place), shape, f"{name} {j}", material)
        for j, place in enumerate(places)
    ]


def _finish(
    plant: MultibodyPlant, planes: Sequence[tuple[Array, float]], material: ProximityProperties, gravity: Array
) -> list[GeometryId]:
    """Add planes and gravity, and finalize; return the planes."""
    numbers = []
    for k, (normal, offset) in enumerate(planes):
        pose = HalfSpace.MakePose(normal, offset * normal)
        numbers.append(plant.RegisterCollisionGeometry(plant.world_body(), pose, HalfSpace(), f"plane {k}", material))
    plant.mutable_gravity_field().set_gravity_vector(gravity)
    plant.set_contact_model(ContactModel.kPoint)
    plant.Finalize()
    return numbers


def _simulator(builder: DiagramBuilder, h: float) -> Simulator:
    simulator = Simulator(builder.Build())
    ResetIntegratorFromFlags(simulator, _METHOD, h)
    simulator.get_mutable_integrator().set_target_accuracy(_ACCURACY)
    return simulator


def _shape(shape: ours.Sphere | ours.Box) -> Shape:
    return Sphere(shape.radius) if isinstance(shape, ours.Sphere) else Box(*shape.size)


def _settings(mass: str, dissipation: float, closing: float) -> str:
    return (
        f"continuous, {_METHOD} at accuracy {_ACCURACY:g} and at most h a step, point contact of stiffness m / h^2 "
        f"(m = {mass}), Hunt-Crossley dissipation {dissipation:.3g} s/m: throws back at e from the "
        f"first impact's {closing:.3g} m/s, for its restitution depends on speed; friction 0"
    )


def _dissipation(e: float, speed: float) -> float:
    """Return d with which f = k x (1 + d dx/dt) throws back at e, 0.05 at least, from that speed [s/m]."""
    if e >= 1.0:
        return 0.0
    e = max(e, _LEAST)
    # the energy lost while x goes in and out: log((1 + a) / (1 - e a)) = a (1 + e), a = d speed
    a = brentq(lambda a: np.log((1 + a) / (1 - e * a)) - a * (1 + e), 0.5 * (1 - e), (1 - 1e-12) / e)
    return float(a / speed)
