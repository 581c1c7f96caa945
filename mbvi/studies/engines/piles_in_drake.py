"""Piles in Drake: its discrete contact solvers, with the stiffness and dissipation of contacts as delivered."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.metadata import version

import numpy as np
from pydrake.geometry import Box as DrakeBox
from pydrake.geometry import Capsule as DrakeCapsule
from pydrake.geometry import HalfSpace, Shape
from pydrake.geometry import Sphere as DrakeSphere
from pydrake.math import RigidTransform
from pydrake.multibody.plant import (
    AddMultibodyPlantSceneGraph,
    ContactModel,
    CoulombFriction,
    DiscreteContactApproximation,
)
from pydrake.multibody.tree import RotationalInertia, SpatialInertia
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder

from ...geometry.shapes import Box, Capsule, Sphere
from ..chart.errors import Array
from ..chart.piles import Pile

NAME = f"Drake {version('drake')}"


@dataclass(frozen=True)
class Solver:
    """A discrete contact solver."""

    line: str
    approximation: DiscreteContactApproximation
    setting: str = "discrete steps, point contact of the delivered stiffness"

    def make(self, pile: Pile, h: float) -> PileInDrake:
        """Return the adapter with a pile at its start."""
        return PileInDrake(pile, h, self.approximation)


def variants(pile: Pile) -> tuple[Solver, ...]:
    """Return how Drake is set."""
    return (Solver(f"{NAME}, SAP, one point per pair", DiscreteContactApproximation.kSap),)


class PileInDrake:
    """A pile, all bodies free.

    Parameters
    ----------
    pile : Pile
        The pile.
    h : float
        Time step [s].
    approximation : DiscreteContactApproximation
        The contact solver.
    """

    def __init__(self, pile: Pile, h: float, approximation: DiscreteContactApproximation) -> None:
        builder = DiagramBuilder()
        plant, _ = AddMultibodyPlantSceneGraph(builder, h)
        plant.set_contact_model(ContactModel.kPoint)
        plant.set_discrete_contact_approximation(approximation)
        friction = CoulombFriction(pile.mu, pile.mu)
        for k, (normal, offset) in enumerate(pile.planes):
            pose = HalfSpace.MakePose(normal, offset * normal)
            plant.RegisterCollisionGeometry(plant.world_body(), pose, HalfSpace(), f"plane {k}", friction)
        bodies = []
        for k, shape in enumerate(pile.shapes):
            inertia = SpatialInertia.MakeFromCentralInertia(
                1.0, np.zeros(3), RotationalInertia(*np.diag(shape.inertia(1.0)))
            )
            bodies.append(plant.AddRigidBody(f"body {k}", inertia))
            plant.RegisterCollisionGeometry(bodies[-1], RigidTransform(), _shape(shape), f"shape {k}", friction)
        plant.Finalize()
        self._plant, self._h, self._taken = plant, h, 0
        self._simulator = Simulator(builder.Build())
        self._context = plant.GetMyMutableContextFromRoot(self._simulator.get_mutable_context())
        first = np.array([body.floating_positions_start() for body in bodies])
        # quaternions with w first come before positions
        self._q = first[:, None] + np.array([4, 5, 6, 1, 2, 3, 0])
        q = np.zeros(plant.num_positions())
        q[self._q] = np.hstack([pile.centres, pile.turns])
        plant.SetPositions(self._context, q)
        self._simulator.Initialize()

    def advance(self) -> None:
        """Advance by one step."""
        self._taken += 1
        self._simulator.AdvanceTo(self._taken * self._h)

    def read(self) -> tuple[Array, Array]:
        """Return positions and quaternions of all bodies; see `PileEngine`."""
        q = self._plant.GetPositions(self._context)[self._q]
        return q[:, :3], q[:, 3:]


def _shape(shape: Box | Capsule | Sphere) -> Shape:
    if isinstance(shape, Sphere):
        return DrakeSphere(shape.radius)
    return DrakeCapsule(shape.radius, shape.length) if isinstance(shape, Capsule) else DrakeBox(*shape.size)
