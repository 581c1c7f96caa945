"""Writes a run to an MCAP log, which Foxglove, PlotJuggler and the tools of ROS 2 read.

Every message is JSON under a schema of its own, so that a reader needs no definitions from elsewhere. Poses and shapes
are Foxglove's messages `FrameTransforms` and `SceneUpdate`. Log times are nanoseconds since the start of the run.
"""

from __future__ import annotations

import heapq
import json
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from ...errors import InputError
from ...geometry.shapes.shapes import Box, Capsule, Cylinder, Ellipsoid, PlacedShape, Sphere
from ..replay.motion import motion, shapes_of
from ..tables import table

if TYPE_CHECKING:
    from ..run_data import Array, RunData

_STATE, _IMPACT = "mbvi.State", "mbvi.Impact"
_POSES, _SHAPES = "foxglove.FrameTransforms", "foxglove.SceneUpdate"
_NANO = 1_000_000_000


class _Message(NamedTuple):
    """A message of a topic at a time since the start [s]."""

    topic: str
    time: float
    content: dict[str, Any]


def write_mcap(run: RunData, path: Path) -> None:
    """Write the file; see `Trajectory.export`.

    Raises
    ------
    InputError
        If mcap is not installed.
    """
    try:
        from mcap.writer import Writer
    except ImportError as error:
        raise InputError("an MCAP file needs the package mcap: pip install 'mbvi[mcap]'") from error
    schemas = {"/state": _STATE, "/impacts": _IMPACT}
    messages = [_states(run), _impacts(run)]
    # a scene may have nothing to show
    with suppress(InputError):
        messages.append(_scene(run, shapes_of(run)["visual"]))
        schemas |= {"/tf": _POSES, "/scene": _SHAPES}
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="", library="mbvi")
        channels = {}
        for topic, name in schemas.items():
            schema = writer.register_schema(name, "jsonschema", json.dumps(_schema(name)).encode())
            channels[topic] = writer.register_channel(topic, "json", schema)
        # readers expect messages in the order of their times
        for k, message in enumerate(heapq.merge(*messages, key=lambda m: m.time)):
            time = round(message.time * _NANO)
            data = json.dumps(message.content, allow_nan=False).encode()
            writer.add_message(channels[message.topic], log_time=time, publish_time=time, data=data, sequence=k)
        about = {"scheme": run.scheme, "step": repr(run.step), "notes": "\n".join(run.notes)}
        units = {name: column.unit for name, column in table(run, "states").items()}
        writer.add_metadata("run", about)
        writer.add_metadata("units", units)
        writer.finish()


def _schema(name: str) -> dict[str, Any]:
    """Return the JSON schema of a kind of message."""
    number: dict[str, Any] = {"type": "number"}
    entries = {"type": "object", "additionalProperties": number}
    fields: dict[str, Any] = {
        _STATE: {
            "t": number,
            "q": entries,
            "v": entries,
            "energy": entries,
            "penetration": number,
            "limit_violation": number,
            "residual": number,
        },
        _IMPACT: {"time": number, "contacts": {"type": "array", "items": {"type": "object"}}},
        _POSES: {"transforms": {"type": "array", "items": {"type": "object"}}},
        _SHAPES: {"entities": {"type": "array", "items": {"type": "object"}}},
    }[name]
    return {"title": name, "type": "object", "properties": fields}


def _states(run: RunData) -> Iterator[_Message]:
    columns = table(run, "states")
    groups: dict[str, dict[str, Any]] = {}
    for name, column in columns.items():
        group, slash, inner = name.partition("/")
        groups.setdefault(group, {})[inner if slash else ""] = column.values
    rows = {group: np.stack(list(inner.values()), axis=1) for group, inner in groups.items()}
    for i, time in enumerate(run.t.tolist()):
        content = {
            group: rows[group][i].item() if "" in inner else dict(zip(inner, rows[group][i].tolist(), strict=True))
            for group, inner in groups.items()
        }
        yield _Message("/state", time - float(run.t[0]), content)


def _impacts(run: RunData) -> Iterator[_Message]:
    columns = table(run, "impacts")
    lists = [one.values if isinstance(one.values, list) else one.values.tolist() for one in columns.values()]
    contacts: dict[int, list[dict[str, Any]]] = {}
    for row in zip(*lists, strict=True):
        # JSON has no NaN
        content: dict[str, Any] = {
            name: None if value != value else value for name, value in zip(columns, row, strict=True)
        }
        contacts.setdefault(content["instant"], []).append(content)
    for rows in contacts.values():
        time = rows[0]["time"]
        yield _Message("/impacts", time - float(run.t[0]), {"time": time, "contacts": rows})


def _scene(run: RunData, shown: Sequence[PlacedShape]) -> Iterator[_Message]:
    """Yield the shapes once, and the poses of bodies at the frames of a replay."""
    assert run.problem is not None
    names = run.problem.system.bodies
    stamp = _stamp(0.0)
    entities = [_entity(placed, names[placed.body], stamp) for placed in shown]
    yield _Message("/scene", 0.0, {"deletions": [], "entities": entities})
    moves = motion(run, shown=shown)
    times, first = moves.times - moves.times[0], moves.driven
    for time, places, turns in zip(times.tolist(), moves.position[:, first:], moves.quaternion[:, first:], strict=True):
        stamp = _stamp(time)
        transforms = [
            {"timestamp": stamp, "parent_frame_id": names[0], "child_frame_id": names[body], **_pose(p, x)}
            for body, p, x in zip(moves.bodies, places.tolist(), turns.tolist(), strict=True)
        ]
        yield _Message("/tf", time, {"transforms": transforms})


def _stamp(time: float) -> dict[str, int]:
    second, nano = divmod(round(time * _NANO), _NANO)
    return {"sec": second, "nsec": nano}


def _pose(place: Any, turn: Any, first: str = "translation", second: str = "rotation") -> dict[str, Any]:
    return {first: dict(zip("xyz", place, strict=True)), second: dict(zip("xyzw", turn, strict=True))}


def _entity(placed: PlacedShape, frame: str, stamp: dict[str, int]) -> dict[str, Any]:
    """Return a shape fixed to its body's frame."""
    shape, color = placed.shape, dict(zip("rgba", placed.color, strict=True))
    turn, place = Rotation.from_matrix(placed.rotation).as_quat().tolist(), np.asarray(placed.position)
    whole = {"pose": _pose(place.tolist(), turn, "position", "orientation"), "color": color}
    made: dict[str, Any]
    if isinstance(shape, Sphere | Ellipsoid):
        radii = [shape.radius] * 3 if isinstance(shape, Sphere) else list(shape.radii)
        made = {"spheres": [{**whole, "size": _size([2.0 * r for r in radii])}]}
    elif isinstance(shape, Box):
        made = {"cubes": [{**whole, "size": _size(shape.size)}]}
    elif isinstance(shape, Cylinder | Capsule):
        wide = 2.0 * shape.radius
        middle = {**whole, "size": _size([wide, wide, shape.length]), "bottom_scale": 1.0, "top_scale": 1.0}
        made = {"cylinders": [middle]}
        if isinstance(shape, Capsule):
            ends = [place + half * shape.length * placed.rotation[:, 2] for half in (-0.5, 0.5)]
            balls = [{**whole, "pose": _pose(end.tolist(), turn, "position", "orientation")} for end in ends]
            made["spheres"] = [{**ball, "size": _size([wide] * 3)} for ball in balls]
    else:
        points = [dict(zip("xyz", point, strict=True)) for point in np.asarray(shape.vertices).tolist()]
        made = {"triangles": [{**whole, "points": points, "indices": np.asarray(shape.triangles).ravel().tolist()}]}
    head = {"timestamp": stamp, "frame_id": frame, "id": placed.name, "lifetime": _stamp(0.0), "frame_locked": True}
    return head | made


def _size(values: Array | Any) -> dict[str, float]:
    return dict(zip("xyz", map(float, values), strict=True))
