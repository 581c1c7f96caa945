"""Friction cones of a replay: at impacts, and at all contacts of runs that recorded them."""

from __future__ import annotations

from collections import defaultdict
from typing import Any, NamedTuple

import numpy as np

from .keyframes import Array, Motion, PlayableRun, scene_of

# contacts that have cones, of the strongest percussions
_MOST_CONTACTS = 60
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
