"""Piles in PyBullet: sequential impulses with its options as delivered, but for damping."""

from __future__ import annotations

import numpy as np
import pybullet as p

from ..chart.piles import Pile, PilePoses
from .in_pybullet import NAME, collision_shape, new_world, wide_boxes
from .variant import Variant

_ITERATIONS = 50


def variants(pile: Pile) -> tuple[Variant[Pile, PilePoses], ...]:
    """Return how PyBullet is set: with the number of iterations as delivered."""
    setting = "sequential impulses, wide boxes for planes, damping 0"
    return (Variant(f"{NAME}, {_ITERATIONS} iterations", setting, PileInPyBullet),)


class PileInPyBullet:
    """A pile; wide boxes stand for planes, which find one point of a box per step.

    Parameters
    ----------
    pile : Pile
        The pile.
    h : float
        Time step [s].
    """

    def __init__(self, pile: Pile, h: float) -> None:
        new_world(np.array([0.0, 0.0, -9.81]), h, numSolverIterations=_ITERATIONS)
        planes = wide_boxes(pile.planes)
        shapes = {shape: collision_shape(shape) for shape in dict.fromkeys(pile.shapes)}
        self._bodies = [
            p.createMultiBody(1.0, shapes[shape], basePosition=centre, baseOrientation=turn)
            for shape, centre, turn in zip(pile.shapes, pile.centres.tolist(), pile.turns.tolist(), strict=True)
        ]
        for body in (*planes, *self._bodies):
            # the coefficients of both bodies are multiplied
            p.changeDynamics(
                body, -1, lateralFriction=float(np.sqrt(pile.mu)), spinningFriction=0.0, rollingFriction=0.0,
                restitution=0.0, linearDamping=0.0, angularDamping=0.0,
            )  # fmt: skip

    def advance(self) -> None:
        """Advance by one step."""
        p.stepSimulation()

    def read(self) -> PilePoses:
        """Return the poses of all bodies."""
        poses = [p.getBasePositionAndOrientation(body) for body in self._bodies]
        centres, turns = (np.array(x) for x in zip(*poses, strict=True))
        return centres, turns
