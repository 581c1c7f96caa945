"""Drake: compliant point contact, integrated continuously with error control."""

from __future__ import annotations

from importlib.metadata import version

import numpy as np
from pydrake.geometry import (
    AddContactMaterial,
    HalfSpace,
    ProximityProperties,
    SceneGraphConfig,
)
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, ContactModel, CoulombFriction
from pydrake.systems.analysis import ResetIntegratorFromFlags, Simulator
from pydrake.systems.framework import DiagramBuilder
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from .rig import Rig, State

NAME = f"Drake {version('drake')}"
_ACCURACY = 1e-3
_METHOD = "runge_kutta3"
_LEAST = 0.05


class Drake:
    """A rig in Drake; h says how stiff contacts are, omega h = 1."""

    continuous = True

    def __init__(self, rig: Rig, e: float, h: float) -> None:
        stiffness, dissipation = rig.mass / h**2, _dissipation(e, rig.closing)
        builder = DiagramBuilder()
        plant, graph = AddMultibodyPlantSceneGraph(builder, 0.0)
        config = SceneGraphConfig()
        # two in series: each is twice as stiff
        config.default_proximity_properties.point_stiffness = 2 * stiffness
        config.default_proximity_properties.hunt_crossley_dissipation = dissipation
        config.default_proximity_properties.dynamic_friction = 0.0
        config.default_proximity_properties.static_friction = 0.0
        graph.set_config(config)
        Parser(plant).AddModelsFromString(rig.urdf, "urdf")
        if not rig.free:
            plant.WeldFrames(plant.world_frame(), plant.GetFrameByName(rig.base))
        for k, (normal, offset) in enumerate(rig.planes):
            properties = ProximityProperties()
            AddContactMaterial(dissipation, 2 * stiffness, CoulombFriction(0.0, 0.0), properties)
            pose = HalfSpace.MakePose(normal, offset * normal)
            plant.RegisterCollisionGeometry(plant.world_body(), pose, HalfSpace(), f"plane {k}", properties)
        plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, -9.81])
        plant.set_contact_model(ContactModel.kPoint)
        plant.Finalize()
        self._plant, self._body, self._free, self._h = plant, plant.GetBodyByName(rig.base), rig.free, h
        self._simulator = Simulator(builder.Build())
        ResetIntegratorFromFlags(self._simulator, _METHOD, h)
        self._simulator.get_mutable_integrator().set_target_accuracy(_ACCURACY)
        self._context = plant.GetMyMutableContextFromRoot(self._simulator.get_mutable_context())
        self._joints = [plant.GetJointByName(name) for name in rig.joints]
        self.settings = (
            f"continuous, {_METHOD} at accuracy {_ACCURACY:g} and at most h a step, point contact of stiffness m / h^2 "
            f"(m = {rig.mass:.3g} kg), Hunt-Crossley dissipation {dissipation:.3g} s/m: throws back at e from the "
            f"first impact's {rig.closing:.3g} m/s, for its restitution depends on speed; friction 0"
        )

    def start(self, state: State) -> None:
        """Put the rig there."""
        if self._free:
            turn = Rotation.from_quat(state.quaternion).as_matrix()
            pose = RigidTransform(np.vstack([np.column_stack([turn, state.position]), [0, 0, 0, 1]]))
            self._plant.SetFreeBodyPose(self._context, self._body, pose)
            self._plant.SetFreeBodySpatialVelocity(
                self._context, self._body, SpatialVelocity(np.array(state.angular), np.array(state.linear))
            )
        for joint, angle, rate in zip(self._joints, state.angles, state.rates, strict=True):
            joint.set_angle(self._context, float(angle))
            joint.set_angular_rate(self._context, float(rate))
        self._simulator.get_mutable_context().SetTime(0.0)
        self._simulator.Initialize()
        self._taken = 0

    def advance(self) -> None:
        """Go on by h."""
        self.many(1)

    def many(self, count: int) -> None:
        """Go on by several h, in steps of its own."""
        self._taken += count
        self._simulator.AdvanceTo(self._taken * self._h)

    def read(self) -> State:
        """Return where the rig is."""
        angles = np.array([joint.get_angle(self._context) for joint in self._joints])
        rates = np.array([joint.get_angular_rate(self._context) for joint in self._joints])
        pose = self._body.EvalPoseInWorld(self._context)
        speed = self._body.EvalSpatialVelocityInWorld(self._context)
        turn = Rotation.from_matrix(pose.rotation().matrix()).as_quat()
        # what Drake hands out is read-only
        place, linear, spin = (np.array(x) for x in (pose.translation(), speed.translational(), speed.rotational()))
        return State(place, turn, angles, linear, spin, rates)


Peer = Drake


def _dissipation(e: float, speed: float) -> float:
    """Return d with which f = k x (1 + d dx/dt) throws back at e, 0.05 at least, from that speed [s/m]."""
    if e >= 1.0:
        return 0.0
    e = max(e, _LEAST)
    # the energy lost while x goes in and out: log((1 + a) / (1 - e a)) = a (1 + e), a = d speed
    a = brentq(lambda a: np.log((1 + a) / (1 - e * a)) - a * (1 + e), 0.5 * (1 - e), (1 - 1e-12) / e)
    return float(a / speed)
