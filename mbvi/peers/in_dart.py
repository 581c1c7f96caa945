"""DART: impulses with restitution by a boxed LCP, in reduced coordinates."""

from __future__ import annotations

import tempfile
from importlib.metadata import version
from pathlib import Path

import dartpy as dart
import numpy as np
from scipy.spatial.transform import Rotation

from .rig import Rig, State

NAME = f"DART {version('dartpy')}"
_CONTACTS = 1000


class Dart:
    """A rig in DART."""

    settings = (
        f"Dantzig's boxed LCP, at most {_CONTACTS} contacts, its own collision detector, restitution e on the rig "
        "and 1 on planes, friction and damping 0; it knows no restitution below 0.1 m/s, which cannot be set"
    )

    continuous = False

    def __init__(self, rig: Rig, e: float, h: float) -> None:
        self._world = dart.simulation.World()
        self._world.setTimeStep(h)
        self._world.setGravity(np.array([0.0, 0.0, -9.81]))
        solver = self._world.getConstraintSolver()
        solver.setCollisionDetector(dart.collision.DARTCollisionDetector())
        solver.getCollisionOption().maxNumContacts = _CONTACTS
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "rig.urdf"
            file.write_text(rig.urdf)
            loader = dart.utils.DartLoader()
            roots = dart.utils.DartLoaderRootJointType
            options = dart.utils.DartLoaderOptions()
            options.mDefaultRootJointType = roots.FLOATING if rig.free else roots.FIXED
            loader.setOptions(options)
            self._rig = loader.parseSkeleton(str(file))
        self._rig.disableSelfCollisionCheck()
        self._world.addSkeleton(self._rig)
        for k, (normal, offset) in enumerate(rig.planes):
            ground = dart.dynamics.Skeleton(f"plane {k}")
            _, body = ground.createWeldJointAndBodyNodePair()
            shape = body.createShapeNode(dart.dynamics.PlaneShape(normal, offset))
            shape.createCollisionAspect()
            _slippery(shape.createDynamicsAspect(), 1.0)
            self._world.addSkeleton(ground)
        for k in range(self._rig.getNumBodyNodes()):
            body = self._rig.getBodyNode(k)
            for j in range(body.getNumShapeNodes()):
                node = body.getShapeNode(j)
                if node.hasDynamicsAspect():
                    _slippery(node.getDynamicsAspect(), e)
        self._joints = [self._rig.getJoint(name) for name in rig.joints]
        self._root, self._free = self._rig.getRootBodyNode(), rig.free

    def start(self, state: State) -> None:
        """Put the rig there."""
        if self._free:
            joint = self._rig.getRootJoint()
            turn = Rotation.from_quat(state.quaternion)
            pose = dart.math.Isometry3()
            pose.set_rotation(turn.as_matrix())
            pose.set_translation(state.position)
            joint.setPositions(dart.dynamics.FreeJoint.convertToPositions(pose))
            # velocities in the body's frame, the angular one first
            spin, linear = turn.apply(state.angular, inverse=True), turn.apply(state.linear, inverse=True)
            joint.setVelocities(np.concatenate([spin, linear]))
        for joint, angle, rate in zip(self._joints, state.angles, state.rates, strict=True):
            joint.setPosition(0, float(angle))
            joint.setVelocity(0, float(rate))

    def advance(self) -> None:
        """Take a step."""
        self._world.step()

    def read(self) -> State:
        """Return where the rig is."""
        angles = np.array([joint.getPosition(0) for joint in self._joints])
        rates = np.array([joint.getVelocity(0) for joint in self._joints])
        if not self._free:
            still = np.zeros(3)
            return State(still, np.array([0.0, 0.0, 0.0, 1.0]), angles, still, still, rates)
        pose = self._root.getWorldTransform()
        linear, spin = self._root.getLinearVelocity(), self._root.getAngularVelocity()
        return State(
            np.array(pose.translation()), Rotation.from_matrix(pose.rotation()).as_quat(), angles, np.array(linear),
            np.array(spin), rates,
        )  # fmt: skip


Peer = Dart


def _slippery(aspect: dart.dynamics.DynamicsAspect, e: float) -> None:
    aspect.setFrictionCoeff(0.0)
    aspect.setRestitutionCoeff(e)
