"""What a replay shows, independent of the viewer: shapes, poses at frames and keys, and bounds."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, cast

import numpy as np
from scipy.spatial.transform import Rotation

from ...arguments import choice, watched
from ...errors import InputError, MbviWarning
from ...geometry.shapes.shapes import Box, Capsule, Convex, Cylinder, Ellipsoid, PlacedShape, Sphere
from ...scene.urdf.visuals import visual_shapes

if TYPE_CHECKING:
    from ...geometry.motion import Motion as Drive
    from ...problem import Problem
    from ...scene.model import SceneModel

Array = np.ndarray

_FRAMES, _MOST_FRAMES = 60.0, 36000
# of impacts that become keys: instants, and poses of bodies at them
_MOST_INSTANTS, _MOST_POSES_OF_IMPACTS = 2000, 1_000_000
_MOST_POSES = 60
# in lengths of the scene, and in entries of a quaternion
_SLACK = 1e-3


class PlayableRun(Protocol):
    """The part of a `Trajectory` that a replay needs."""

    @property
    def t(self) -> Array:
        """Times of the states [s]."""

    @property
    def impacts(self) -> tuple[Any, ...]:
        """Impacts in order of time."""

    @property
    def scheme(self) -> str:
        """Name of the scheme."""

    @property
    def step(self) -> float:
        """Time step [s], 0 where the scheme chooses it."""

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


def shapes_of(run: PlayableRun, shapes: str = "visual") -> dict[str, list[PlacedShape]]:
    """Return the visual and the collision shapes of a scene, those that a replay shows at first before the others.

    Parameters
    ----------
    run : PlayableRun
        A run with a scene.
    shapes : "visual" or "collision"
        Which of them the replay shows at first.

    Raises
    ------
    InputError
        If there is no scene, nothing in it that moves has such a shape, or `shapes` is another word.
    """
    kind, scene = choice(shapes, "shapes", ("visual", "collision")), scene_of(run)
    visual, notes = visual_shapes(scene)
    found = {"visual": visual, "collision": list(scene.shapes)}
    if not any(s.body for s in found[kind]):
        raise InputError(f"nothing that moves in this scene has a shape to show: give the links a <{kind}>")
    for note in notes if kind == "visual" else ():
        warnings.warn(note, MbviWarning, stacklevel=4)
    return {kind: found.pop(kind), **found}


@dataclass(frozen=True)
class Motion:
    """Poses of what moves, at frames of equal distance and at keys between them.

    Attributes
    ----------
    bodies : list of int
        The bodies that carry shapes; in the arrays below they come after the prescribed motions.
    times : ndarray, shape (frames,)
        Times of the frames [s].
    position, quaternion : ndarray, shape (frames, n, 3) and (frames, n, 4)
        Origins [m] and rotations (x, y, z, w) in the world.
    key_times, key_columns : ndarray, shape (k,)
        Times of the keys [s], in order, and what has them.
    key_position, key_quaternion : ndarray, shape (k, 3) and (k, 4)
        Poses there.
    """

    bodies: list[int]
    times: Array
    position: Array
    quaternion: Array
    key_times: Array
    key_columns: Array
    key_position: Array
    key_quaternion: Array

    @property
    def driven(self) -> int:
        """Number of prescribed motions."""
        return self.position.shape[1] - len(self.bodies)


def motion(run: PlayableRun, shown: Sequence[PlacedShape] | None = None) -> Motion:
    """Return poses at 60 frames a second, and keys where an impact bends a path between two frames.

    Parameters
    ----------
    run : PlayableRun
        A run with a scene.
    shown : sequence of PlacedShape, optional
        The shapes that are shown; the collision shapes by default.
    """
    scene = scene_of(run)
    bodies = sorted({s.body for s in (scene.shapes if shown is None else shown) if s.body})
    start, end = float(run.t[0]), float(run.t[-1])
    count = min(max(int(np.ceil(_FRAMES * (end - start) - 1e-9)), 1), _MOST_FRAMES)
    times = np.linspace(start, end, count + 1)
    position, quaternion = _poses(run, scene.motions, bodies, times)
    # of the two quaternions of a rotation, the one nearer to that of the frame before
    turned = (quaternion[1:] * quaternion[:-1]).sum(axis=2) < 0.0
    quaternion[1:] *= np.cumprod(np.where(turned, -1.0, 1.0), axis=0)[:, :, None]
    columns = max(position.shape[1], 1)
    strongest = sorted(run.impacts, key=lambda i: -float(i.percussion.max(initial=0.0)))
    most = min(_MOST_INSTANTS, _MOST_POSES_OF_IMPACTS // columns)
    instants = np.unique(np.clip([float(i.time) for i in strongest[:most]], start, end))
    keys = _keys(times, position, quaternion, instants, *_poses(run, scene.motions, bodies, instants))
    return Motion(bodies, times, position, quaternion, *keys)


def _poses(run: PlayableRun, drives: Sequence[Drive], bodies: list[int], times: Array) -> tuple[Array, Array]:
    """Return positions and quaternions of prescribed motions, then of bodies, at some times."""
    assert run.problem is not None
    system, which, driven = run.problem.system, np.array(bodies, dtype=np.int64), len(drives)
    position, quaternion = (
        np.zeros((len(times), driven + len(bodies), 3)),
        np.zeros((len(times), driven + len(bodies), 4)),
    )
    quaternion[..., 3] = 1.0
    for k, t in enumerate(watched(times.tolist(), "replay")):
        for column, drive in enumerate(drives):
            turn, place = drive.pose(t)
            position[k, column], quaternion[k, column] = place, Rotation.from_matrix(turn).as_quat()
        if bodies:
            places = system.placements(run.at(t)[0], which)
            position[k, driven:] = places[:, 3]
            # most spheres never turn
            turned = np.flatnonzero((places[:, :3] != np.eye(3)).any(axis=(1, 2)))
            if len(turned):
                quaternion[k, driven + turned] = Rotation.from_matrix(places[turned, :3].transpose(0, 2, 1)).as_quat()
    return position, quaternion


def _keys(
    times: Array, position: Array, quaternion: Array, instants: Array, places: Array, turns: Array
) -> tuple[Array, Array, Array, Array]:
    """Return times, columns and poses of the keys: where linear motion between frames is wrong by more than 1e-3."""
    frame = np.clip(np.searchsorted(times, instants, side="right") - 1, 0, len(times) - 2)
    part = ((instants - times[frame]) / np.maximum(times[frame + 1] - times[frame], 1e-300))[:, None, None]
    straight = (1.0 - part) * position[frame] + part * position[frame + 1]
    turning = (1.0 - part) * quaternion[frame] + part * quaternion[frame + 1]
    turns = np.where((turns * turning).sum(axis=2, keepdims=True) < 0.0, -turns, turns)
    extent = float(np.ptp(position.reshape(-1, 3), axis=0).max()) if position.size else 0.0
    bent = (np.abs(places - straight) > _SLACK * extent).any(axis=2) | (np.abs(turns - turning) > _SLACK).any(axis=2)
    row, column = np.nonzero(bent)
    return instants[row], column, places[row, column], turns[row, column]


def bounds(scene: SceneModel, moves: Motion, shown: Sequence[PlacedShape] | None = None) -> tuple[Array, Array]:
    """Return two corners, shape (3,) [m], of a box that holds all moving shapes, and fixed shapes near them.

    The shapes are those that are shown, the collision shapes by default.
    """
    shown = scene.shapes if shown is None else shown
    lower, upper = np.full(3, np.inf), np.full(3, -np.inf)
    column = {body: moves.driven + k for k, body in enumerate(moves.bodies)}
    for placed in shown:
        if placed.body:
            places, quaternions = moves.position[:, column[placed.body]], moves.quaternion[:, column[placed.body]]
            if isinstance(placed.shape, Sphere) and not np.any(placed.position):
                low, high = places.min(axis=0) - placed.shape.radius, places.max(axis=0) + placed.shape.radius
            else:
                turn = Rotation.from_quat(quaternions)
                centre, reach = (
                    places + turn.apply(placed.position),
                    _reach(placed.shape, turn.as_matrix() @ placed.rotation),
                )
                low, high = (centre - reach).min(axis=0), (centre + reach).max(axis=0)
            lower, upper = np.minimum(lower, low), np.maximum(upper, high)
    near = 0.5 * float((upper - lower).max())
    first, last = lower - near, upper + near
    for placed in shown:
        if not placed.body:
            for turn, place in _some_poses(placed.motion, moves.times):
                reach = _reach(placed.shape, turn @ placed.rotation)
                centre = turn @ placed.position + place
                lower = np.minimum(lower, np.maximum(centre - reach, first))
                upper = np.maximum(upper, np.minimum(centre + reach, last))
    for item in scene.surfaces:
        vertices = item.placed().vertices
        for turn, place in _some_poses(item.motion, moves.times):
            points = vertices @ turn.T + place
            lower = np.minimum(lower, np.maximum(points.min(axis=0), first))
            upper = np.maximum(upper, np.minimum(points.max(axis=0), last))
    return lower, upper


def _some_poses(drive: Drive | None, times: Array) -> list[tuple[Array, Array]]:
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
