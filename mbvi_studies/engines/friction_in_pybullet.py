"""Scenes with friction in PyBullet: sequential impulses as delivered, but for damping."""

from __future__ import annotations

import pybullet as p

from ..chart.friction import Rough
from .in_pybullet import FAILURES, NAME, UrdfBody, new_world
from .rig import State
from .variant import Variant

__all__ = ["FAILURES", "VARIANTS"]

_ITERATIONS = 50


class RoughInPyBullet:
    """A scene with friction.

    Parameters
    ----------
    rough : Rough
        The scene.
    h : float
        Time step [s].
    """

    def __init__(self, rough: Rough, h: float) -> None:
        new_world(rough.gravity, h, numSolverIterations=_ITERATIONS)
        plane = p.createMultiBody(0, p.createCollisionShape(p.GEOM_PLANE, planeNormal=[0.0, 0.0, 1.0]))
        self._body, self._rough = UrdfBody(rough.urdf, rough.joints, free=True), rough
        # the coefficients of both are multiplied
        p.changeDynamics(plane, -1, lateralFriction=1.0)
        for link in self._body.links:
            p.changeDynamics(
                self._body.number, link, lateralFriction=rough.mu, spinningFriction=0.0, rollingFriction=0.0,
                linearDamping=0.0, angularDamping=0.0, jointDamping=0.0, maxJointVelocity=1e6,
                activationState=p.ACTIVATION_STATE_DISABLE_SLEEPING,
            )  # fmt: skip
        self._body.set(rough.start)
        self._body.release()

    def advance(self) -> None:
        """Advance by one step."""
        self._body.push(self._rough.torque(*self._body.angles()))
        p.stepSimulation()

    def read(self) -> State:
        """Return the state."""
        return self._body.read()


VARIANTS = (
    Variant(
        f"{NAME}, {_ITERATIONS} iterations",
        "sequential impulses, damping 0, other options as delivered",
        RoughInPyBullet,
    ),
)
