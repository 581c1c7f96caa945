"""Converts a Problem to JSON text and back; functions of the user cannot be kept.

A function is written as its source, for the reader. `not_kept` names each of them; in a problem that was restored
a stand-in without effect stands for a control or a force, and what moved by a motion of the user's stands still.
"""

from __future__ import annotations

import inspect
import json
from dataclasses import asdict, fields
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from ...errors import TrajectoryFileError
from ...geometry.motion import Motion, Oscillation, Rotation, Translation
from ...geometry.shapes.shapes import (
    Array,
    Box,
    Capsule,
    Convex,
    Cylinder,
    Ellipsoid,
    HalfSpace,
    Hull,
    PlacedShape,
    Sphere,
)
from ...system import parts_of
from ...system.actuators import Actuators, DrivenActuators
from ...system.joint_forces import JointForce
from ...system.mechanisms.articulated import Control
from ..assembly import assemble
from ..connected.items import ConnectionItem, CouplingItem
from ..items import BodyItem, ForceItem, RobotItem, SceneItems, SphereItem, SurfaceItem
from ..model import Start
from ..reductions import Omission, checked_reductions
from ..urdf.robot import Robot, build_model
from .given_again import LOST, GivenAgain, LostControl, LostForce, LostInputs, LostSceneControl
from .terrain import mesh_back, mesh_data

if TYPE_CHECKING:
    from ...problem import Problem

_MOTIONS: dict[str, type] = {c.__name__: c for c in (Translation, Oscillation, Rotation)}
# names of parts that a user replaced after building the scene
SYSTEM_BY_HAND, CONSTRAINTS_BY_HAND = "a system given by hand", "constraints given by hand"
_SHAPES: dict[str, type] = {c.__name__: c for c in (Sphere, Box, Ellipsoid, Capsule, Cylinder)}


def describe(problem: Problem) -> str:
    """Return a problem as JSON; of one given by functions, their source where Python has it."""
    if problem.scene is None:
        system = problem.system
        functions: list[Any] = [*system.functions()]
        functions += [f for family in problem.constraints.families for f in family.functions]
        sources = [_source(f) for f in functions if f is not None]
        return json.dumps({"kind": "functions", "system": type(system).__name__, "functions": sources})
    items = problem.scene.items
    start = problem.scene.start
    # many bodies may share a shape
    shapes: dict[int, Convex] = {id(s): s for b in items.bodies for s in (b.shape, *b.parts)}
    number = {shape: k for k, shape in enumerate(shapes)}
    return json.dumps(
        {
            "kind": "scene",
            "reduce": problem.scene.reduce,
            "gravity": items.gravity.tolist(),
            "restitution": items.restitution,
            "plane": items.plane,
            "pair_restitution": [[*sorted(pair), e] for pair, e in items.pair_restitution.items()],
            "friction": items.friction,
            "energy_cap": items.energy_cap,
            "pair_friction": [[*sorted(pair), mu] for pair, mu in items.pair_friction.items()],
            "resistance": list(items.resistance),
            "pair_resistance": [[sorted(pair), *lengths] for pair, lengths in items.pair_resistance.items()],
            "start": None if start is None else _plain(start._asdict()),
            "excluded": sorted(map(sorted, items.excluded)),
            "left_out": {name: sorted(map(sorted, pairs)) for name, pairs in items.left_out.items()},
            "walls": [
                {"name": n, "normal": list(w.normal), "offset": w.offset, "motion": _motion(w.motion)}
                for n, w in items.walls.items()
            ],
            "surfaces": [_surface(s) for s in items.surfaces],
            "robots": [_robot(r, _inputs(problem).get(r.robot.name)) for r in items.robots],
            "shapes": [_shape(s) for s in shapes.values()],
            "bodies": [_body(b, number) for b in items.bodies],
            "spheres": [_plain(s.__dict__) for s in items.spheres],
            "controls": [_source(control) for control in items.controls],
            "connections": [
                {
                    **_plain(c.__dict__),
                    "frames": None if c.frames is None else [f.tolist() for f in c.frames],
                    "control": None if c.control is None else _source(c.control),
                }
                for c in items.connections
            ],
            "couplings": [dict(c.__dict__) for c in items.couplings],
            "forces": [{"body": f.body, "source": _source(f.function)} for f in items.forces],
            "order_of_q_and_v": list(problem.system.bodies[1:]),
            "not_kept": sorted({*problem.not_kept, *_changed_by_hand(problem)} - set(_functions(items))),
        }
    )


def restore(text: str, given: GivenAgain | None = None) -> Problem | None:
    """Return the Problem that `describe` wrote, or None if it was given by functions or had a system given by hand.

    Its `not_kept` names what is missing of that which a user does not give again.
    """
    data = json.loads(text)
    if data["kind"] == "functions" or SYSTEM_BY_HAND in data.get("not_kept", ()):
        return None
    if data["kind"] != "scene":
        raise TrajectoryFileError(f"it holds a problem of the unknown kind {data['kind']!r}")
    given = given or GivenAgain()
    items = SceneItems(np.array(data["gravity"]), data["restitution"], data.get("plane"))
    for a, *b, e in data["pair_restitution"]:
        items.pair_restitution[frozenset((a, *b))] = e
    # older files have no friction
    items.friction, items.energy_cap = data.get("friction", 0.0), data.get("energy_cap", False)
    for a, *b, mu in data.get("pair_friction", ()):
        items.pair_friction[frozenset((a, *b))] = mu
    torsion, rolling = data.get("resistance", (0.0, 0.0))
    items.resistance = torsion, rolling
    for pair, torsion, rolling in data.get("pair_resistance", ()):
        items.pair_resistance[frozenset(pair)] = torsion, rolling
    items.excluded = {frozenset(pair) for pair in data.get("excluded", ())}
    items.left_out = {name: {frozenset(p) for p in pairs} for name, pairs in data.get("left_out", {}).items()}
    for wall in data["walls"]:
        items.walls[wall["name"]] = HalfSpace(tuple(wall["normal"]), wall["offset"], _motion_back(wall.get("motion")))
    items.surfaces += [_surface_back(s) for s in data.get("surfaces", ())]
    items.robots += [_robot_back(r, given.robots.get(r["name"])) for r in data["robots"]]
    shapes = [_shape_back(s) for s in data.get("shapes", ())]
    items.bodies += [_body_back(b, shapes) for b in data["bodies"]]
    items.spheres += [SphereItem(**_arrays(s)) for s in data["spheres"]]
    items.controls += given.scene or [LostSceneControl(str(source)) for source in data.get("controls", ())]
    for one in data.get("connections", ()):
        frames = one["frames"] and tuple(np.array(frame) for frame in one["frames"])
        limits, source = one.get("limits") and tuple(one["limits"]), one.get("control")
        control = None if source is None else given.robots.get(one["name"], LostControl(str(source)))
        own = {"frames": frames, "limits": limits, "control": control}
        items.connections.append(ConnectionItem(**_arrays(one) | own))
    items.couplings += [CouplingItem(**one) for one in data.get("couplings", ())]
    forces = {name: list(functions) for name, functions in given.forces.items()}
    for one in data.get("forces", ()):
        again, stand_in = forces.get(one["body"]), LostForce(str(one["source"]), "/" in one["body"])
        items.forces.append(ForceItem(one["body"], again.pop(0) if again else stand_in))
    # older files without reductions hold the states of the full model
    moved = data.get("start")
    start = moved and Start(_vector(moved["q"]), *(moved[key] for key in ("moved", "why") if key in moved))
    problem = assemble(items, checked_reductions(data.get("reduce", ())), start=start)
    driven = [*data["walls"], *data.get("surfaces", ()), *data["bodies"]]
    motions = [_motion_name(thing["name"]) for thing in driven if "source" in (thing.get("motion") or ())]
    named = data.get("not_kept", [])
    if not isinstance(named, list) or not all(isinstance(name, str) for name in named):
        raise TrajectoryFileError("not_kept of its scene is no list of texts")
    lost = [name for name, function in _actions(items) if isinstance(function, LOST)]
    problem.not_kept = tuple(dict.fromkeys([*lost, *motions, *named]))
    return problem


def _functions(items: SceneItems) -> list[str]:
    """Return the names of a scene's functions, which a file cannot keep."""
    moved: list[Any] = [*items.surfaces, *items.bodies]
    motions = [(name, wall.motion) for name, wall in items.walls.items()] + [(m.name, m.motion) for m in moved]
    return [
        *(name for name, _ in _actions(items)),
        *(
            _motion_name(name)
            for name, motion in motions
            if motion is not None and type(motion) not in _MOTIONS.values()
        ),
    ]


def _actions(items: SceneItems) -> list[tuple[str, Any]]:
    """Return the controls and forces of a scene with their names."""
    return [
        *(
            (f"control of robot {r.robot.name!r}", getattr(r.control, "function", r.control))
            for r in items.robots
            if r.control is not None and not isinstance(r.control, Actuators)
        ),
        *((f"control of hinge {c.name!r}", c.control) for c in items.connections if c.control is not None),
        *(("control of the scene", control) for control in items.controls),
        *((f"force on {force.body!r}", force.function) for force in items.forces),
    ]


def _changed_by_hand(problem: Problem) -> list[str]:
    """Return which parts of a problem differ from those that its scene was built to."""
    assert problem.scene is not None
    system, constraints = problem.scene.system, problem.scene.constraints
    same = len(constraints) == len(problem.constraints.constraints) and all(
        a is b for a, b in zip(constraints, problem.constraints.constraints, strict=True)
    )
    return [SYSTEM_BY_HAND] * (system is not problem.system) + [CONSTRAINTS_BY_HAND] * (not same)


def _motion_name(name: str) -> str:
    return f"motion of {name!r}"


def _source(function: Any) -> str:
    if isinstance(function, LOST):
        source: str = function.source
        return source
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


def _body(item: BodyItem, number: dict[int, int]) -> dict[str, Any]:
    shapes = {"shape": number[id(item.shape)], "parts": [number[id(part)] for part in item.parts]}
    return {**_plain(item.__dict__), **shapes, "motion": _motion(item.motion)}


def _body_back(data: dict[str, Any], shapes: list[Convex]) -> BodyItem:
    # files of version 0.1 hold a shape for each
    shape = shapes[data["shape"]] if isinstance(data["shape"], int) else _shape_back(data["shape"])
    # older files have no parts
    own = {"shape": shape, "parts": tuple(shapes[k] for k in data.get("parts", ()))}
    return BodyItem(**{**_arrays(data), **own, "motion": _motion_back(data.get("motion"))})


def _surface(item: SurfaceItem) -> dict[str, Any]:
    return {**_plain(item.__dict__ | mesh_data(item)), "motion": _motion(item.motion)}


def _surface_back(data: dict[str, Any]) -> SurfaceItem:
    return SurfaceItem(**{**_arrays(data), **mesh_back(data), "motion": _motion_back(data["motion"])})


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
    """Return the same motion object for all parts that move by it."""
    motion: Motion = _MOTIONS[kind](**json.loads(fields))
    return motion


def _inputs(problem: Problem) -> dict[str, Array]:
    """Return the present inputs of actuators by robot."""
    found = {part.name: getattr(part, "control", None) for part in parts_of(problem.system)}
    return {name: control.ctrl for name, control in found.items() if isinstance(control, Actuators)}


def _robot(item: RobotItem, ctrl: Array | None) -> dict[str, Any]:
    robot, function, actuators = item.robot, item.control, Actuators([], np.zeros(0))
    if isinstance(item.control, Actuators):
        function, actuators = None, item.control
    elif isinstance(item.control, DrivenActuators):
        function, actuators = item.control.function, item.control.actuators
    return {
        "name": robot.name,
        "urdf": robot.text,
        "planes": True,
        # a MJCF is kept as what was made of it, so that reading needs no MuJoCo
        "model": "" if robot.text else robot.model.saveToString(),
        "file": robot.file,
        "base": item.base,
        "position": item.position.tolist(),
        "rotation": item.rotation.tolist(),
        "q0": item.q0.tolist(),
        "v0": item.v0.tolist(),
        "locked": item.locked,
        "hulls_within": item.tolerance,
        "friction": dict(item.friction),
        "springs": [asdict(force) for force in item.springs],
        "actuators": [asdict(force) for force in actuators.forces],
        "ctrl": (actuators.ctrl if ctrl is None else ctrl).tolist(),
        "control": None if function is None else _source(function),
        "shapes": [{**_plain(s.__dict__), "shape": _shape(s.shape)} for s in robot.shapes],
        "apart": sorted(robot.apart),
        "omitted": robot.omitted,
    }


def _robot_back(data: dict[str, Any], control: Control | None) -> RobotItem:
    position, rotation = np.array(data["position"]), np.array(data["rotation"])
    if data["urdf"]:
        # older files have the shapes of planar joints along x and y of their frames
        model = build_model(data["urdf"], data["base"], rotation, position, planes=data.get("planes", False))
    else:
        model = pin.Model()
        model.loadFromString(data["model"])
    shapes = tuple(
        PlacedShape(**{**_arrays(s), "shape": _shape_back(s["shape"]), "color": tuple(s["color"])})
        for s in data["shapes"]
    )
    apart, omitted = frozenset((a, b) for a, b in data["apart"]), tuple(Omission(*one) for one in data["omitted"])
    robot = Robot(data["name"], data["urdf"], model, shapes, apart, omitted, pin.neutral(model), data.get("file", ""))
    start, locked = (_vector(data["q0"]), _vector(data["v0"])), tuple(data.get("locked", ()))
    springs, actuators = (tuple(map(_force_back, data.get(kind, ()))) for kind in ("springs", "actuators"))
    if control is None and data["control"] is not None:
        control = LostInputs(str(data["control"]), len(actuators)) if actuators else LostControl(str(data["control"]))
    if actuators:
        driven = Actuators(actuators, np.array(data["ctrl"]))
        control = driven if control is None else DrivenActuators(driven, control)
    # older files have a tolerance, which was exact where it was null
    within = data["hulls_within"] if "hulls_within" in data else data.get("tolerance") or 0.0
    friction = data.get("friction", {})
    return RobotItem(robot, data["base"], position, rotation, *start, control, locked, within, springs, friction)


def _force_back(data: dict[str, Any]) -> JointForce:
    pairs: dict[str, Any] = {name: tuple(value) for name, value in data.items() if isinstance(value, list)}
    joints = {name: tuple(coefficients) for name, coefficients in data["joints"].items()}
    return JointForce(**{**data, **pairs, "joints": joints})


def _vector(values: list[float]) -> Array:
    return np.array(values, dtype=float)
