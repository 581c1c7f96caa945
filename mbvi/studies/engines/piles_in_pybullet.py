"""Piles in PyBullet: sequential impulses with its options as delivered, but for damping."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.metadata import version

import numpy as np
import pybullet as p
from scipy.spatial.transform import Rotation

from ...geometry.shapes import Box, Capsule, Sphere
from ..chart.errors import Array
from ..chart.piles import Pile

NAME = f"PyBullet {version('pybullet')}"
# edge of the boxes that stand for planes: a plane finds one point of a box per step [m]
_WIDE = 20.0


@dataclass(frozen=True)
class Iterations:
    """A number of solver iterations in each step."""

    line: str
    count: int
    setting: str = "sequential impulses, wide boxes for planes, damping 0"

    def make(self, pile: Pile, h: float) -> PileInPyBullet:
        """Return the adapter with a pile at its start."""
        return PileInPyBullet(pile, h, self.count)


def variants(pile: Pile) -> tuple[Iterations, ...]:
    """Return how PyBullet is set: with the number of iterations as delivered."""
    return (Iterations(f"{NAME}, 50 iterations", 50),)


class PileInPyBullet:
    """A pile.

    Parameters
    ----------
    pile : Pile
        The pile.
    h : float
        Time step [s].
    iterations : int
        Iterations of the solver in each step.
    """

    def __init__(self, pile: Pile, h: float, iterations: int) -> None:
        if p.isConnected():
            p.disconnect()
        p.connect(p.DIRECT)
        p.setGravity(0.0, 0.0, -9.81)
        p.setPhysicsEngineParameter(fixedTimeStep=h, numSubSteps=0, numSolverIterations=iterations)
        up = np.array([[0.0, 0.0, 1.0]])
        solid = p.createCollisionShape(p.GEOM_BOX, halfExtents=3 * [0.5 * _WIDE])
        for normal, offset in pile.planes:
            turn = Rotation.align_vectors(normal[None], up)[0].as_quat()
            place = (offset - 0.5 * _WIDE) * normal
            plane = p.createMultiBody(0, solid, basePosition=place.tolist(), baseOrientation=turn.tolist())
            _set(plane, pile.mu)
        shapes = {shape: _shape(shape) for shape in dict.fromkeys(pile.shapes)}
        self._bodies = [
            p.createMultiBody(1.0, shapes[shape], basePosition=centre, baseOrientation=turn)
            for shape, centre, turn in zip(pile.shapes, pile.centres.tolist(), pile.turns.tolist(), strict=True)
        ]
        for body in self._bodies:
            _set(body, pile.mu)

    def advance(self) -> None:
        """Advance by one step."""
        p.stepSimulation()

    def read(self) -> tuple[Array, Array]:
        """Return positions and quaternions of all bodies; see `PileEngine`."""
        poses = [p.getBasePositionAndOrientation(body) for body in self._bodies]
        centres, turns = (np.array(x) for x in zip(*poses, strict=True))
        return centres, turns


def _set(body: int, mu: float) -> None:
    # the coefficients of both bodies are multiplied
    p.changeDynamics(
        body, -1, lateralFriction=float(np.sqrt(mu)), spinningFriction=0.0, rollingFriction=0.0, restitution=0.0,
        linearDamping=0.0, angularDamping=0.0,
    )  # fmt: skip


def _shape(shape: Box | Capsule | Sphere) -> int:
    if isinstance(shape, Sphere):
        return int(p.createCollisionShape(p.GEOM_SPHERE, radius=shape.radius))
    if isinstance(shape, Capsule):
        return int(p.createCollisionShape(p.GEOM_CAPSULE, radius=shape.radius, height=shape.length))
    return int(p.createCollisionShape(p.GEOM_BOX, halfExtents=(0.5 * np.array(shape.size)).tolist()))
