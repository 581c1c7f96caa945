"""Visual shapes and colours of URDFs, read when a replay is made."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin

from ...arguments import watched
from ...errors import InputError
from ...geometry.shapes.shapes import Box, Capsule, Cylinder, PlacedShape, Sphere
from ..meshes.visual import Mesh, visual_mesh
from ..plane import axes_of, on_planar_base
from .checks import mesh_folders, mesh_path
from .self_pairs import shape_labels
from .still_joints import counts_joints, without_still_joints

if TYPE_CHECKING:
    from ..items import RobotItem
    from ..model import SceneModel

Color = tuple[float, float, float, float]
Element = ElementTree.Element

_PLAIN: Color = (0.6, 0.65, 0.72, 1.0)


def visual_shapes(scene: SceneModel) -> tuple[list[PlacedShape], list[str]]:
    """Return the shapes of a scene to look at: of robots their visual shapes, of all else what touches.

    Of a robot without visual shapes, or whose mesh files cannot be read any more, these are its collision shapes.

    Returns
    -------
    shapes : list of PlacedShape
        Each on the body that carries it; `shape` may be a `Mesh`.
    notes : list of str
        Which robots' mesh files cannot be read.
    """
    seen: dict[str, list[PlacedShape]] = {}
    notes, before = [], 0
    meshes: dict[tuple[Path, tuple[float, ...]], Mesh] = {}
    for item in scene.items.robots:
        try:
            shapes = list(_of_robot(item, meshes))
        except InputError as error:
            notes.append(f"{item.robot.name} is shown by its collision shapes: {error}")
            shapes = []
        model, shapes = _carried(item, shapes, scene)
        if shapes:
            seen[item.robot.name] = [replace(s, body=s.body + before if s.body else 0) for s in shapes]
        before += model.njoints - 1
    others = [s for s in scene.shapes if s.name.partition("/")[0] not in seen]
    return [s for shapes in seen.values() for s in shapes] + others, notes


def _carried(item: RobotItem, shapes: list[PlacedShape], scene: SceneModel) -> tuple[pin.Model, list[PlacedShape]]:
    """Return the model that was built of a robot, and shapes on the bodies that carry them there."""
    seen = replace(item, robot=replace(item.robot, shapes=tuple(shapes)))
    item, _ = without_still_joints(seen, scene.reduce, counts_joints(item, scene.items))
    if scene.items.plane is not None and "plane" in scene.reduce and item.base == "free":
        item = on_planar_base(item, axes_of(scene.items.plane))
    return item.robot.model, list(item.robot.shapes)


def _of_robot(item: RobotItem, meshes: dict[Any, Mesh]) -> Iterator[PlacedShape]:
    """Yield the visual shapes of a robot on the bodies of its URDF; meshes that are read are kept for others."""
    robot, model = item.robot, item.robot.model
    if not robot.text:
        return
    root = ElementTree.fromstring(robot.text)
    named = _named_colors(root)
    file = Path(robot.file)
    folders = mesh_folders(file)
    base = pin.SE3(item.rotation, item.position)
    links = root.findall("link")
    names = [link.get("name", "") for link in links]
    owners = [name for name, link in zip(names, links, strict=True) for _ in link.findall("visual")]
    labels = iter(shape_labels(owners, names))
    for link in watched(links, f"meshes of {robot.name}"):
        for visual in link.findall("visual"):
            label = f"{robot.name}/{next(labels)}"
            frame = model.frames[model.getFrameId(link.get("name", ""), pin.FrameType.BODY)]
            pose = frame.placement * _origin(visual)
            if item.base == "fixed" and frame.parentJoint == 0:
                pose = base * pose
            color = _color(visual.find("material"), named)
            try:
                shape = _shape(visual, file, folders, meshes)
            except InputError:
                raise
            except (TypeError, ValueError, AttributeError) as error:
                raise InputError(f"the visual shape of link {link.get('name')} cannot be read") from error
            if isinstance(shape, Mesh) and shape.colors is not None:
                colors = np.where(np.isnan(shape.colors), np.array(color[:3], np.float32), shape.colors)
                shape = replace(shape, colors=colors)
            # a mesh is no shape that anything could touch
            seen: Any = shape
            body = int(frame.parentJoint)
            yield PlacedShape(label, seen, body, pose.rotation.copy(), pose.translation.copy(), color)


def _shape(
    visual: Element, file: Path, folders: list[str], meshes: dict[Any, Mesh]
) -> Box | Cylinder | Sphere | Capsule | Mesh:
    (geometry,) = visual.find("geometry")  # type: ignore[misc]
    if geometry.tag == "mesh":
        name, scale = geometry.get("filename", ""), tuple(_numbers(geometry.get("scale", "1 1 1"), 3))
        path = mesh_path(name, file, folders)
        if path is None:
            raise InputError(f"mesh '{name}' is not found; looked in the folders above {file} and in ROS_PACKAGE_PATH")
        if (path, scale) not in meshes:
            meshes[path, scale] = visual_mesh(path, np.array(scale))
        return meshes[path, scale]
    if geometry.tag == "box":
        return Box(tuple(_numbers(geometry.get("size"), 3)))  # type: ignore[arg-type]
    radius = float(geometry.get("radius"))  # type: ignore[arg-type]
    if geometry.tag == "sphere":
        return Sphere(radius)
    length = float(geometry.get("length"))  # type: ignore[arg-type]
    if geometry.tag == "cylinder":
        return Cylinder(radius, length)
    if geometry.tag == "capsule":
        return Capsule(radius, length)
    raise ValueError(geometry.tag)


def _origin(visual: Element) -> pin.SE3:
    origin = visual.find("origin")
    if origin is None:
        return pin.SE3.Identity()
    xyz, rpy = (np.array(_numbers(origin.get(name, "0 0 0"), 3)) for name in ("xyz", "rpy"))
    return pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz)


def _named_colors(root: Element) -> dict[str, Color]:
    """Return colours by name: those that visuals define, then those of the robot, which go before."""
    found: dict[str, Color] = {}
    for material in (*root.iterfind("link/visual/material"), *root.findall("material")):
        color = material.find("color")
        if color is not None and material.get("name"):
            found[material.get("name", "")] = _rgba(color)
    return found


def _color(material: Element | None, named: dict[str, Color]) -> Color:
    if material is None:
        return _PLAIN
    color = material.find("color")
    return named.get(material.get("name", ""), _PLAIN) if color is None else _rgba(color)


def _rgba(color: Element) -> Color:
    values = [*map(float, color.get("rgba", "").split()), 1.0]
    if len(values) < 4 or not np.isfinite(values).all():
        return _PLAIN
    red, green, blue, opacity = np.clip(values[:4], 0.0, 1.0).tolist()
    return red, green, blue, opacity


def _numbers(text: str | None, count: int) -> list[float]:
    values = [float(x) for x in (text or "").split()]
    if len(values) != count:
        raise ValueError(text)
    return values
