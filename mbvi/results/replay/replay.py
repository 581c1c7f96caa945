"""Replays a run in meshcat: live in a browser, or as one HTML page that plays without a server."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import meshcat
import numpy as np
from meshcat.animation import Animation, AnimationClip, AnimationTrack
from scipy.spatial.transform import Rotation

from ...errors import InputError, TrajectoryFileError
from ...geometry.shapes import Sphere
from .friction import FrictionNames, cone_length, cone_size, draw_cones
from .keyframes import Array, Motion, arrows, bounds, carried, motion, scene_of, shapes_of
from .meshes import arrow_mesh, cone_mesh, plate_mesh, shape_mesh, sheet_mesh, striped
from .nodes import SLACK, Track, cast_shadow, hide, label, pose, turn_to
from .page import Page

if TYPE_CHECKING:
    from ...geometry.shapes import PlacedShape
    from ...scene.model import SceneModel
    from .keyframes import PlayableRun

# duration of an arrow, and the part of it at full size [s]
_FADE, _WHOLE = 0.3, 0.08
# largest length of an arrow, in lengths of the scene
_LONGEST = 10.0
# direction of the camera from the middle of the scene, field of view [degrees], smallest width of a window [heights]
_DIRECTION = np.array([0.50, -0.80, 0.33]) / np.linalg.norm([0.50, -0.80, 0.33])
_FIELD, _ASPECT = 40.0, 1.3


def replay(run: PlayableRun, speed: float = 1.0, shapes: str = "visual") -> None:
    """Show a run in a browser through meshcat; returns when it has played.

    Parameters
    ----------
    run : PlayableRun
        The run to show; see `arrows` for the percussions.
    speed : float
        Seconds of the run per second of the replay.
    shapes : "visual" or "collision"
        See `Trajectory.replay_html`.

    Raises
    ------
    InputError
        If the run has no scene to show, the speed is not positive, or `shapes` is another word.
    """
    shown = shapes_of(run, shapes)
    # written so that a NaN is refused too
    if not 0.0 < speed < np.inf:
        raise InputError(f"speed must be positive and finite; got {speed}")
    vis = meshcat.Visualizer()
    try:
        vis.open()
        animation = stage(vis, run, speed, shown)
        # a server that dies with the script before a browser has come would show nothing
        vis.wait()
        # having waited, the server hears nothing more from this socket
        vis.window.zmq_socket.close()
        vis.window.connect_zmq()
        vis.set_animation(animation)
    finally:
        vis.window.zmq_socket.close()
    time.sleep(float(run.t[-1] - run.t[0]) / speed)


def replay_html(run: PlayableRun, path: str | os.PathLike[str], shapes: str = "visual") -> None:
    """Write one page that plays a run at true speed, with no server and no network.

    Parameters
    ----------
    run : PlayableRun
        The run to show; see `arrows` for the percussions.
    path : path
        The page; an old one is replaced.
    shapes : "visual" or "collision"
        See `Trajectory.replay_html`.

    Raises
    ------
    InputError
        If the run has no scene to show, or `shapes` is another word.
    TrajectoryFileError
        If the page cannot be written.
    """
    shown = shapes_of(run, shapes)
    page = Page()
    vis = meshcat.Visualizer(window=page)
    vis.set_animation(stage(vis, run, shown=shown), play=False)
    try:
        Path(path).write_text(page.html(), encoding="utf-8")
    except OSError as error:
        raise TrajectoryFileError(f"the page {path} cannot be written: {error.strerror or error}") from error


def stage(
    vis: meshcat.Visualizer, run: PlayableRun, speed: float = 1.0, shown: Sequence[PlacedShape] | None = None
) -> Animation:
    """Draw the scene of a run as it starts, and return its animation.

    Parameters
    ----------
    vis : meshcat.Visualizer
        Where to draw.
    run : PlayableRun
        A run with a scene.
    speed : float
        Seconds of the run per second of the replay.
    shown : sequence of PlacedShape, optional
        What `shapes_of` returned; the visual shapes by default.
    """
    scene, shown = scene_of(run), shapes_of(run) if shown is None else shown
    moves = motion(run, speed, shown)
    lower, upper = bounds(scene, moves, shown)
    radius = max(0.5 * float(np.linalg.norm(upper - lower)), 1e-9)
    _light(vis, 0.5 * (lower + upper), radius, upper - lower)
    animation = Animation(default_framerate=1)
    frames = _frames(vis, scene, moves, radius, animation)
    for k, (name, wall) in enumerate(scene.walls.items()):
        node = frames[id(wall.motion)]["walls"][label(k, name)]
        others = [w for w in scene.walls.values() if w is not wall and w.motion is wall.motion]
        node.set_object(plate_mesh(wall, others, lower, upper))
        # a wall is drawn from its free side only, and must not cast a shadow from behind
        cast_shadow(node["<object>"], False)
    for k, item in enumerate(scene.surfaces):
        node = frames[id(item.motion)]["surfaces"][label(k, item.name)]
        node.set_object(sheet_mesh(item.placed()))
        cast_shadow(node["<object>"], False)
    _draw_shapes(vis, shown, moves, frames, radius, animation, rolling=scene.items.frictional)
    # long arrows would hide many small bodies
    assert run.problem is not None
    length = min(radius, _LONGEST * run.problem.length)
    _draw_arrows(vis, run, length, speed, float(moves.times[-1]), animation)
    draw_cones(vis, run, length, moves, animation)
    return animation


def _frames(
    vis: meshcat.Visualizer, scene: SceneModel, moves: Motion, radius: float, animation: Animation
) -> dict[int, meshcat.Visualizer]:
    """Return the node of fixed things, by the id of None, and a node for each prescribed motion by its id."""
    frames = {id(None): vis}
    for k, drive in enumerate(scene.motions):
        node = frames[id(drive)] = vis["driven"][str(k)]
        _animate(node, moves, *carried(drive, moves.instants), radius, animation)
    return frames


def _animate(
    node: meshcat.Visualizer, moves: Motion, position: Array, quaternion: Array, radius: float, animation: Animation
) -> None:
    """Place and animate a node."""
    node.set_transform(pose(Rotation.from_quat(quaternion[0]).as_matrix(), position[0]))
    tracks = {
        "position": _track("position", "vector3", moves, position, SLACK * radius),
        "quaternion": _track("quaternion", "quaternion", moves, quaternion, SLACK),
    }
    moving = {name: track for name, track in tracks.items() if track is not None}
    if moving:
        animation.clips[node.path] = AnimationClip(moving, fps=1)


def _draw_shapes(
    vis: meshcat.Visualizer,
    shown: Sequence[PlacedShape],
    moves: Motion,
    frames: dict[int, meshcat.Visualizer],
    radius: float,
    animation: Animation,
    *,
    rolling: bool,
) -> None:
    parts, names = {}, {s.body: s.name for s in reversed(shown)}
    for b, body in enumerate(moves.bodies):
        node = parts[body] = vis["bodies"][label(body, names[body])]
        _animate(node, moves, moves.position[:, b], moves.quaternion[:, b], radius, animation)
    for k, placed in enumerate(shown):
        # links of robots have names with a slash
        if rolling and isinstance(placed.shape, Sphere) and placed.body and "/" not in placed.name:
            mesh, turn = striped(placed.shape.radius, placed.color)
        else:
            mesh, turn = shape_mesh(placed)
        node = (parts[placed.body] if placed.body else frames[id(placed.motion)]["fixed"])[label(k, placed.name)]
        node.set_object(mesh)
        node.set_transform(pose(placed.rotation @ turn, placed.position))


def _draw_arrows(
    vis: meshcat.Visualizer, run: PlayableRun, length: float, speed: float, end: float, animation: Animation
) -> None:
    friction = FrictionNames(run)
    for k, arrow in enumerate(arrows(run)):
        node = vis["percussions"][str(k)]
        node.set_object(arrow_mesh(sticks=arrow.sticks))
        node.set_transform(pose(turn_to(arrow.normal if arrow.direction is None else arrow.direction), arrow.point))
        hide(node)
        # the opacity of a node cannot be animated: the arrow gets thin instead
        shown = round((arrow.time - float(run.t[0])) / speed, 6)
        fade = [shown, shown + _WHOLE, shown + _FADE]
        keys = np.unique(np.minimum(fade, end))
        thick = np.interp(keys, fade, [1.0, 1.0, 0.0])
        size = arrow.length * length * np.stack([thick, thick, np.ones_like(keys)], axis=1)
        # every clip ends with the run: one that ended before would not start again when played from earlier
        seen = {0.0: False, shown: True, min(fade[2], end): False, end: fade[2] > end}
        tracks = {
            "scale": Track("scale", "vector3", keys, size),
            "visible": AnimationTrack("visible", "boolean", list(seen), list(seen.values())),
        }
        animation.clips[node.path] = AnimationClip(tracks, fps=1)
        mu = friction(arrow.name) if arrow.name else 0.0
        if mu > 0.0:
            node = vis["friction"][f"impact {k}"]
            node.set_object(cone_mesh(sticks=arrow.sticks))
            size = cone_size(mu, min(arrow.length * length, 2.0 * cone_length(run, length)))
            node.set_transform(pose(turn_to(arrow.normal) * size, arrow.point))
            hide(node)
            animation.clips[node.path] = AnimationClip({"visible": tracks["visible"]}, fps=1)


def _track(name: str, kind: str, moves: Motion, values: Array, slack: float) -> Track | None:
    """Return the track of one body, without keys at impacts that did not change its path; None if it never moved."""
    if np.abs(values - values[0]).max() <= 1e-3 * slack:
        return None
    at, frame = moves.times, moves.frame
    straight = np.stack([np.interp(at, at[frame], column[frame]) for column in values.T], axis=1)
    kept = frame | (np.abs(values - straight).max(axis=1) > slack)
    return Track(name, kind, at[kept], values[kept])


def _light(vis: meshcat.Visualizer, centre: Array, radius: float, size: Array) -> None:
    """Set camera, lights and background; the scene is shrunk to half diagonal 1, for which the lights are made."""
    pose = np.eye(4) / radius
    pose[:3, 3], pose[3, 3] = -centre / radius, 1.0
    vis.set_transform(pose)
    right = np.cross([0.0, 0.0, 1.0], _DIRECTION) / np.hypot(*_DIRECTION[:2])
    axes = np.stack([right, np.cross(_DIRECTION, right), _DIRECTION])
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]) * size / radius
    across, along, depth = np.abs(corners @ axes.T[:, 0]), np.abs(corners @ axes.T[:, 1]), corners @ _DIRECTION
    slope = np.tan(np.radians(0.5 * _FIELD))
    distance = float((depth + np.maximum(across / (_ASPECT * slope), along / slope)).max())
    x, y, z = 1.08 * distance * _DIRECTION
    camera = vis["/Cameras/default/rotated/<object>"]
    camera.set_property("fov", _FIELD)
    # the camera's own frame has y up
    camera.set_property("position", [x, z, -y])
    for hidden in ("/Grid", "/Axes", "/Lights/PointLightNegativeX", "/Lights/PointLightPositiveX"):
        vis[hidden].set_property("visible", False)
    vis["/Background"].set_property("top_color", [0.66, 0.78, 0.90])
    vis["/Background"].set_property("bottom_color", [0.96, 0.96, 0.94])
    lamp = vis["/Lights/SpotLight"]
    lamp.set_property("visible", True)
    for key, value in {"position": [2.0, -2.5, 5.5], "angle": 0.5, "penumbra": 0.6}.items():
        lamp["<object>"].set_property(key, value)
    cast_shadow(lamp["<object>"], True)
    for light, intensity in {"SpotLight": 0.55, "FillLight": 0.25, "AmbientLight": 0.55}.items():
        vis[f"/Lights/{light}/<object>"].set_property("intensity", intensity)
