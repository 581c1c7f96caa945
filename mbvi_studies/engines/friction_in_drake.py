"""Scenes with friction in Drake: its discrete contact solvers, with the stiffness of contacts as delivered."""

from __future__ import annotations

from functools import partial

import numpy as np
from pydrake.geometry import HalfSpace
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import CoulombFriction, DiscreteContactApproximation

from ..chart.friction import Rough
from .discrete_drake import SETTING, DiscreteDrake
from .in_drake import FAILURES, NAME, read_state, set_state
from .rig import State
from .variant import Variant

__all__ = ["FAILURES", "VARIANTS"]


class RoughInDrake(DiscreteDrake):
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
        super().__init__(h, approximation)
        plant = self.plant
        # the coefficient of a pair is the harmonic mean of both, and that of a URDF is 1 by default
        own = "".join(f'<drake:mu_{kind} value="{rough.mu}"/>' for kind in ("static", "dynamic"))
        own = f"<drake:proximity_properties>{own}</drake:proximity_properties></collision>"
        Parser(plant).AddModelsFromString(rough.urdf.replace("</collision>", own), "urdf")
        grip = CoulombFriction(rough.mu, rough.mu)
        plant.RegisterCollisionGeometry(plant.world_body(), RigidTransform(), HalfSpace(), "floor", grip)
        plant.mutable_gravity_field().set_gravity_vector(rough.gravity)
        self.finalize()
        self._body, self._rough = plant.GetBodyByName(rough.base), rough
        self._joints = [plant.GetJointByName(name) for name in rough.joints]
        self._q = np.array([joint.position_start() for joint in self._joints], dtype=int)
        self._v = np.array([joint.velocity_start() for joint in self._joints], dtype=int)
        set_state(self.context, self._body, self._joints, rough.start)
        self.simulator.Initialize()

    def advance(self) -> None:
        """Advance by one step."""
        if self._joints:
            plant, context = self.plant, self.context
            push = np.zeros(plant.num_velocities())
            angles, rates = plant.GetPositions(context)[self._q], plant.GetVelocities(context)[self._v]
            push[self._v] = self._rough.torque(angles, rates)
            plant.get_applied_generalized_force_input_port().FixValue(context, push)
        super().advance()

    def read(self) -> State:
        """Return the state."""
        return read_state(self.context, self._body, self._joints)


VARIANTS = tuple(
    Variant(f"{NAME}, {name}", SETTING, partial(RoughInDrake, approximation=approximation))
    for name, approximation in (
        ("SAP", DiscreteContactApproximation.kSap),
        ("lagged", DiscreteContactApproximation.kLagged),
    )
)
