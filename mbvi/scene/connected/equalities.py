"""Turns the connections and couplings of a scene into equalities of its systems."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ...errors import InadmissibleStartError, InputError
from ...geometry.shapes.shapes import Array, PlacedShape
from ...system import System, located_parts
from ...system.mechanisms.equalities import CoupledJoints, Equality, PointRows, joint_value
from ...system.system import Part
from ..items import SceneItems
from ..urdf.mimic import joint_position
from .items import ConnectionItem, CouplingItem

# points on the axes of a weld and a hinge are so far from the common point, so that gaps there are angles [m]
_ARM = 1.0
# points of these frames, by their axes, and which of their coordinates in the first frame are equal
_ROWS = {
    "point": (((0.0, 0.0, 0.0), (0, 1, 2)),),
    "hinge": (((0.0, 0.0, 0.0), (0, 1, 2)), ((0.0, 0.0, _ARM), (0, 1))),
    "weld": (((0.0, 0.0, 0.0), (0, 1, 2)), ((0.0, 0.0, _ARM), (0, 1)), ((_ARM, 0.0, 0.0), (1,))),
}


class Side(NamedTuple):
    """One side of a connection: the number of its body, the body's frame, and that of its name in the body's frame.

    Frames have shape (4, 3): the columns of the rotation, then the origin [m].
    """

    body: int
    pose: Array
    frame: Array


def point_rows(item: ConnectionItem, first: Side, second: Side) -> PointRows:
    """Return the rows of a connection.

    Raises
    ------
    InputError
        If nothing is known of where the connection is; see `ConnectionItem`.
    """
    frames, points, normals = frames_of(item, first, second), [], []
    for place, axes in _ROWS[item.kind]:
        ends = [frame[3] + np.array(place) @ frame[:3] for frame in frames]
        for k in axes:
            points.append(np.concatenate(ends))
            normals.append(frames[0][k])
    return PointRows(item.name, first.body, second.body, np.array(points), np.array(normals))


def frames_by_name(item: ConnectionItem, first: Side, second: Side) -> tuple[Array, Array]:
    """Return the frame of a connection in that of each name, as `ConnectionItem.frames` holds them."""
    common = _common(item, first)
    one, other = (_seen_from(_composed(side.pose, side.frame), common) for side in (first, second))
    return one, other


def frames_as_they_are(item: ConnectionItem, start: tuple[Side, Side], now: tuple[Side, Side]) -> tuple[Array, Array]:
    """Return the frames of a connection that holds both sides as they are now.

    Its frame stays where its first side has it, which is known `now` or, of a point in the world, at the `start`.
    """
    first = frames_by_name(item, *start)[0] if item.frames is None else item.frames[0]
    common = _composed(_composed(now[0].pose, now[0].frame), first)
    return first, _seen_from(_composed(now[1].pose, now[1].frame), common)


def frames_of(item: ConnectionItem, first: Side, second: Side) -> list[Array]:
    """Return the frame of a connection in each of its bodies, shapes (4, 3)."""
    if item.frames is not None:
        return [_composed(side.frame, frame) for side, frame in zip((first, second), item.frames, strict=True)]
    common = _common(item, first)
    return [_seen_from(side.pose, common) for side in (first, second)]


def _common(item: ConnectionItem, first: Side) -> Array:
    """Return the frame of a connection in the world."""
    origin = _composed(first.pose, first.frame)[3] if item.at is None else item.at
    return np.vstack([_axes(item.axis), origin])


def sides_at(
    items: SceneItems, system: System, frames: Mapping[str, PlacedShape], shapes: Sequence[PlacedShape], q: Array
) -> dict[str, Side]:
    """Return `sides_of` a scene where it starts."""
    world, bodies = np.vstack([np.eye(3), np.zeros(3)])[None], np.arange(1, len(system.bodies))
    return sides_of(items, frames, shapes, np.concatenate([world, system.placements(q, bodies)]))


def _composed(pose: Array, frame: Array) -> Array:
    """Return a frame in the world, or in another frame."""
    return np.vstack([frame[:3] @ pose[:3], frame[3] @ pose[:3] + pose[3]])


def _seen_from(pose: Array, frame: Array) -> Array:
    """Return a frame of the world as a body sees it."""
    return np.vstack([frame[:3] @ pose[:3].T, (frame[3] - pose[3]) @ pose[:3].T])


def _axes(axis: Array | None) -> Array:
    """Return three axes in rows, of which the last is the given one."""
    if axis is None:
        return np.eye(3)
    other = np.eye(3)[np.argmin(np.abs(axis))]
    side = np.cross(other, axis)
    side /= np.linalg.norm(side)
    return np.array([side, np.cross(axis, side), axis])


def sides_of(
    items: SceneItems, frames: Mapping[str, PlacedShape], shapes: Sequence[PlacedShape], poses: Array
) -> dict[str, Side]:
    """Return the sides of the connections of a scene by their names.

    Parameters
    ----------
    items : SceneItems
        The scene.
    frames : dict of str to PlacedShape
        Frames of links; see `Blocks`.
    shapes : sequence of PlacedShape
        The shapes of the scene, which name bodies and spheres.
    poses : ndarray, shape (bodies, 4, 3)
        Of all bodies at the start, the world first.
    """
    named = {s.name: s for s in shapes} | dict(frames)
    world, found = np.vstack([np.eye(3), np.zeros(3)]), dict[str, Side]()
    for name in {side for c in items.connections for side in (c.first, c.second)}:
        body = 0 if name == "world" else named[name].body if name in named else 0
        place = named.get(name) if name in frames else None
        own = world if place is None else np.vstack([place.rotation.T, place.position])
        found[name] = Side(body, poses[body], own)
    return found


def check_reversed(
    items: SceneItems,
    system: System,
    frames: Mapping[str, PlacedShape],
    shapes: Sequence[PlacedShape],
    start: Array,
    closed: Array,
) -> None:
    """Raise `InadmissibleStartError` if a weld or hinge with given frames closes turned by 180 degrees.

    Its rows are zero there, too. `start` is where the scene starts and `closed` where what it holds is closed, both of
    shape (nq,). The other arguments are those of `equalities_between`.
    """
    found = [item for item in items.active_connections if item.kind != "point" and item.frames is not None]
    for item, turn in zip(found, _turns(found, items, system, frames, shapes, closed), strict=True):
        if (np.diag(turn)[2 if item.kind == "hinge" else 0 :] < 0.0).any():
            (before,) = _turns([item], items, system, frames, shapes, start)
            cosine = before[2, 2] if item.kind == "hinge" else 0.5 * (np.trace(before) - 1.0)
            raise InadmissibleStartError(
                f"{item.name} is off by {np.arccos(np.clip(cosine, -1.0, 1.0)):.3g} rad at the start, and the motion "
                f"that closes it ends with {item.first} turned by 180 degrees relative to {item.second}; start within "
                "1 rad of its orientation"
            )


def _turns(
    found: Sequence[ConnectionItem],
    items: SceneItems,
    system: System,
    frames: Mapping[str, PlacedShape],
    shapes: Sequence[PlacedShape],
    q: Array,
) -> list[Array]:
    """Return the products of the axes of both frames of some connections at q, shape (3, 3) each."""
    sides, turns = sides_at(items, system, frames, shapes, q) if found else {}, []
    for item in found:
        both = (sides[item.first], sides[item.second])
        one, other = (_composed(side.pose, frame) for side, frame in zip(both, frames_of(item, *both), strict=True))
        turns.append(one[:3] @ other[:3].T)
    return turns


def check_spheres(items: SceneItems, sides: Mapping[str, Side]) -> None:
    """Raise `InputError` if a connection would turn a sphere, which only friction does."""
    spheres = set() if items.frictional else {name for s in items.spheres for name in s.names()}
    for item in items.connections:
        for name in spheres & {item.first, item.second}:
            centre = sides[name].pose[3]
            if item.kind != "point" or (item.at is not None and np.abs(item.at - centre).max() > 1e-9):
                raise InputError(
                    f"{item.name} would turn {name}, which has no rotation in a scene without friction: connect its "
                    "centre, or set friction"
                )


class Joints(NamedTuple):
    """The joints of a scene with one degree of freedom, by their names "robot/joint".

    Attributes
    ----------
    places : dict of str to (int, int, int)
        Of those that move; see `CoupledJoints`.
    still : dict of str to float
        Positions of those that are locked [rad, m].
    """

    places: dict[str, tuple[int, int, int]]
    still: dict[str, float]

    def position(self, name: str, q: Array) -> float:
        """Return where a joint is at q, shape (nq,)."""
        if name in self.still:
            return self.still[name]
        first, _, width = self.places[name]
        # a copy, because kernels take no read-only arrays
        return float(joint_value(q[first : first + width].copy(), 0, width))


def joints_of(items: SceneItems, parts: Sequence[Part]) -> Joints:
    """Return the joints of a scene, of which these are the systems."""
    places, still = dict[str, tuple[int, int, int]](), dict[str, float]()
    for robot, part in zip(items.robots, parts, strict=False):
        full, model = robot.robot.model, part.system.model
        assert model is not None
        for j in range(1, full.njoints):
            name, label = full.names[j], f"{robot.robot.name}/{full.names[j]}"
            if full.nvs[j] != 1:
                continue
            if model.existJointName(name):
                i = model.getJointId(name)
                places[label] = part.q + model.idx_qs[i], part.v + model.idx_vs[i], model.nqs[i]
            else:
                still[label] = joint_position(full, j, robot.q0)
    return Joints(places, still)


def offset_as_it_is(item: CouplingItem, joints: Joints, q: Array) -> float:
    """Return the offset with which a coupling holds its joints as they are at q, shape (nq,)."""
    first = joints.position(item.first, q)
    return first - item.ratio * joints.position(item.second, q) if item.second else first


def _coupled_joints(items: SceneItems, parts: Sequence[Part]) -> list[CoupledJoints]:
    """Return the couplings of a scene that are not switched off, of which these are the systems."""
    (places, still), nothing = joints_of(items, parts), (-1, -1, 0)
    found = []
    for one in items.couplings:
        if not one.active:
            continue
        first, second, ratio, offset = places.get(one.first), places.get(one.second), one.ratio, one.offset
        if first is not None and second is not None:
            found.append(CoupledJoints(one.name, first, second, ratio, offset))
        elif first is not None:
            held = offset + (ratio * still[one.second] if one.second else 0.0)
            found.append(CoupledJoints(one.name, first, nothing, 0.0, held))
        elif second is not None and ratio:
            found.append(CoupledJoints(one.name, second, nothing, 0.0, (still[one.first] - offset) / ratio))
    return found


def equalities_between(
    items: SceneItems, system: System, frames: Mapping[str, PlacedShape], shapes: Sequence[PlacedShape], q: Array
) -> tuple[dict[int, list[Equality]], list[Equality]]:
    """Return the equalities of a scene: those within each part of its system by its number, and those between parts.

    Parameters
    ----------
    items, frames, shapes
        See `sides_of`.
    system : System
        What they connect.
    q : ndarray, shape (nq,)
        Where the scene starts.
    """
    parts, sides = located_parts(system), sides_at(items, system, frames, shapes, q)
    check_spheres(items, sides)
    active = items.active_connections
    points = [point_rows(one, sides[one.first], sides[one.second]) for one in active]
    first_body, first_velocity = [p.body for p in parts], [p.v for p in parts]
    within, between = dict[int, list[Equality]](), list[Equality]()
    for one, rows in zip(active, points, strict=True):
        if one.acts:
            between.append(rows)
            continue
        owners = {_part_of(first_body, side - 1) for side in (rows.first, rows.second) if side}
        _sort(rows, owners, parts, within, between)
    for coupled in _coupled_joints(items, parts):
        sides_in_v = (coupled.first[1], coupled.second[1])
        owners = {_part_of(first_velocity, v) for v in sides_in_v if v >= 0}
        _sort(coupled, owners, parts, within, between)
    return within, between


def _part_of(starts: Sequence[int], number: int) -> int:
    return bisect_right(starts, number) - 1


def _sort(
    one: Equality, owners: set[int], parts: Sequence[Part], within: dict[int, list[Equality]], between: list[Equality]
) -> None:
    (owner, *others), part = owners, parts[min(owners)]
    if others or part.system.model is None:
        between.append(one)
    else:
        within.setdefault(owner, []).append(one.moved_to(-part.q, -part.v, -part.body))
