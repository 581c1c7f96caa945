"""A Problem as JSON text and back: everything that can be written down, which functions cannot."""

from __future__ import annotations

import inspect
import json
from dataclasses import fields
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from ..constraints.shapes import Array, Box, Capsule, Convex, Cylinder, Ellipsoid, HalfSpace, Hull, PlacedShape, Sphere
from .assembly import assemble
from .items import BodyItem, RobotItem, SceneItems, SphereItem
from .urdf import Robot, build_model

if TYPE_CHECKING:
    from ..problem import Problem

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
    return json.dumps(
        {
            "kind": "scene",
            "gravity": items.gravity.tolist(),
            "restitution": items.restitution,
            "pair_restitution": [[*sorted(pair), e] for pair, e in items.pair_restitution.items()],
            "walls": [{"name": n, "normal": list(w.normal), "offset": w.offset} for n, w in items.walls.items()],
            "robots": [_robot(r) for r in items.robots],
            "bodies": [_body(b) for b in items.bodies],
            "spheres": [_plain(s.__dict__) for s in items.spheres],
            "order_of_q_and_v": list(problem.system.bodies[1:]),
        }
    )


def restore(text: str) -> Problem | None:
    """Return the Problem that `describe` wrote, or None if it was given by functions."""
    data = json.loads(text)
    if data["kind"] != "scene":
        return None
    items = SceneItems(np.array(data["gravity"]), data["restitution"])
    for a, *b, e in data["pair_restitution"]:
        items.pair_restitution[frozenset((a, *b))] = e
    for wall in data["walls"]:
        items.walls[wall["name"]] = HalfSpace(tuple(wall["normal"]), wall["offset"])
    items.robots += [_robot_back(r) for r in data["robots"]]
    items.bodies += [BodyItem(**{**_arrays(b), "shape": _shape_back(b["shape"])}) for b in data["bodies"]]
    items.spheres += [SphereItem(**_arrays(s)) for s in data["spheres"]]
    return assemble(items)


def lost(text: str) -> bool:
    """Tell whether a problem that `describe` wrote had a control, which comes back as none."""
    return any(robot["control"] is not None for robot in json.loads(text).get("robots", ()))


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


def _body(item: BodyItem) -> dict[str, Any]:
    return {**_plain(item.__dict__), "shape": _shape(item.shape)}


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
    omitted = tuple((a, b) for a, b in data["omitted"])
    robot = Robot(data["name"], data["urdf"], model, shapes, apart, omitted, pin.neutral(model))
    return RobotItem(robot, data["base"], position, rotation, _vector(data["q0"]), _vector(data["v0"]), None)


def _vector(values: list[float]) -> Array:
    return np.array(values, dtype=float)
