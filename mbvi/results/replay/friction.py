"""Friction cones of a replay, and the percussions of recorded contacts within them."""

from __future__ import annotations

from collections import defaultdict
from typing import Any, NamedTuple

import meshcat
import numpy as np
from meshcat.animation import Animation, AnimationClip, AnimationTrack
from scipy.spatial.transform import Rotation

from .keyframes import Array, Motion, PlayableRun, scene_of
from .meshes import arrow_mesh, cone_mesh
from .nodes import SLACK, Steps, hide, turn_to

# contacts that have cones, of the strongest percussions
_MOST_CONTACTS = 60
# largest length of cones of recorded contacts, in the largest length of an arrow and in lengths of the scene; those of
# impacts are up to twice as long
_CONE, _OF_BODIES = 0.25, 1.0
# part of the percussions of these whose arrows are shorter than that
_LONG = 0.9
_BETWEEN = " | "


class FrictionNames:
    """Coefficients of friction by the names of constraints.

    Parameters
    ----------
    run : PlayableRun
        A run with a scene.
    """

    def __init__(self, run: PlayableRun) -> None:
        scene = scene_of(run)
        self._items, self._known = scene.items, dict[str, float]()
        self._parts = {*scene.walls, *(s.name for s in scene.surfaces), *(s.name for s in scene.shapes)}

    def __call__(self, name: str) -> float:
        """Return mu of a constraint, 0 where it has none."""
        if not self._items.frictional:
            return 0.0
        if name not in self._known:
            words = name.split(_BETWEEN)
            splits = [(_BETWEEN.join(words[:k]), _BETWEEN.join(words[k:])) for k in range(1, len(words))]
            # a link's name in a file may hold what stands between two names
            pair = next((pair for pair in splits if self._parts.issuperset(pair)), None)
            self._known[name] = 0.0 if pair is None else self._items.friction_of(*pair)
        return self._known[name]


class ContactCone(NamedTuple):
    """The cone of one contact at the frames at which it is closed, and its percussion, shapes (n,) and (n, 3)."""

    friction: float
    frame: Array
    sticks: Array
    point: Array
    normal: Array
    percussion: Array


def contact_cones(run: PlayableRun, moves: Motion) -> list[ContactCone]:
    """Return the cones of the recorded contacts at the frames, of 60 contacts at most; none where none are recorded."""
    table = run.record.contacts
    if table is None or table.sticks is None:
        return []
    at = np.searchsorted(run.t, moves.instants - 1e-9)
    rows_of = _contacts(table, np.flatnonzero(moves.frame), at)
    friction, found = FrictionNames(run), list[ContactCone]()
    strongest = sorted(rows_of.items(), key=lambda item: -float(table.percussion[item[1][1]].max()))
    for (constraint, _), (frame, rows) in strongest:
        mu = friction(table.names[constraint])
        if mu > 0.0 and np.isfinite(table.point[rows]).all() and len(found) < _MOST_CONTACTS:
            percussion = table.percussion[rows, None] * table.normal[rows] + table.tangential[rows]
            found.append(ContactCone(mu, frame, table.sticks[rows], table.point[rows], table.normal[rows], percussion))
    return found


def _contacts(table: Any, frames: Array, at: Array) -> dict[tuple[int, int], tuple[Array, Array]]:
    """Return the frames and rows of each contact: a constraint, and its number among the rows of that constraint."""
    seen: dict[tuple[int, int], list[tuple[int, int]]] = defaultdict(list)
    for frame in frames.tolist():
        counts: dict[int, int] = defaultdict(int)
        i = int(at[frame])
        for row in range(int(table.starts[i]), int(table.starts[i + 1])):
            constraint = int(table.constraint[row])
            seen[constraint, counts[constraint]].append((frame, row))
            counts[constraint] += 1
    return {key: (np.array(pairs)[:, 0], np.array(pairs)[:, 1]) for key, pairs in seen.items()}


def draw_cones(vis: meshcat.Visualizer, run: PlayableRun, length: float, moves: Motion, animation: Animation) -> None:
    """Draw friction cones and percussions of recorded contacts, each in two colors of which one at most is seen.

    Parameters
    ----------
    vis, run, animation
        As of `stage`.
    length : float
        Largest length of an arrow [m].
    moves : Motion
        The key times.
    """
    cones, rays = contact_cones(run, moves), cone_length(run, length)
    sizes = [np.linalg.norm(cone.percussion, axis=1) for cone in cones]
    # percussions of impacts would make all others invisible
    long = float(np.quantile(np.concatenate(sizes), _LONG)) if sizes else 1.0
    for k, (cone, size) in enumerate(zip(cones, sizes, strict=True)):
        # thick enough to be seen, however short
        scale = rays * np.stack([np.ones_like(size)] * 2 + [np.sqrt(np.minimum(size / long, 1.0))], axis=1)
        wide = np.broadcast_to(cone_size(cone.friction, rays), scale.shape)
        for sticks in (False, True):
            if (cone.sticks == sticks).any():
                name = f"contact {k} {'stick' if sticks else 'slip'}"
                seen = _seen(moves, cone.frame[cone.sticks == sticks])
                parts = (
                    (vis["friction"][name], cone_mesh(sticks=sticks), cone.normal, wide),
                    (vis["percussions"][name], arrow_mesh(sticks=sticks), cone.percussion / size[:, None], scale),
                )
                for node, mesh, along, scales in parts:
                    node.set_object(mesh)
                    hide(node)
                    tracks = _placed(moves.times[cone.frame], cone.point, along, scales, length) | {"visible": seen}
                    animation.clips[node.path] = AnimationClip(tracks, fps=1)


def _seen(moves: Motion, frames: Array) -> AnimationTrack:
    """Return the track of what is seen at some frames; it ends with the run."""
    all_frames = np.flatnonzero(moves.frame)
    shown = np.isin(all_frames, frames)
    changes = np.flatnonzero(np.diff(shown, prepend=False))
    seen = {0.0: False} | {float(moves.times[all_frames[c]]): bool(shown[c]) for c in changes}
    seen.setdefault(float(moves.times[-1]), bool(shown[-1]))
    return AnimationTrack("visible", "boolean", list(seen), list(seen.values()))


def _placed(times: Array, point: Array, along: Array, scale: Array, length: float) -> dict[str, AnimationTrack]:
    """Return the tracks of something that points along z, with a key wherever it moves."""
    turns = Rotation.from_matrix([turn_to(direction) for direction in along]).as_quat()
    columns = np.concatenate([point / length, along, scale / length], axis=1)
    rounded = np.rint(columns / SLACK)
    keys = np.append(True, (rounded[1:] != rounded[:-1]).any(axis=1))
    return {
        "position": Steps("position", "vector3", times[keys], point[keys]),
        "quaternion": Steps("quaternion", "quaternion", times[keys], turns[keys]),
        "scale": Steps("scale", "vector3", times[keys], scale[keys]),
    }


def cone_length(run: PlayableRun, length: float) -> float:
    """Return the length of the cones of recorded contacts [m], where arrows are up to `length` [m] long."""
    assert run.problem is not None
    # longer cones would hide the bodies of a pile
    return min(_CONE * length, _OF_BODIES * run.problem.length)


def cone_size(friction: float, length: float) -> Array:
    """Return the scales of a cone along its axes, shape (3,), so that its rays have a length."""
    height = length / np.hypot(1.0, friction)
    return height * np.array([friction, friction, 1.0])
