"""PyBullet: impulses with restitution, in reduced coordinates."""

from __future__ import annotations

import tempfile
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pybullet as p
from scipy.spatial.transform import Rotation

from .rig import Array, Rig, State

NAME = f"PyBullet {version('pybullet')}"
_ITERATIONS, _RESIDUAL = 500, 1e-16


class PyBullet:
    """A rig in PyBullet."""

    settings = (
        "restitutionVelocityThreshold = contactBreakingThreshold = contactSlop = erp = contactERP = 0, "
        f"at most {_ITERATIONS} solver iterations, residual {_RESIDUAL:g}, restitution e on the rig and 1 on planes, "
        "friction, damping and joint motors 0"
    )

    continuous = False

    def __init__(self, rig: Rig, e: float, h: float) -> None:
        if p.isConnected():
            p.disconnect()
        p.connect(p.DIRECT)
        p.setGravity(0, 0, -9.81)
        p.setPhysicsEngineParameter(
            fixedTimeStep=h, numSubSteps=0, numSolverIterations=_ITERATIONS, solverResidualThreshold=_RESIDUAL,
            restitutionVelocityThreshold=0.0, contactBreakingThreshold=0.0, contactSlop=0.0, erp=0.0, contactERP=0.0,
            frictionERP=0.0, globalCFM=0.0,
        )  # fmt: skip
        for normal, offset in rig.planes:
            shape = p.createCollisionShape(p.GEOM_PLANE, planeNormal=normal.tolist())
            plane = p.createMultiBody(0, shape, basePosition=(offset * normal).tolist())
            p.changeDynamics(plane, -1, restitution=1.0, lateralFriction=0.0)
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "rig.urdf"
            file.write_text(rig.urdf)
            flags = p.URDF_USE_INERTIA_FROM_FILE
            self._rig = p.loadURDF(str(file), useFixedBase=not rig.free, flags=flags)
        names = {p.getJointInfo(self._rig, k)[1].decode(): k for k in range(p.getNumJoints(self._rig))}
        self._joints = [names[name] for name in rig.joints]
        for link in range(-1, p.getNumJoints(self._rig)):
            p.changeDynamics(
                self._rig, link, lateralFriction=0.0, spinningFriction=0.0, rollingFriction=0.0,
                linearDamping=0.0, angularDamping=0.0, jointDamping=0.0, maxJointVelocity=1e6,
            )  # fmt: skip
            # in one call with the others it is lost on links
            p.changeDynamics(self._rig, link, restitution=e)
        if self._joints:
            p.setJointMotorControlArray(self._rig, self._joints, p.VELOCITY_CONTROL, forces=[0.0] * len(self._joints))
        info = p.getDynamicsInfo(self._rig, -1)
        # its base is the centre of mass and its principal axes
        self._centre, self._axes = np.array(info[3]), Rotation.from_quat(info[4])
        self._free = rig.free

    def start(self, state: State) -> None:
        """Put the rig there."""
        if self._free:
            turn = Rotation.from_quat(state.quaternion)
            arm = turn.apply(self._centre)
            p.resetBasePositionAndOrientation(
                self._rig, (state.position + arm).tolist(), (turn * self._axes).as_quat().tolist()
            )
            linear = state.linear + np.cross(state.angular, arm)
            p.resetBaseVelocity(self._rig, linear.tolist(), state.angular.tolist())
        for joint, angle, rate in zip(self._joints, state.angles, state.rates, strict=True):
            p.resetJointState(self._rig, joint, float(angle), float(rate))

    def advance(self) -> None:
        """Take a step."""
        p.stepSimulation()

    def read(self) -> State:
        """Return where the rig is."""
        joints = [p.getJointState(self._rig, joint)[:2] for joint in self._joints]
        angles, rates = (np.array([j[k] for j in joints]) for k in (0, 1))
        if not self._free:
            still: Array = np.zeros(3)
            return State(still, np.array([0.0, 0.0, 0.0, 1.0]), angles, still, still, rates)
        centre, axes = (np.array(x) for x in p.getBasePositionAndOrientation(self._rig))
        linear, spin = (np.array(x) for x in p.getBaseVelocity(self._rig))
        turn = Rotation.from_quat(axes) * self._axes.inv()
        arm = turn.apply(self._centre)
        return State(centre - arm, turn.as_quat(), angles, linear - np.cross(spin, arm), spin, rates)


Peer = PyBullet
