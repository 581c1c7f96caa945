"""Pairs of shapes that the limits of a few joints keep apart for good: proven by branch and bound over these joints.

A joint's travel changes a distance by no more than that times its lever: how far from its axis the points of the one
shape can be, or those of the other, whichever is less. A box of joint positions is clear where the distance in its
middle is more than what all travels to its rim can take from it; otherwise it is halved.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import coal
import numpy as np
import pinocchio as pin

from ...arguments import watched
from ...geometry.shapes.shapes import Array, HalfSpace, PlacedShape, length_unit
from ...system import System

# widening of joint ranges, because steps violate limits a little: in radians and in sizes of the shapes
MARGIN = 0.05
# distances to be measured, in all and for a pair, and what looking at a pair costs in such units
_MOST, _MOST_EACH, _LOOK = 8_000, 400, 25
# boxes evaluated together
_AT_ONCE = 48
_ONE = np.eye(3)
_MOST_JOINTS = 4
# part of a distance that a lower bound may lose
_SURE = 0.75
# what a distance must exceed, in sizes of the smaller shape: they are measured to some 1e-6
_LEAST = 1e-3


class _Joint(NamedTuple):
    """A joint of one degree of freedom: its frame in its parent's, its axis, its range, and axis x, axis x (axis x)."""

    rotation: Array
    position: Array
    axis: Array
    turns: bool
    lower: float
    upper: float
    crosses: tuple[Array, Array]

    @property
    def travel(self) -> float:
        """How far its frame's origin moves [m]."""
        return 0.0 if self.turns else max(abs(self.lower), abs(self.upper))


class _Side(NamedTuple):
    """A shape, and the joints that carry it, from those that both sides share outwards."""

    placed: PlacedShape
    joints: list[_Joint]


def always_apart(
    systems: Sequence[System], shapes: Sequence[PlacedShape], walls: dict[str, HalfSpace], known: set[tuple[str, str]]
) -> Iterator[tuple[str, str, float]]:
    """Yield the names of pairs that can never meet, and lower bounds of their distances [m].

    Parameters
    ----------
    systems : sequence of System
        What moves the shapes; only those on articulated ones are looked at.
    shapes : sequence of PlacedShape
        All shapes of the scene.
    walls : dict of str to HalfSpace
        Those that stand still.
    known : set of (str, str)
        Pairs that are left out for other reasons.
    """
    moving = [s.shape.bound for s in shapes if s.body]
    chains = _chains(systems, MARGIN * float(np.median(moving)) if moving else 0.0)
    left = _MOST
    candidates = sorted(_candidates(chains, shapes, walls, known), key=lambda sides: sum(map(_count, sides)))
    geometry: dict[tuple[int, float], Any] = {}
    for first, second in watched(candidates, "pairs"):
        if left < _LOOK:
            return
        pair = _Pair(first, second, geometry)
        bound, spent = pair.bound(min(_MOST_EACH, left))
        left -= spent + _LOOK
        if bound > 0.0:
            yield pair.names[0], pair.names[1], bound


def _count(side: _Side | tuple[str, HalfSpace]) -> int:
    return len(side.joints) if isinstance(side, _Side) else 0


def _candidates(
    chains: list[list[tuple[int, _Joint | None]] | None],
    shapes: Sequence[PlacedShape],
    walls: dict[str, HalfSpace],
    known: set[tuple[str, str]],
) -> Iterator[tuple[_Side | tuple[str, HalfSpace], _Side]]:
    """Yield the pairs whose distance depends on few joints, all of them bounded."""
    carried = [(s, chains[s.body]) for s in shapes if s.motion is None]
    held = [(s, chain) for s, chain in carried if chain is not None]
    moving: list[tuple[PlacedShape, list[tuple[int, _Joint | None]] | None]] = []
    for j, (b, chain) in enumerate(held):
        # nothing of the world meets the world, of which there may be much
        for a, other in held[:j] if b.body else moving:
            if a.body == b.body or (a.name, b.name) in known:
                continue
            assert chain is not None and other is not None
            shared = sum(1 for x, y in zip(other, chain, strict=False) if x[0] == y[0])
            sides = [[joint for _, joint in links[shared:]] for links in (other, chain)]
            if all(None not in side for side in sides) and sum(map(len, sides)) <= _MOST_JOINTS:
                yield _Side(a, sides[0]), _Side(b, sides[1])  # type: ignore[arg-type]
        joints = [joint for _, joint in chain or ()]
        if joints and None not in joints and len(joints) <= _MOST_JOINTS:
            for named in walls.items():
                yield named, _Side(b, joints)  # type: ignore[arg-type]
        if b.body:
            moving.append((b, chain))


def _chains(systems: Sequence[System], slide: float) -> list[list[tuple[int, _Joint | None]] | None]:
    """Return what carries each body, from the world outwards, each joint with a number; None for a free body.

    `slide` is what the ranges of joints that slide are widened by [m].
    """
    chains: list[list[tuple[int, _Joint | None]] | None] = [[]]
    for system in systems:
        if system.model is None:
            chains += [None] * (len(system.bodies) - 1)
            continue
        first, model = len(chains), system.model
        joints = [None, *(_joint(model, j, slide) for j in range(1, model.njoints))]
        chains += [[(first + k, joints[k]) for k in list(model.supports[j])[1:]] for j in range(1, model.njoints)]
    return chains


def _joint(model: pin.Model, number: int, slide: float) -> _Joint | None:
    """Return a joint with its range widened, None if it is of another kind or unbounded."""
    joint = model.joints[number]
    if joint.nv != 1:
        return None
    data = joint.createData()
    joint.calc(data, pin.neutral(model))
    S = np.asarray(data.S).ravel()
    turns = bool(S[3:].any())
    if turns and S[:3].any():
        return None
    lower, upper = -np.pi, np.pi
    if joint.nq == 1:
        widen, first = MARGIN if turns else slide, model.idx_qs[number]
        lower, upper = model.lowerPositionLimit[first] - widen, model.upperPositionLimit[first] + widen
        # halves, for no limit may be the largest float
        if turns and 0.5 * upper - 0.5 * lower > np.pi:
            lower, upper = -np.pi, np.pi
        if not max(abs(lower), abs(upper)) < 1e100:
            return None
    place, axis = model.jointPlacements[number], S[3:] if turns else S[:3]
    cross = np.cross(_ONE, axis)
    frame = np.array(place.rotation), np.array(place.translation)
    return _Joint(*frame, axis, turns, lower, upper, (cross, cross @ cross))


class _Pair:
    """Two sides, of which the first may be a half-space, and how their distance follows the joints."""

    def __init__(
        self, first: _Side | tuple[str, HalfSpace], second: _Side, geometry: dict[tuple[int, float], Any]
    ) -> None:
        self._first, self._second = first, second
        self._chains = [first.joints if isinstance(first, _Side) else [], second.joints]
        if isinstance(first, _Side):
            self.names = first.placed.name, second.placed.name
            sides = first.placed, second.placed
            # Coal's tolerance is absolute
            self._size = min(s.shape.bound for s in sides)
            self._unit = length_unit([self._size])
            self._distance = coal.ComputeDistance(*(_made(s.shape, self._unit, geometry) for s in sides))
            self._coal_poses = coal.Transform3s(), coal.Transform3s()
            self._request, self._result = coal.DistanceRequest(), coal.DistanceResult()
            self._bounds = sum(s.shape.bound for s in sides)
            levers = np.minimum(_levers(first, second), _levers(second, first)[::-1])
        else:
            self.names, self._size = (first[0], second.placed.name), second.placed.shape.bound
            levers = _levers(second, _Side(second.placed, []))[::-1]
        order = [*reversed(self._chains[0]), *self._chains[1]]
        self._levers = np.where([joint.turns for joint in order], levers, 1.0)
        if not isinstance(first, _Side):
            # about an upright axis nothing rises
            self._levers[0] *= _tilt(first[1], second.joints[0])
        self._range = np.array([[joint.lower, joint.upper] for joint in order])

    def bound(self, most: int) -> tuple[float, int]:
        """Return what the distance is at least, 0 if that is not known, and how many distances were measured."""
        middle, half = self._range.mean(axis=1)[None], 0.5 * np.ptp(self._range, axis=1)[None]
        hope, least, spent = np.zeros(1), np.inf, 0
        while len(middle):
            # where two shapes can meet, that is found soonest in the boxes with the least to spare
            order = np.argsort(hope, kind="stable")
            now, later = order[:_AT_ONCE], order[_AT_ONCE:]
            box, width = middle[now], half[now]
            taken, poses = width @ self._levers, self._poses(box)
            distance = self._far(poses)
            for k in np.flatnonzero(distance * _SURE < taken).tolist():
                spent += 1
                distance[k] = self._measured(poses, k)
                if spent > most or not distance[k] > _LEAST * self._size:
                    return 0.0, spent
            clear = distance * _SURE >= taken
            least = min(least, (distance - taken)[clear].min(initial=np.inf))
            boxes = _halved(box[~clear], width[~clear], self._levers)
            middle, half = (np.concatenate([a[later], b]) for a, b in zip((middle, half), boxes, strict=True))
            hope = np.concatenate([hope[later], np.tile((distance - taken)[~clear], 2)])
        return float(least), spent

    def _poses(self, positions: Array) -> list[tuple[Array, Array]]:
        """Return where both shapes are, rotations of shape (n, 3, 3) and origins (n, 3), in the frame they share."""
        n = len(self._chains[0])
        columns = [positions[:, :n][:, ::-1], positions[:, n:]]
        sides = [self._first, self._second]
        return [
            _placed(side.placed, chain, column)
            for side, chain, column in zip(sides, self._chains, columns, strict=True)
            if isinstance(side, _Side)
        ]

    def _far(self, poses: list[tuple[Array, Array]]) -> Array:
        """Return what the distances are at least, by bounding balls, shape (n,); of a half-space they are exact."""
        if isinstance(self._first, _Side):
            return np.linalg.norm(poses[1][1] - poses[0][1], axis=1) - self._bounds
        wall, (turn, origin) = self._first[1], poses[0]
        centres, half_axes, radius = self._second.placed.shape.support_points()
        up = np.vecmat(np.asarray(wall.normal), turn)
        sag = np.linalg.norm(half_axes * up[:, None], axis=2)
        return (up @ centres.T - sag).min(axis=1) - radius + origin @ np.asarray(wall.normal) - wall.offset

    def _measured(self, poses: list[tuple[Array, Array]], k: int) -> float:
        if not isinstance(self._first, _Side):
            return float(self._far([(poses[0][0][k : k + 1], poses[0][1][k : k + 1])])[0])
        for pose, (turn, origin) in zip(self._coal_poses, poses, strict=True):
            pose.setTransform(turn[k], origin[k] / self._unit)
        self._result.clear()
        return float(self._distance(*self._coal_poses, self._request, self._result)) * self._unit


def _made(shape: Any, unit: float, geometry: dict[tuple[int, float], Any]) -> Any:
    # hulls are dear to make
    key = id(shape), unit
    if key not in geometry:
        geometry[key] = shape.coal(unit)
    return geometry[key]


def _tilt(wall: HalfSpace, joint: _Joint) -> float:
    """Return how much of the travel of what a joint carries goes along a wall's normal."""
    axis, normal = joint.rotation @ joint.axis, np.asarray(wall.normal)
    return float(np.linalg.norm(np.cross(axis, normal))) if joint.turns else abs(float(axis @ normal))


def _levers(one: _Side, other: _Side) -> Array:
    """Return how far from each joint's axis one side's points can be, from its own joints to the other's, outwards."""
    path, own = [*reversed(one.joints), *other.joints], len(one.joints)
    # the ball around each of them travels along
    centres, half_axes, _ = one.placed.shape.support_points()
    points = centres @ one.placed.rotation.T + one.placed.position
    if not own:
        # as the first joint's frame sees what stands still
        points = (points - path[0].position) @ path[0].rotation
    swell = np.abs(half_axes).max(axis=1)
    levers = [float((np.linalg.norm(np.cross(path[0].axis, points), axis=1) + swell).max())]
    far = float((np.linalg.norm(points, axis=1) + swell).max())
    for k in range(1, len(path)):
        inner, outer = path[k - 1], path[k]
        if k < own:
            inner, outer = outer, inner
        # from one origin to the next, and how far joints shift it
        between = outer.position - inner.position if k == own else outer.position
        far += float(np.linalg.norm(between)) + outer.travel + (inner.travel if k == own or k == 1 else 0.0)
        levers.append(far)
    return np.array(levers)


def _placed(placed: PlacedShape, chain: list[_Joint], positions: Array) -> tuple[Array, Array]:
    n = len(positions)
    turn, origin = np.broadcast_to(_ONE, (n, 3, 3)), np.zeros((n, 3))
    for joint, x in zip(chain, positions.T, strict=True):
        origin = origin + turn @ joint.position
        turn = turn @ joint.rotation
        if joint.turns:
            about, twice = joint.crosses
            turn = turn @ (_ONE + np.sin(x)[:, None, None] * about + (1.0 - np.cos(x))[:, None, None] * twice)
        else:
            origin = origin + x[:, None] * (turn @ joint.axis)
    return turn @ placed.rotation, origin + turn @ placed.position


def _halved(middle: Array, half: Array, levers: Array) -> tuple[Array, Array]:
    """Return the halves of boxes, cut across where most is travelled."""
    widest, here = np.argmax(half * levers, axis=1), np.arange(len(half))
    half = half.copy()
    half[here, widest] *= 0.5
    shift = np.zeros_like(middle)
    shift[here, widest] = half[here, widest]
    return np.concatenate([middle - shift, middle + shift]), np.concatenate([half, half])
