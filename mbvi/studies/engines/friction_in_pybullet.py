"""Scenes with friction in PyBullet: sequential impulses as delivered, but for damping."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pybullet as p
from scipy.spatial.transform import Rotation

from ..chart.friction import Rough
from .rig import State

NAME = f"PyBullet {version('pybullet')}"
# errors of runs that the engine gives up
FAILURES: tuple[type[Exception], ...] = (p.error,)


@dataclass(frozen=True)
class Iterations:
    """A number of solver iterations in each step."""

    line: str
    count: int
    setting: str = "sequential impulses, damping 0, other options as delivered"

    def make(self, rough: Rough, h: float) -> RoughInPyBullet:
        """Return the adapter with a scene at its start."""
        return RoughInPyBullet(rough, h, self.count)


VARIANTS = (Iterations(f"{NAME}, 50 iterations", 50),)


class RoughInPyBullet:
    """A scene with friction.

    Parameters
    ----------
    rough : Rough
        The scene.
    h : float
        Time step [s].
    iterations : int
        Iterations of the solver in each step.
    """

    def __init__(self, rough: Rough, h: float, iterations: int) -> None:
        if p.isConnected():
            p.disconnect()
        p.connect(p.DIRECT)
        p.setGravity(*rough.gravity.tolist())
        p.setPhysicsEngineParameter(fixedTimeStep=h, numSubSteps=0, numSolverIterations=iterations)
        plane = p.createMultiBody(0, p.createCollisionShape(p.GEOM_PLANE, planeNormal=[0.0, 0.0, 1.0]))
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "body.urdf"
            file.write_text(rough.urdf)
            self._body = p.loadURDF(str(file), flags=p.URDF_USE_INERTIA_FROM_FILE)
        # the coefficients of both are multiplied
        p.changeDynamics(plane, -1, lateralFriction=1.0)
        for link in range(-1, p.getNumJoints(self._body)):
            p.changeDynamics(
                self._body, link, lateralFriction=rough.mu, spinningFriction=0.0, rollingFriction=0.0,
                linearDamping=0.0, angularDamping=0.0, jointDamping=0.0, maxJointVelocity=1e6,
                activationState=p.ACTIVATION_STATE_DISABLE_SLEEPING,
            )  # fmt: skip
        names = {p.getJointInfo(self._body, k)[1].decode(): k for k in range(p.getNumJoints(self._body))}
        self._joints, self._rough = [names[name] for name in rough.joints], rough
        info = p.getDynamicsInfo(self._body, -1)
        # PyBullet's base frame is the centre of mass with principal axes
        self._centre, self._axes = np.array(info[3]), Rotation.from_quat(info[4])
        self._start()

    def _start(self) -> None:
        start = self._rough.start
        turn = Rotation.from_quat(start.quaternion)
        arm = turn.apply(self._centre)
        place = (start.position + arm).tolist(), (turn * self._axes).as_quat().tolist()
        p.resetBasePositionAndOrientation(self._body, *place)
        p.resetBaseVelocity(self._body, (start.linear + np.cross(start.angular, arm)).tolist(), start.angular.tolist())
        for joint, angle, rate in zip(self._joints, start.angles, start.rates, strict=True):
            p.resetJointState(self._body, joint, float(angle), float(rate))
        if self._joints:
            none = [0.0] * len(self._joints)
            p.setJointMotorControlArray(self._body, self._joints, p.VELOCITY_CONTROL, forces=none)

    def advance(self) -> None:
        """Advance by one step."""
        if self._joints:
            torques = self._rough.torque(*self._angles()).tolist()
            p.setJointMotorControlArray(self._body, self._joints, p.TORQUE_CONTROL, forces=torques)
        p.stepSimulation()

    def read(self) -> State:
        """Return the state."""
        angles, rates = self._angles()
        centre, axes = (np.array(x) for x in p.getBasePositionAndOrientation(self._body))
        linear, spin = (np.array(x) for x in p.getBaseVelocity(self._body))
        turn = Rotation.from_quat(axes) * self._axes.inv()
        arm = turn.apply(self._centre)
        return State(centre - arm, turn.as_quat(), angles, linear - np.cross(spin, arm), spin, rates)

    def _angles(self) -> tuple[np.ndarray, np.ndarray]:
        states = p.getJointStates(self._body, self._joints) if self._joints else ()
        return np.array([s[0] for s in states]), np.array([s[1] for s in states])
