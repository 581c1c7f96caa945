"""Marks of a replay: percussions, normals, friction cones, connections, and which bodies an impact struck."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ...geometry.shapes.shapes import PlacedShape, Sphere
from ...system.mechanisms.equalities import PointRows
from .motion import Array, Motion, PlayableRun, scene_of

_BETWEEN = " | "
_MOST_ARROWS, _MOST_STRIKES = 3000, 20000
# contacts of one frame that have cones and normals, of the strongest percussions
_MOST_CONTACTS = 300
# contacts at once that have arrows, the strongest; where there are more, percussions are not shown at first
_AT_ONCE = 30
# for how long an impact is seen at true speed [s]; the page knows the same number
_LASTS = 0.3
# percussion, in medians, from which on arrows have the greatest length
_LARGE = 4.0
# largest length of cones of recorded contacts, in the largest length of an arrow and in lengths of the scene; those of
# impacts are up to twice as long
_CONE, _OF_BODIES = 0.25, 1.0
# what a mark is; the page knows the same numbers
ARROW, CONE, NORMAL = 0, 1, 2
# color of what marks a connection, and how many rows a weld has
_CONNECTED, _WELD = (0.56, 0.14, 0.67, 1.0), 6
# whether its contact slips or sticks, or knows no friction
SLIPS, STICKS, SMOOTH = 0, 1, 2


class ContactNames:
    """Bodies and coefficients of friction by the names of constraints.

    Parameters
    ----------
    run : PlayableRun
        A run with a scene.
    """

    def __init__(self, run: PlayableRun) -> None:
        scene = scene_of(run)
        self._items, self._known = scene.items, dict[str, float]()
        self.body_of = {s.name: s.body for s in scene.shapes}
        self._parts = {*scene.walls, *(s.name for s in scene.surfaces), *self.body_of}

    def friction(self, name: str) -> float:
        """Return mu of a constraint, 0 where it has none."""
        if not self._items.frictional:
            return 0.0
        if name not in self._known:
            pair = self._pair(name)
            self._known[name] = 0.0 if pair is None else self._items.friction_of(*pair)
        return self._known[name]

    def bodies(self, name: str) -> tuple[int, ...]:
        """Return the moving bodies of a constraint."""
        return tuple(body for part in self._pair(name) or () if (body := self.body_of.get(part, 0)))

    def touching(self, name: str, columns: dict[int, int]) -> tuple[int, int]:
        """Return the columns of the two bodies of a constraint, -1 for one that does not move."""
        first, second = [columns.get(body, -1) for body in (*self.bodies(name), 0, 0)[:2]]
        return first, second

    def _pair(self, name: str) -> tuple[str, str] | None:
        words = name.split(_BETWEEN)
        splits = [(_BETWEEN.join(words[:k]), _BETWEEN.join(words[k:])) for k in range(1, len(words))]
        # a link's name in a file may hold what stands between two names
        return next((pair for pair in splits if self._parts.issuperset(pair)), None)


@dataclass(frozen=True)
class Arrow:
    """A percussion: when [s], where [m], along which normal, and how long in half diagonals of the motion.

    Also the name of its constraint, and with friction its own direction and whether the contact sticks.
    """

    time: float
    point: Array
    normal: Array
    length: float
    name: str = ""
    direction: Array | None = None
    sticks: bool = False


def arrows(run: PlayableRun) -> list[Arrow]:
    """Return the percussions at contact points in order of time, the 30 strongest of each 0.3 s if there are more.

    The arrow has the direction of the percussion on the second body; its length grows from 0.1 as the root of the
    percussion: it is 0.35 at the median and 0.6 at most.
    """
    found = [
        _Row(float(p), impact, k)
        for impact in run.impacts
        for k, p in enumerate(impact.percussion)
        if p > 0.0 and np.isfinite(impact.point[k]).all()
    ]
    begun, strongest = Counter[int](), list[_Row]()
    for row in sorted(found, key=lambda row: -row.percussion):
        moment = int(row.impact.time // _LASTS)
        begun[moment] += 1
        if begun[moment] <= _AT_ONCE and len(strongest) < _MOST_ARROWS:
            strongest.append(row)
    median = float(np.median([row.percussion for row in strongest])) if strongest else 1.0
    shown = [row.arrow(0.1 + 0.5 * float(_length(row.percussion, median))) for row in strongest]
    return sorted(shown, key=lambda a: a.time)


def _length(percussion: Any, median: float) -> Any:
    """Return the part of the greatest length that an arrow has."""
    return np.sqrt(np.minimum(percussion / (_LARGE * median), 1.0))


def crowded(run: PlayableRun, moves: Motion) -> bool:
    """Return whether more than 30 contacts have percussions in one frame, or in impacts within 0.3 s."""
    table, struck = run.record.contacts, dict[int, set[str]]()
    for impact in run.impacts:
        names = (n for n, p in zip(impact.constraints, impact.percussion, strict=True) if p > 0.0)
        struck.setdefault(int(impact.time // _LASTS), set()).update(names)
    if any(len(names) > _AT_ONCE for names in struck.values()):
        return True
    return table is not None and any(len(_closed(table, int(i))) > _AT_ONCE for i in _intervals(run, moves))


def _intervals(run: PlayableRun, moves: Motion) -> Array:
    """Return for each frame the number of the state that ends the interval it lies in."""
    return np.searchsorted(run.t, moves.times - 1e-9)


class _Row(NamedTuple):
    """One contact of an impact."""

    percussion: float
    impact: Any
    k: int

    def arrow(self, length: float) -> Arrow:
        i, k = self.impact, self.k
        if i.tangential is None:
            return Arrow(i.time, i.point[k], i.normal[k], length, i.constraints[k])
        whole = self.percussion * i.normal[k] + i.tangential[k]
        direction = whole / np.linalg.norm(whole)
        return Arrow(i.time, i.point[k], i.normal[k], length, i.constraints[k], direction, i.regime[k] == "stick")


def marks(run: PlayableRun, moves: Motion, length: float) -> Array:
    """Return the marks in order of their beginnings, shape (n, 14).

    A row holds the times between which it is seen [s], what it is, its regime, where it stands [m], its unit direction,
    its width and length [m], and the columns of `moves` that touch, -1 for none. Marks of impacts end when they begin:
    the page shows them for a while.

    Parameters
    ----------
    run, moves : PlayableRun and Motion
        A run with a scene, and its poses.
    length : float
        Largest length of an arrow [m].
    """
    names, most, columns = ContactNames(run), cone_length(run, length), _columns(moves)
    rows = list[tuple[float, ...]]()
    for arrow in arrows(run):
        state = STICKS if arrow.sticks else SLIPS
        here, size = (arrow.time, arrow.time), arrow.length * length
        direction = arrow.normal if arrow.direction is None else arrow.direction
        touch = names.touching(arrow.name, columns)
        rows.append((*here, ARROW, state, *arrow.point, *direction, size, size, *touch))
        mu = names.friction(arrow.name) if arrow.direction is not None else 0.0
        rows.append((*here, NORMAL, state if mu > 0.0 else SMOOTH, *arrow.point, *arrow.normal, most, most, *touch))
        if mu > 0.0:
            _, wide, high = cone_size(mu, min(size, 2.0 * most))
            rows.append((*here, CONE, state, *arrow.point, *arrow.normal, wide, high, *touch))
    found = np.concatenate([np.reshape(rows, (-1, 14)), _contact_marks(run, moves, names, most)])
    return found[np.argsort(found[:, 0], kind="stable")]


def _contact_marks(run: PlayableRun, moves: Motion, names: ContactNames, most: float) -> Array:
    """Return the marks of recorded contacts, each from its frame to the next."""
    table = run.record.contacts
    if table is None:
        return np.zeros((0, 14))
    ends = np.append(moves.times[1:], np.inf)
    found = [_closed(table, int(i)) for i in _intervals(run, moves)]
    frame = np.repeat(np.arange(len(found)), [len(rows) for rows in found])
    row = np.concatenate(found)
    if not len(row):
        return np.zeros((0, 14))
    rank = np.concatenate([np.arange(len(rows)) for rows in found])
    whole = table.percussion[row, None] * table.normal[row]
    state = np.full(len(row), SMOOTH)
    if table.sticks is not None:
        whole = whole + table.tangential[row]
        state = np.where(table.sticks[row], STICKS, SLIPS)
    mu = np.array([names.friction(table.names[c]) for c in table.constraint[row].tolist()])
    state = np.where(mu > 0.0, state, SMOOTH)
    size = np.linalg.norm(whole, axis=1)
    long = most * _length(size, float(np.median(size)))
    seen = (moves.times[frame], ends[frame])
    slant = most / np.hypot(1.0, mu)
    columns, known = _columns(moves), np.array(table.constraint[row])
    touch = {c: names.touching(table.names[c], columns) for c in np.unique(known).tolist()}
    touching = np.array([touch[c] for c in known.tolist()])
    every = np.full(len(row), most)

    def rows(kind: int, regime: Array, direction: Array, wide: Array, high: Array) -> Array:
        return np.column_stack(
            [*seen, np.full(len(row), kind), regime, table.point[row], direction, wide, high, touching]
        )

    # thick enough to be seen, however short
    found_arrows = rows(ARROW, np.where(state == SMOOTH, SLIPS, state), whole / size[:, None], every, long)
    found_arrows = found_arrows[rank < _AT_ONCE]
    normals = rows(NORMAL, state, table.normal[row], every, every)
    cones = rows(CONE, state, table.normal[row], mu * slant, slant)[mu > 0.0]
    return np.concatenate([found_arrows, normals, cones])


def _closed(table: Any, i: int) -> Array:
    """Return the rows of an interval that have a point and a percussion, the strongest if there are many."""
    rows = np.arange(int(table.starts[i]), int(table.starts[i + 1]))
    rows = rows[np.isfinite(table.point[rows]).all(axis=1) & (table.percussion[rows] > 0.0)]
    return rows[np.argsort(-table.percussion[rows], kind="stable")[:_MOST_CONTACTS]]


def connection_marks(run: PlayableRun) -> list[PlacedShape]:
    """Return a ball of radius 1 m at each connection, on a body that moves.

    It is at the common point; a weld has none, and is marked at the origin of its second body. Connections that are
    switched in the run have no ball.
    """
    assert run.problem is not None
    system, found = run.problem.system, list[PlacedShape]()
    switched = {name for one in run.record.switches for name in one.connections}
    whole = [(system.whole, 0)] if system.whole is not None else []
    for part, before in whole or [(part.system, part.body) for part in system.located_parts()]:
        for one in part.equalities:
            if not isinstance(one, PointRows) or one.name in switched:
                continue
            body, point = (one.second, one.points[0, 3:]) if one.second else (one.first, one.points[0, :3])
            if len(one.normals) == _WELD and one.second:
                point = np.zeros(3)
            name = system.bodies[body + before]
            found.append(PlacedShape(name, Sphere(1.0), body + before, np.eye(3), point, _CONNECTED))
    return found


def _columns(moves: Motion) -> dict[int, int]:
    """Return the columns of bodies."""
    return {body: moves.driven + k for k, body in enumerate(moves.bodies)}


def strikes(run: PlayableRun, moves: Motion) -> Array:
    """Return rows of time [s], column of `moves` that was struck, and percussion [N s], in order, shape (n, 3)."""
    names, column = ContactNames(run), _columns(moves)
    known = dict[str, tuple[int, ...]]()
    rows = list[tuple[float, int, float]]()
    for impact in run.impacts:
        for name, p in zip(impact.constraints, impact.percussion.tolist(), strict=True):
            if name not in known:
                known[name] = names.bodies(name)
            rows += [(impact.time, column[body], p) for body in known[name] if body in column and p > 0.0]
    found = np.reshape(rows, (-1, 3))
    found = found[np.argsort(-found[:, 2], kind="stable")[:_MOST_STRIKES]]
    return found[np.argsort(found[:, 0], kind="stable")]


def cone_length(run: PlayableRun, length: float) -> float:
    """Return the length of the cones of recorded contacts [m], where arrows are up to `length` [m] long."""
    assert run.problem is not None
    # longer cones would hide the bodies of a pile
    return min(_CONE * length, _OF_BODIES * run.problem.length)


def cone_size(friction: float, length: float) -> Array:
    """Return the scales of a cone along its axes, shape (3,), so that its rays have a length."""
    height = length / np.hypot(1.0, friction)
    return height * np.array([friction, friction, 1.0])
