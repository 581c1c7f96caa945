"""Key frames of a replay, independent of the viewer: key times, placements, percussion arrows, and bounds."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, cast

import numpy as np
from scipy.spatial.transform import Rotation

from ...arguments import choice
from ...errors import InputError, MbviWarning
from ...geometry.shapes import Box, Capsule, Convex, Cylinder, Ellipsoid, PlacedShape, Sphere
from ...scene.visuals import visual_shapes

if TYPE_CHECKING:
    from ...geometry.motion import Motion as Drive
    from ...problem import Problem
    from ...scene.model import SceneModel

Array = np.ndarray

_FRAMES = 60.0
_MOST_INSTANTS = 2000
_MOST_ARROWS = 300
_MOST_POSES = 60


class PlayableRun(Protocol):
    """The part of a `Trajectory` that a replay needs."""

    @property
    def t(self) -> Array:
        """Times of the states [s]."""

    @property
    def impacts(self) -> tuple[Any, ...]:
        """Impacts in order of time."""

    @property
    def record(self) -> Any:
        """What the run keeps beside, such as `contacts`."""

    @property
    def problem(self) -> Problem | None:
        """The problem with its scene."""

    def at(self, t: float) -> tuple[Array, Array]:
        """Return q and v at a time."""


def scene_of(run: PlayableRun) -> SceneModel:
    """Return the scene of a run.

    Raises
    ------
    InputError
        If there is none.
    """
    if run.problem is None:
        raise InputError("this run came from a file without its problem: there is no scene to replay; chart t, q and v")
    scene = run.problem.scene
    if scene is None:
        raise InputError(
            "this run has no scene to replay: its system was given as functions, not built by a Scene; chart t, q and v"
        )
    return cast("SceneModel", scene)


def shapes_of(run: PlayableRun, shapes: str = "visual") -> list[PlacedShape]:
    """Return the shapes that a replay shows, on the bodies that carry them.

    Parameters
    ----------
    run : PlayableRun
        A run with a scene.
    shapes : "visual" or "collision"
        Whether robots show their visual shapes or their collision shapes.

    Raises
    ------
    InputError
        If there is no scene, nothing in it that moves has such a shape, or `shapes` is another word.
    """
    kind, scene = choice(shapes, "shapes", ("visual", "collision")), scene_of(run)
    shown, notes = visual_shapes(scene) if kind == "visual" else (list(scene.shapes), [])
    if not any(s.body for s in shown):
        raise InputError(f"nothing that moves in this scene has a shape to show: give the links a <{kind}>")
    for note in notes:
        warnings.warn(note, MbviWarning, stacklevel=4)
    return shown


@dataclass(frozen=True)
class Motion:
    """Poses of the bodies that carry shapes at the key times.

    Attributes
    ----------
    bodies : list of int
        The bodies.
    times : ndarray, shape (n,)
        Key times since the start of the replay [s].
    instants : ndarray, shape (n,)
        The same in the run's own time [s].
    frame : ndarray of bool, shape (n,)
        Which of them are frames; the others are impacts.
    position, quaternion : ndarray, shape (n, bodies, 3) and (n, bodies, 4)
        Origins [m] and rotations (x, y, z, w) in the world.
    """

    bodies: list[int]
    times: Array
    instants: Array
    frame: Array
    position: Array
    quaternion: Array


def motion(run: PlayableRun, speed: float = 1.0, shown: Sequence[PlacedShape] | None = None) -> Motion:
    """Return the poses of bodies, at 60 frames a second and at every impact (the 2000 strongest if there are more).

    Parameters
    ----------
    run : PlayableRun
        A run with a scene.
    speed : float
        Seconds of the run per second of the replay.
    shown : sequence of PlacedShape, optional
        The shapes that are shown; the collision shapes by default.
    """
    assert run.problem is not None
    shown = scene_of(run).shapes if shown is None else shown
    bodies = sorted({s.body for s in shown if s.body})
    start, end = float(run.t[0]), float(run.t[-1])
    count = max(int(_FRAMES * (end - start) / speed), 1)
    strongest = sorted(run.impacts, key=lambda i: -float(i.percussion.max()))[:_MOST_INSTANTS]
    # whole microseconds, because nearer keys are equal in the single precision of the browser
    frames = np.round(np.linspace(0.0, (end - start) / speed, count + 1), 6)
    instants = np.round([(i.time - start) / speed for i in strongest], 6)
    times = np.unique(np.concatenate([frames, instants]))
    position, quaternion = np.empty((len(times), len(bodies), 3)), np.empty((len(times), len(bodies), 4))
    at = np.clip(start + speed * times, start, end)
    for k, t in enumerate(at):
        places = run.problem.system.placements(run.at(float(t))[0], np.array(bodies))
        position[k] = places[:, 3]
        quaternion[k] = Rotation.from_matrix(places[:, :3].transpose(0, 2, 1)).as_quat()
    # of the two quaternions of a rotation, the one nearer to that of the frame before
    turned = (quaternion[1:] * quaternion[:-1]).sum(axis=2) < 0.0
    quaternion[1:] *= np.cumprod(np.where(turned, -1.0, 1.0), axis=0)[:, :, None]
    return Motion(bodies, times, at, np.isin(times, frames), position, quaternion)


def carried(drive: Drive, times: Array) -> tuple[Array, Array]:
    """Return the origins of a prescribed motion, shape (n, 3) [m], and its rotations (x, y, z, w), shape (n, 4)."""
    poses = [drive.pose(float(t)) for t in times]
    quaternion = Rotation.from_matrix(np.array([turn for turn, _ in poses])).as_quat()
    turned = (quaternion[1:] * quaternion[:-1]).sum(axis=1) < 0.0
    quaternion[1:] *= np.cumprod(np.where(turned, -1.0, 1.0))[:, None]
    return np.array([place for _, place in poses]), quaternion


@dataclass(frozen=True)
class Arrow:
    """A percussion: when [s], where [m], along which normal, and how long in half diagonals of the motion.

    With friction, also the name of its constraint, its own direction, and whether the contact sticks.
    """

    time: float
    point: Array
    normal: Array
    length: float
    name: str = ""
    direction: Array | None = None
    sticks: bool = False


def arrows(run: PlayableRun) -> list[Arrow]:
    """Return the percussions at contact points in order of time, the 300 strongest if there are more.

    The arrow has the direction of the percussion on the second body; its length grows from 0.1 to 0.6 as the root of
    the percussion.
    """
    found = [
        _Row(float(p), impact, k)
        for impact in run.impacts
        for k, p in enumerate(impact.percussion)
        if p > 0.0 and np.isfinite(impact.point[k]).all()
    ]
    strongest = sorted(found, key=lambda row: -row.percussion)[:_MOST_ARROWS]
    shown = [row.arrow(0.1 + 0.5 * float(np.sqrt(row.percussion / strongest[0].percussion))) for row in strongest]
    return sorted(shown, key=lambda a: a.time)


class _Row(NamedTuple):
    """One contact of an impact."""

    percussion: float
    impact: Any
    k: int

    def arrow(self, length: float) -> Arrow:
        i, k = self.impact, self.k
        if i.tangential is None:
            return Arrow(i.time, i.point[k], i.normal[k], length)
        whole = self.percussion * i.normal[k] + i.tangential[k]
        direction = whole / np.linalg.norm(whole)
        return Arrow(i.time, i.point[k], i.normal[k], length, i.constraints[k], direction, i.regime[k] == "stick")


def bounds(scene: SceneModel, moves: Motion, shown: Sequence[PlacedShape] | None = None) -> tuple[Array, Array]:
    """Return two corners, shape (3,) [m], of a box that holds all moving shapes, and fixed shapes near them.

    The shapes are those that are shown, the collision shapes by default.
    """
    shown = scene.shapes if shown is None else shown
    lower, upper = np.full(3, np.inf), np.full(3, -np.inf)
    turns = [Rotation.from_quat(moves.quaternion[:, b]) for b in range(len(moves.bodies))]
    for placed in shown:
        if placed.body:
            b = moves.bodies.index(placed.body)
            centre = moves.position[:, b] + turns[b].apply(placed.position)
            reach = _reach(placed.shape, turns[b].as_matrix() @ placed.rotation)
            lower, upper = (
                np.minimum(lower, (centre - reach).min(axis=0)),
                np.maximum(upper, (centre + reach).max(axis=0)),
            )
    near = 0.5 * float((upper - lower).max())
    first, last = lower - near, upper + near
    for placed in shown:
        if not placed.body:
            for turn, place in _poses(placed.motion, moves.instants):
                reach = _reach(placed.shape, turn @ placed.rotation)
                centre = turn @ placed.position + place
                lower = np.minimum(lower, np.maximum(centre - reach, first))
                upper = np.maximum(upper, np.minimum(centre + reach, last))
    for item in scene.surfaces:
        vertices = item.placed().vertices
        for turn, place in _poses(item.motion, moves.instants):
            points = vertices @ turn.T + place
            lower = np.minimum(lower, np.maximum(points.min(axis=0), first))
            upper = np.maximum(upper, np.minimum(points.max(axis=0), last))
    return lower, upper


def _poses(drive: Drive | None, times: Array) -> list[tuple[Array, Array]]:
    """Return some poses of a shape with a prescribed motion, or the pose of a fixed shape."""
    if drive is None:
        return [(np.eye(3), np.zeros(3))]
    return [drive.pose(float(t)) for t in times[:: max(1, len(times) // _MOST_POSES)]]


def _reach(shape: Convex, rotation: Array) -> Array:
    """Return how far a shape reaches along x, y and z at most, shape (..., 3), when turned by (..., 3, 3)."""
    if isinstance(shape, Sphere):
        half = np.full(3, shape.radius)
    elif isinstance(shape, Ellipsoid):
        half = np.array(shape.radii)
    elif isinstance(shape, Capsule):
        half = np.array([shape.radius, shape.radius, 0.5 * shape.length + shape.radius])
    elif isinstance(shape, Cylinder):
        half = np.array([shape.radius, shape.radius, 0.5 * shape.length])
    elif isinstance(shape, Box):
        half = 0.5 * np.array(shape.size)
    else:
        half = np.abs(shape.vertices).max(axis=0)
    return np.minimum(np.abs(rotation) @ half, shape.bound)
