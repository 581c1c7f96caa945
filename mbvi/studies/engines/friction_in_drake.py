"""Scenes with friction in Drake: its discrete contact solvers, with the stiffness of contacts as delivered."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.metadata import version

import numpy as np
from pydrake.geometry import HalfSpace
from pydrake.math import RigidTransform
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import (
    AddMultibodyPlantSceneGraph,
    ContactModel,
    CoulombFriction,
    DiscreteContactApproximation,
)
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from scipy.spatial.transform import Rotation

from ..chart.friction import Rough
from .rig import State

NAME = f"Drake {version('drake')}"
# errors of runs that the engine gives up
FAILURES: tuple[type[Exception], ...] = (RuntimeError,)


@dataclass(frozen=True)
class Solver:
    """A discrete contact solver."""

    line: str
    approximation: DiscreteContactApproximation
    setting: str = "discrete steps, point contact of the delivered stiffness"

    def make(self, rough: Rough, h: float) -> RoughInDrake:
        """Return the adapter with a scene at its start."""
        return RoughInDrake(rough, h, self.approximation)


VARIANTS = (
    Solver(f"{NAME}, SAP", DiscreteContactApproximation.kSap),
    Solver(f"{NAME}, lagged", DiscreteContactApproximation.kLagged),
)


class RoughInDrake:
    """A scene with friction.

    Parameters
    ----------
    rough : Rough
        The scene.
    h : float
        Time step [s].
    approximation : DiscreteContactApproximation
        The contact solver.
    """

    def __init__(self, rough: Rough, h: float, approximation: DiscreteContactApproximation) -> None:
        builder = DiagramBuilder()
        plant, _ = AddMultibodyPlantSceneGraph(builder, h)
        plant.set_contact_model(ContactModel.kPoint)
        plant.set_discrete_contact_approximation(approximation)
        # the coefficient of a pair is the harmonic mean of both, and that of a URDF is 1 by default
        own = "".join(f'<drake:mu_{kind} value="{rough.mu}"/>' for kind in ("static", "dynamic"))
        own = f"<drake:proximity_properties>{own}</drake:proximity_properties></collision>"
        Parser(plant).AddModelsFromString(rough.urdf.replace("</collision>", own), "urdf")
        grip = CoulombFriction(rough.mu, rough.mu)
        plant.RegisterCollisionGeometry(plant.world_body(), RigidTransform(), HalfSpace(), "floor", grip)
        plant.mutable_gravity_field().set_gravity_vector(rough.gravity)
        plant.Finalize()
        self._plant, self._body, self._rough = plant, plant.GetBodyByName(rough.base), rough
        self._joints = [plant.GetJointByName(name) for name in rough.joints]
        self._h, self._taken = h, 0
        self._simulator = Simulator(builder.Build())
        self._context = plant.GetMyMutableContextFromRoot(self._simulator.get_mutable_context())
        self._q = np.array([joint.position_start() for joint in self._joints], dtype=int)
        self._v = np.array([joint.velocity_start() for joint in self._joints], dtype=int)
        self._start()

    def _start(self) -> None:
        start, plant = self._rough.start, self._plant
        turn = Rotation.from_quat(start.quaternion).as_matrix()
        pose = RigidTransform(np.vstack([np.column_stack([turn, start.position]), [0, 0, 0, 1]]))
        plant.SetFreeBodyPose(self._context, self._body, pose)
        speed = SpatialVelocity(np.array(start.angular), np.array(start.linear))
        plant.SetFreeBodySpatialVelocity(self._context, self._body, speed)
        for joint, angle, rate in zip(self._joints, start.angles, start.rates, strict=True):
            joint.set_angle(self._context, float(angle))
            joint.set_angular_rate(self._context, float(rate))
        self._simulator.Initialize()

    def advance(self) -> None:
        """Advance by one step."""
        if self._joints:
            plant, context = self._plant, self._context
            push = np.zeros(plant.num_velocities())
            angles, rates = plant.GetPositions(context)[self._q], plant.GetVelocities(context)[self._v]
            push[self._v] = self._rough.torque(angles, rates)
            plant.get_applied_generalized_force_input_port().FixValue(context, push)
        self._taken += 1
        self._simulator.AdvanceTo(self._taken * self._h)

    def read(self) -> State:
        """Return the state."""
        angles = np.array([joint.get_angle(self._context) for joint in self._joints])
        rates = np.array([joint.get_angular_rate(self._context) for joint in self._joints])
        pose = self._body.EvalPoseInWorld(self._context)
        speed = self._body.EvalSpatialVelocityInWorld(self._context)
        turn = Rotation.from_matrix(pose.rotation().matrix()).as_quat()
        place, linear, spin = (np.array(x) for x in (pose.translation(), speed.translational(), speed.rotational()))
        return State(place, turn, angles, linear, spin, rates)
