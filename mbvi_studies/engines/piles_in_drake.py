"""Piles in Drake: its discrete contact solvers, with the stiffness and dissipation of contacts as delivered."""

from __future__ import annotations

from functools import partial

import numpy as np
from pydrake.geometry import Box as DrakeBox
from pydrake.geometry import Capsule as DrakeCapsule
from pydrake.geometry import HalfSpace, Shape
from pydrake.geometry import Sphere as DrakeSphere
from pydrake.math import RigidTransform
from pydrake.multibody.plant import CoulombFriction, DiscreteContactApproximation
from pydrake.multibody.tree import RotationalInertia, SpatialInertia

from mbvi.geometry.shapes.shapes import Box, Capsule, Sphere

from ..chart.piles import Pile, PilePoses
from .discrete_drake import SETTING, DiscreteDrake
from .in_drake import NAME
from .variant import Variant


def variants(pile: Pile) -> tuple[Variant[Pile, PilePoses], ...]:
    """Return how Drake is set."""
    make = partial(PileInDrake, approximation=DiscreteContactApproximation.kSap)
    return (Variant(f"{NAME}, SAP, one point per pair", SETTING, make),)


class PileInDrake(DiscreteDrake):
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
        super().__init__(h, approximation)
        plant = self.plant
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
        self.finalize()
        first = np.array([body.floating_positions_start() for body in bodies])
        # quaternions with w first come before positions
        self._q = first[:, None] + np.array([4, 5, 6, 1, 2, 3, 0])
        q = np.zeros(plant.num_positions())
        q[self._q] = np.hstack([pile.centres, pile.turns])
        plant.SetPositions(self.context, q)
        self.simulator.Initialize()

    def read(self) -> PilePoses:
        """Return the poses of all bodies."""
        q = self.plant.GetPositions(self.context)[self._q]
        return q[:, :3], q[:, 3:]


def _shape(shape: Box | Capsule | Sphere) -> Shape:
    if isinstance(shape, Sphere):
        return DrakeSphere(shape.radius)
    return DrakeCapsule(shape.radius, shape.length) if isinstance(shape, Capsule) else DrakeBox(*shape.size)
