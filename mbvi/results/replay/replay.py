"""Draws a run on a page that plays it: the scene by meshcat's commands, what moves as instances of shared meshes."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import meshcat
import numpy as np

from ...arguments.bar import parts
from ...errors import TrajectoryFileError
from ...scene.overview import things_of
from .encoding import TURN_STEP, encode, packed, quantised, text_of
from .marks import connection_marks, crowded, marks, strikes
from .meshes import (
    ShapeMesh,
    arrow_mesh,
    cone_mesh,
    connection_mesh,
    normal_mesh,
    plate_mesh,
    shape_color,
    shape_mesh,
    sheet_mesh,
)
from .motion import Array, Motion, bounds, motion, scene_of, shapes_of
from .nodes import cast_shadow, label
from .page import Page
from .terrain import field_meshes

if TYPE_CHECKING:
    from ...geometry.shapes.shapes import PlacedShape
    from ...scene.model import SceneModel
    from .motion import PlayableRun

# largest length of an arrow, in lengths of the scene
_LONGEST = 10.0
# radius of what marks a connection, in half diagonals of the motion
_CONNECTION = 0.015
# the part of speeds and percussions that colors tell apart
_COLORED = 0.995
# impacts that keys lead to
_MOST_INSTANTS = 20000
# shapes from which on round ones are coarse
_MANY = 2000
# the shapes of an instance: visual ones, collision ones, or both
_KINDS = {"visual": 1, "collision": 2}


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
    page = page_of(run, shapes).html()
    try:
        Path(path).write_text(page, encoding="utf-8")
    except OSError as error:
        raise TrajectoryFileError(f"the page {path} cannot be written: {error.strerror or error}") from error


def page_of(run: PlayableRun, shapes: str = "visual", speed: float = 1.0) -> Page:
    """Return the page that plays a run; its `html()` is a string.

    Parameters
    ----------
    run : PlayableRun
        A run with a scene.
    shapes : "visual" or "collision"
        The shapes that are shown at first.
    speed : float
        Seconds of the run per second of the replay at first.

    Raises
    ------
    InputError
        If the run has no scene to show, or `shapes` is another word.
    """
    kinds, scene = shapes_of(run, shapes), scene_of(run)
    connected = connection_marks(run)
    every = [*(placed for shown in kinds.values() for placed in shown), *connected]
    moves, page = motion(run, every), Page()
    with parts(6, "page") as bar:
        lower, upper = bounds(scene, moves, kinds[shapes])
        radius = max(0.5 * float(np.linalg.norm(upper - lower)), 1e-9)
        bar.update()
        vis = meshcat.Visualizer(window=page)
        _light(vis)
        _draw_walls(vis, scene, lower, upper)
        groups = _groups(kinds, moves, scene, rolling=scene.items.frictional)
        groups += _connections(connected, moves, _CONNECTION * radius)
        bar.update()
        for k, group in enumerate(groups):
            vis["instances"][str(k)].set_object(group.drawn.mesh)
        for k, mesh in enumerate((arrow_mesh(), cone_mesh(), normal_mesh())):
            vis["marks"][str(k)].set_object(mesh)
        bar.update()
        page.title = f"{things_of(run.problem)} by {run.scheme}{f', h = {run.step:g} s' if run.step else ''}"
        page.data = _poses(moves) | {"names": _names(moves, every), "groups": [group.data() for group in groups]}
        bar.update()
        both = sum(_KINDS.values())
        first = both if all(set(group.kinds) == {both} for group in groups) else _KINDS[shapes]
        page.data |= {
            "lower": lower.tolist(), "upper": upper.tolist(), "radius": radius, "speed": speed, "shapes": first,
        }  # fmt: skip
        page.data |= _events(run, moves, scene, radius)
        bar.update()
        page.data |= _colors(run, moves)
    return page


def _events(run: PlayableRun, moves: Motion, scene: SceneModel, radius: float) -> dict[str, Any]:
    """Return what happens at instants: marks of percussions and contacts, impacts, and what is switched."""
    assert run.problem is not None
    # long arrows would hide many small bodies
    length = min(radius, _LONGEST * run.problem.length)
    return {
        "frictional": scene.items.frictional, "driven": moves.driven,
        "marks": packed(marks(run, moves, length).astype(np.float32)), "crowded": crowded(run, moves),
        "impacts": packed(_instants(run)),
        "couplings": [*map(str, scene.items.couplings), *map(str, run.record.switches)],
    }  # fmt: skip


def _instants(run: PlayableRun) -> Array:
    """Return the times of the impacts since the start, each once, those of the strongest if there are many."""
    strongest = sorted(run.impacts, key=lambda i: -float(i.percussion.max(initial=0.0)))[:_MOST_INSTANTS]
    return np.unique([float(impact.time) for impact in strongest]) - float(run.t[0])


def _poses(moves: Motion) -> dict[str, Any]:
    """Return frames and keys as the page reads them."""
    code = encode(moves.position, moves.quaternion, moves.key_position)
    # each key holds one pose
    keys = quantised(moves.key_position[:, None], moves.key_quaternion[:, None], code.origin, code.step)
    return {
        "start": float(moves.times[0]), "end": float(moves.times[-1]), "frames": code.frames,
        "columns": moves.position.shape[1], "origin": code.origin.tolist(), "step": code.step, "turnStep": TURN_STEP,
        "first": packed(code.first), "varying": packed(code.varying.astype(np.uint8)),
        "differences": text_of(code.differences),
        "keyTimes": packed(moves.key_times - moves.times[0]), "keyColumns": packed(moves.key_columns.astype(np.int32)),
        "keys": packed(keys),
    }  # fmt: skip


def _names(moves: Motion, shown: Sequence[PlacedShape]) -> list[str]:
    names = {placed.body: placed.name for placed in reversed(shown)}
    return [names[body] for body in moves.bodies]


def _colors(run: PlayableRun, moves: Motion) -> dict[str, Any]:
    """Return what bodies are colored by: the largest speed and percussion told apart, and what was struck when."""
    found = strikes(run, moves)
    passed = np.linalg.norm(np.diff(moves.position[:, moves.driven :], axis=0), axis=2)
    between = np.diff(moves.times)[:, None]
    speed = passed / np.where(between > 0.0, between, np.inf)
    return {
        "strikes": packed(found),
        "fast": float(np.quantile(speed, _COLORED)) if speed.size else 0.0,
        "strong": float(np.quantile(found[:, 2], _COLORED)) if len(found) else 0.0,
    }


@dataclass
class _Group:
    """Instances of one mesh: their columns (-1 is the world), colors, kinds, and places on what carries them."""

    drawn: ShapeMesh
    columns: list[int] = field(default_factory=list)
    kinds: list[int] = field(default_factory=list)
    rows: list[Array] = field(default_factory=list)
    connections: bool = False

    def data(self) -> dict[str, Any]:
        return {
            "columns": packed(np.array(self.columns, np.int32)),
            "kinds": packed(np.array(self.kinds, np.uint8)),
            # color, then a matrix of three rows and a position
            "rows": packed(np.array(self.rows, np.float32)),
            "striped": self.drawn.striped,
            "connections": self.connections,
        }


def _groups(
    kinds: Mapping[str, Sequence[PlacedShape]], moves: Motion, scene: SceneModel, *, rolling: bool
) -> list[_Group]:
    """Return the groups of shapes that share a mesh; what is both visual and collision shape is in one once."""
    column = {body: moves.driven + k for k, body in enumerate(moves.bodies)}
    driven = {id(drive): k for k, drive in enumerate(scene.motions)}
    groups, seen = dict[Any, _Group](), dict[int, tuple[_Group, int]]()
    meshes, coarse = dict[Any, ShapeMesh](), max(len(shown) for shown in kinds.values()) > _MANY
    for kind, shown in kinds.items():
        for placed in shown:
            if id(placed) in seen:
                group, k = seen[id(placed)]
                group.kinds[k] |= _KINDS[kind]
                continue
            # links of robots have names with a slash
            rolls = rolling and bool(placed.body) and "/" not in placed.name
            known = (id(placed.shape), placed.color[3], rolls)
            if known not in meshes:
                meshes[known] = shape_mesh(placed, rolling=rolls, coarse=coarse)
            drawn = meshes[known]
            group = groups.setdefault(drawn.key, _Group(drawn))
            seen[id(placed)] = group, len(group.columns)
            group.columns.append(column[placed.body] if placed.body else driven.get(id(placed.motion), -1))
            group.kinds.append(_KINDS[kind])
            turn = placed.rotation @ drawn.scale
            group.rows.append(np.concatenate([shape_color(placed), turn.ravel(), placed.position]))
    return list(groups.values())


def _connections(connected: Sequence[PlacedShape], moves: Motion, radius: float) -> list[_Group]:
    """Return the group of the marks of connections, with a radius [m], if there are any."""
    columns = [moves.driven + moves.bodies.index(placed.body) for placed in connected]
    turn = radius * np.eye(3).ravel()
    rows = [np.concatenate([shape_color(placed), turn, placed.position]) for placed in connected]
    drawn = ShapeMesh(connection_mesh(), ("connection",), np.eye(3))
    return [_Group(drawn, columns, [sum(_KINDS.values())] * len(rows), rows, connections=True)] if rows else []


def _draw_walls(vis: meshcat.Visualizer, scene: SceneModel, lower: Array, upper: Array) -> None:
    """Draw walls and meshes of the world, those with a prescribed motion on a node that the page moves."""
    frames = {id(None): vis["fixed"]} | {id(drive): vis["driven"][str(k)] for k, drive in enumerate(scene.motions)}
    for k, (name, wall) in enumerate(scene.walls.items()):
        node = frames[id(wall.motion)]["walls"][label(k, name)]
        others = [w for w in scene.walls.values() if w is not wall and w.motion is wall.motion]
        node.set_object(plate_mesh(wall, others, lower, upper))
        # a wall is drawn from its free side only, and must not cast a shadow from behind
        cast_shadow(node["<object>"], False)
    for k, item in enumerate(scene.surfaces):
        node = frames[id(item.motion)]["surfaces"][label(k, item.name)]
        surface, lines = (sheet_mesh(item.placed()), None) if item.heights is None else field_meshes(item)
        node.set_object(surface)
        cast_shadow(node["<object>"], False)
        if lines is not None:
            node["contour lines"].set_object(lines)


def _light(vis: meshcat.Visualizer) -> None:
    """Set lights and background; the page shrinks the scene to half diagonal 1, for which the lights are made."""
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
