"""A Problem as JSON text and back: everything that can be written down, which functions cannot."""

from __future__ import annotations

import inspect
import json
from dataclasses import fields
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from ..constraints.shapes import Array, Box, Capsule, Convex, Cylinder, Ellipsoid, HalfSpace, Hull, PlacedShape, Sphere
from ..constraints.triangles import Surface
from ..motion import Motion, Oscillation, Rotation, Translation
from .assembly import assemble
from .items import BodyItem, RobotItem, SceneItems, SphereItem, SurfaceItem
from .reductions import Omission
from .urdf import Robot, build_model

if TYPE_CHECKING:
    from ..problem import Problem

_MOTIONS: dict[str, type] = {c.__name__: c for c in (Translation, Oscillation, Rotation)}
_SHAPES: dict[str, type] = {c.__name__: c for c in (Sphere, Box, Ellipsoid, Capsule, Cylinder)}


def describe(problem: Problem) -> str:
    """Return a problem as JSON; of one given by functions, their source where Python has it."""
    if problem.scene is None:
        system = problem.system
        functions = [getattr(system, name, None) for name in ("_mass", "_force")]
        functions += [f for c in problem.constraints.constraints for f in (getattr(c, "_f", None),)]
        sources = [_source(f) for f in functions if f is not None]
        return json.dumps({"kind": "functions", "system": type(system).__name__, "functions": sources})
    items = problem.scene.items
    # many bodies may share one
    shapes = {id(b.shape): b.shape for b in items.bodies}
    number = {shape: k for k, shape in enumerate(shapes)}
    return json.dumps(
        {
            "kind": "scene",
            "reduce": problem.scene.reduce,
            "gravity": items.gravity.tolist(),
            "restitution": items.restitution,
            "plane": items.plane,
            "pair_restitution": [[*sorted(pair), e] for pair, e in items.pair_restitution.items()],
            "walls": [
                {"name": n, "normal": list(w.normal), "offset": w.offset, "motion": _motion(w.motion)}
                for n, w in items.walls.items()
            ],
            "surfaces": [_surface(s) for s in items.surfaces],
            "robots": [_robot(r) for r in items.robots],
            "shapes": [_shape(s) for s in shapes.values()],
            "bodies": [_body(b, number[id(b.shape)]) for b in items.bodies],
            "spheres": [_plain(s.__dict__) for s in items.spheres],
            "order_of_q_and_v": list(problem.system.bodies[1:]),
        }
    )


def restore(text: str) -> Problem | None:
    """Return the Problem that `describe` wrote, or None if it was given by functions."""
    data = json.loads(text)
    if data["kind"] != "scene":
        return None
    items = SceneItems(np.array(data["gravity"]), data["restitution"], data.get("plane"))
    for a, *b, e in data["pair_restitution"]:
        items.pair_restitution[frozenset((a, *b))] = e
    for wall in data["walls"]:
        items.walls[wall["name"]] = HalfSpace(tuple(wall["normal"]), wall["offset"], _motion_back(wall.get("motion")))
    items.surfaces += [_surface_back(s) for s in data.get("surfaces", ())]
    items.robots += [_robot_back(r) for r in data["robots"]]
    shapes = [_shape_back(s) for s in data.get("shapes", ())]
    items.bodies += [_body_back(b, shapes) for b in data["bodies"]]
    items.spheres += [SphereItem(**_arrays(s)) for s in data["spheres"]]
    # files of before there were reductions hold states of all
    return assemble(items, tuple(data.get("reduce", ())))


def lost(text: str) -> bool:
    """Tell whether a problem that `describe` wrote had a control or an own motion, which come back as none."""
    data = json.loads(text)
    moved = [*data.get("walls", ()), *data.get("surfaces", ()), *data.get("bodies", ())]
    return any(robot["control"] is not None for robot in data.get("robots", ())) or any(
        "source" in (thing.get("motion") or ()) for thing in moved
    )


def _source(function: Any) -> str:
    try:
        return inspect.getsource(function).strip()
    except (OSError, TypeError):
        return repr(function)


def _plain(fields: dict[str, Any]) -> dict[str, Any]:
    return {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in fields.items()}


def _arrays(fields: dict[str, Any]) -> dict[str, Any]:
    return {k: np.array(v) if isinstance(v, list) else v for k, v in fields.items()}


def _shape(shape: Convex) -> dict[str, Any]:
    if isinstance(shape, Hull):
        return {"kind": "Hull", "points": shape.vertices.tolist()}
    return {"kind": type(shape).__name__, **{f.name: getattr(shape, f.name) for f in fields(shape)}}


def _shape_back(data: dict[str, Any]) -> Convex:
    fields = {k: tuple(v) if isinstance(v, list) else v for k, v in data.items() if k not in ("kind", "points")}
    return Hull(np.array(data["points"])) if data["kind"] == "Hull" else _SHAPES[data["kind"]](**fields)


def _body(item: BodyItem, shape: int) -> dict[str, Any]:
    return {**_plain(item.__dict__), "shape": shape, "motion": _motion(item.motion)}


def _body_back(data: dict[str, Any], shapes: list[Convex]) -> BodyItem:
    # files of version 0.1 hold a shape for each
    shape = shapes[data["shape"]] if isinstance(data["shape"], int) else _shape_back(data["shape"])
    return BodyItem(**{**_arrays(data), "shape": shape, "motion": _motion_back(data.get("motion"))})


def _surface(item: SurfaceItem) -> dict[str, Any]:
    mesh = {"vertices": item.surface.vertices.tolist(), "triangles": item.surface.triangles.tolist()}
    return {**_plain(item.__dict__), "surface": mesh, "motion": _motion(item.motion)}


def _surface_back(data: dict[str, Any]) -> SurfaceItem:
    mesh = Surface(*(np.array(data["surface"][part]) for part in ("vertices", "triangles")))
    return SurfaceItem(**{**_arrays(data), "surface": mesh, "motion": _motion_back(data["motion"])})


def _motion(motion: Motion | None) -> dict[str, Any] | None:
    if motion is None:
        return None
    if type(motion) not in _MOTIONS.values():
        return {"source": _source(type(motion))}
    return {"kind": type(motion).__name__, **{f.name: getattr(motion, f.name) for f in fields(motion)}}  # type: ignore[arg-type]


def _motion_back(data: dict[str, Any] | None) -> Motion | None:
    if data is None or "source" in data:
        return None
    return _motion_of(data["kind"], json.dumps({name: value for name, value in data.items() if name != "kind"}))


@cache
def _motion_of(kind: str, fields: str) -> Motion:
    """Return one and the same motion for all that move by it."""
    motion: Motion = _MOTIONS[kind](**json.loads(fields))
    return motion


def _robot(item: RobotItem) -> dict[str, Any]:
    robot = item.robot
    return {
        "name": robot.name,
        "urdf": robot.text,
        "base": item.base,
        "position": item.position.tolist(),
        "rotation": item.rotation.tolist(),
        "q0": item.q0.tolist(),
        "v0": item.v0.tolist(),
        "locked": item.locked,
        "tolerance": item.tolerance,
        "control": None if item.control is None else _source(item.control),
        "shapes": [{**_plain(s.__dict__), "shape": _shape(s.shape)} for s in robot.shapes],
        "apart": sorted(robot.apart),
        "omitted": robot.omitted,
    }


def _robot_back(data: dict[str, Any]) -> RobotItem:
    position, rotation = np.array(data["position"]), np.array(data["rotation"])
    model = build_model(data["urdf"], data["base"], rotation, position)
    shapes = tuple(
        PlacedShape(**{**_arrays(s), "shape": _shape_back(s["shape"]), "color": tuple(s["color"])})
        for s in data["shapes"]
    )
    apart = frozenset((a, b) for a, b in data["apart"])
    omitted = tuple(Omission(*one) for one in data["omitted"])
    robot = Robot(data["name"], data["urdf"], model, shapes, apart, omitted, pin.neutral(model))
    start, locked = (_vector(data["q0"]), _vector(data["v0"])), tuple(data.get("locked", ()))
    return RobotItem(robot, data["base"], position, rotation, *start, None, locked, data.get("tolerance"))


def _vector(values: list[float]) -> Array:
    return np.array(values, dtype=float)
