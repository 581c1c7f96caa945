"""Adapter to DART: impulses with restitution by a boxed LCP, in reduced coordinates."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from importlib.metadata import version
from pathlib import Path

import dartpy as dart
import numpy as np
from scipy.spatial.transform import Rotation

from mbvi.geometry.shapes.shapes import Box, Sphere

from .bodies import Bodies, Body, Poses
from .rig import Array, Rig, State

NAME = f"DART {version('dartpy')}"
# errors of runs that the engine gives up
FAILURES: tuple[type[Exception], ...] = (RuntimeError,)
_CONTACTS = 1000
_SETTINGS = (
    f"Dantzig's boxed LCP, at most {_CONTACTS} contacts, friction and damping 0; "
    "it knows no restitution below 0.1 m/s, which cannot be set"
)


class Dart:
    """A rig in DART."""

    settings = f"{_SETTINGS}, its own collision detector, restitution e on the rig and 1 on planes"

    continuous = False

    def __init__(self, rig: Rig, e: float, h: float) -> None:
        detector = dart.collision.DARTCollisionDetector()
        self._world = _world(detector, np.array([0.0, 0.0, -9.81]), rig.planes, 1.0, h)
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
        for k in range(self._rig.getNumBodyNodes()):
            body = self._rig.getBodyNode(k)
            for j in range(body.getNumShapeNodes()):
                node = body.getShapeNode(j)
                if node.hasDynamicsAspect():
                    _slippery(node.getDynamicsAspect(), e)
        self._joints = [self._rig.getJoint(name) for name in rig.joints]
        self._root, self._free = self._rig.getRootBodyNode(), rig.free

    def start(self, state: State) -> None:
        """Set the state."""
        if self._free:
            _set_free(self._rig.getRootJoint(), state.position, state.quaternion, state.linear, state.angular)
        for joint, angle, rate in zip(self._joints, state.angles, state.rates, strict=True):
            joint.setPosition(0, float(angle))
            joint.setVelocity(0, float(rate))

    def advance(self) -> None:
        """Advance by one step."""
        self._world.step()

    def read(self) -> State:
        """Return the state."""
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


class DartBodies:
    """Free bodies in DART: balls have no rotation; ODE detects collisions, because DART finds one point under a box."""

    settings = f"{_SETTINGS}, ODE's collision detector, restitution sqrt(e) on everything, for it multiplies both"
    continuous = False

    def __init__(self, model: Bodies, h: float) -> None:
        own = float(np.sqrt(model.e))
        self._world = _world(dart.collision.OdeCollisionDetector(), model.gravity, model.planes, own, h)
        for k, (solid, centre) in enumerate(model.fixed):
            ground = dart.dynamics.Skeleton(f"solid {k}")
            _, node = ground.createWeldJointAndBodyNodePair()
            _add(node, _shape(solid), centre, own)
            self._world.addSkeleton(ground)
        self._bodies = [self._body(f"body {k}", body, own) for k, body in enumerate(model.bodies)]

    def _body(self, name: str, body: Body, e: float) -> tuple[dart.dynamics.Joint, dart.dynamics.BodyNode, bool]:
        skeleton = dart.dynamics.Skeleton(name)
        if body.turns:
            joint, node = skeleton.createFreeJointAndBodyNodePair()
        else:
            joint, node = skeleton.createTranslationalJointAndBodyNodePair()
        node.setInertia(dart.dynamics.Inertia(body.mass, np.zeros(3), np.diag(body.inertia)))
        shape = _shape(body.shape)
        for place in body.places:
            _add(node, shape, place, e)
        self._world.addSkeleton(skeleton)
        return joint, node, body.turns

    def start(self, state: Poses) -> None:
        """Set poses and velocities."""
        for (joint, _, turns), place, turn, linear, spin in zip(self._bodies, *state, strict=True):
            if turns:
                _set_free(joint, place, turn, linear, spin)
            else:
                joint.setPositions(place)
                joint.setVelocities(linear)

    def advance(self) -> None:
        """Advance by one step."""
        self._world.step()

    def read(self) -> Poses:
        """Return poses and velocities."""
        poses = [node.getWorldTransform() for _, node, _ in self._bodies]
        turns = Rotation.from_matrix([pose.rotation() for pose in poses]).as_quat()
        linear, spins = (np.array([rate(n) for _, n, _ in self._bodies]) for rate in (_linear, _spin))
        return Poses(np.array([pose.translation() for pose in poses]), turns, linear, spins)


Free = DartBodies


def _world(
    detector: dart.collision.CollisionDetector, gravity: Array, planes: Sequence[tuple[Array, float]], e: float,
    h: float,
) -> dart.simulation.World:  # fmt: skip
    """Return a world with planes of a restitution."""
    world = dart.simulation.World()
    world.setTimeStep(h)
    world.setGravity(gravity)
    solver = world.getConstraintSolver()
    solver.setCollisionDetector(detector)
    solver.getCollisionOption().maxNumContacts = _CONTACTS
    for k, (normal, offset) in enumerate(planes):
        ground = dart.dynamics.Skeleton(f"plane {k}")
        _, body = ground.createWeldJointAndBodyNodePair()
        _add(body, dart.dynamics.PlaneShape(normal, offset), np.zeros(3), e)
        world.addSkeleton(ground)
    return world


def _add(node: dart.dynamics.BodyNode, shape: dart.dynamics.Shape, place: Array, e: float) -> None:
    there = node.createShapeNode(shape)
    there.setRelativeTranslation(place)
    there.createCollisionAspect()
    _slippery(there.createDynamicsAspect(), e)


def _shape(shape: Sphere | Box) -> dart.dynamics.Shape:
    if isinstance(shape, Sphere):
        return dart.dynamics.SphereShape(shape.radius)
    return dart.dynamics.BoxShape(np.array(shape.size))


def _set_free(joint: dart.dynamics.FreeJoint, place: Array, quaternion: Array, linear: Array, spin: Array) -> None:
    turn, pose = Rotation.from_quat(quaternion), dart.math.Isometry3()
    pose.set_rotation(turn.as_matrix())
    pose.set_translation(place)
    joint.setPositions(dart.dynamics.FreeJoint.convertToPositions(pose))
    # velocities in the body's frame, the angular one first
    joint.setVelocities(np.concatenate([turn.apply(spin, inverse=True), turn.apply(linear, inverse=True)]))


def _linear(node: dart.dynamics.BodyNode) -> Array:
    return np.array(node.getLinearVelocity())


def _spin(node: dart.dynamics.BodyNode) -> Array:
    return np.array(node.getAngularVelocity())


def _slippery(aspect: dart.dynamics.DynamicsAspect, e: float) -> None:
    aspect.setFrictionCoeff(0.0)
    aspect.setRestitutionCoeff(e)
