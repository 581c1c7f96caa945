"""Reads a robot from its URDF: checks it, makes its collision shapes convex, and sorts out its own pairs."""

from __future__ import annotations

import os
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin

from ...arguments import LARGEST, listed, watched
from ...errors import InputError, UrdfError
from ...geometry.shapes.shapes import Array, Box, Capsule, Convex, Cylinder, Ellipsoid, Hull, PlacedShape, Sphere
from ..meshes.collada import metres_per_unit
from ..meshes.visual import LARGEST_LENGTH
from ..reductions import Omission
from .checks import (
    check_axes,
    check_inertias,
    check_links,
    check_meshes,
    check_numbers,
    check_shapes,
    mesh_folders,
    read_xml,
)
from .mimic import Mimic, mimics_of
from .planar_joints import turn_planar_joints
from .self_pairs import disabled_pairs, pairs_left_out, shape_labels

# most names in one entry of what is left out
_MOST_NAMED = 8


@dataclass(frozen=True)
class Robot:
    """A mechanism as its file describes it.

    Attributes
    ----------
    name : str
        Name in the scene.
    text : str
        The URDF; empty if a MJCF described it.
    model : pinocchio.Model
        Joints, inertias, limits; the base where the user put it.
    shapes : tuple of PlacedShape
        Convex collision shapes on the joints' frames; body 0 is the base of a fixed robot.
    apart : frozenset of (str, str)
        Pairs of shapes that are left out of contact detection, in the order of `shapes`.
    omitted : tuple of Omission
        What was left out, and why.
    reference : ndarray, shape (nq,)
        Neutral configuration; a joint whose limits leave zero out stands in the middle of them.
    file : str
        The path of the description, from which the meshes to look at are found when a replay is made.
    mimics : tuple of Mimic
        The joints that the URDF lets follow others.
    """

    name: str
    text: str
    model: pin.Model
    shapes: tuple[PlacedShape, ...]
    apart: frozenset[tuple[str, str]]
    omitted: tuple[Omission, ...] = field(repr=False)
    reference: Array = field(repr=False)
    file: str = ""
    mimics: tuple[Mimic, ...] = ()


def robot_name(path: str | os.PathLike[str]) -> str:
    """Return the name that a URDF gives its robot, or else that of the file."""
    file = Path(path)
    _, root = read_xml(file)
    _check_root(root, file)
    return root.get("name") or file.stem


def load_robot(
    path: str | os.PathLike[str], base: str, rotation: Array, position: Array, name: str, srdf: Path | None
) -> Robot:
    """Read a robot.

    Parameters
    ----------
    path : path
        URDF file; `package://` is resolved from the folders above it and ROS_PACKAGE_PATH.
    base : "free" or "fixed"
        Whether the root link floats or is welded to the world.
    rotation, position : ndarray, shapes (3, 3) and (3,)
        Where a fixed base stands [m].
    name : str
        Name in the scene.
    srdf : path, optional
        File whose `disable_collisions` pairs are left out.

    Raises
    ------
    UrdfError
        If a file is missing, is no URDF, or describes no physical mechanism.
    """
    file = Path(path)
    text, root = read_xml(file)
    _check_root(root, file)
    check_numbers(root, file)
    check_axes(root, file)
    check_links(root, file)
    folders = mesh_folders(file)
    check_meshes(root, file, folders)
    model = build_model(text, base, rotation, position, file)
    geometry = _build_geometry(model, text, folders, file)
    check_shapes(root, geometry, file)
    if base == "fixed":
        _move_base(geometry.geometryObjects, rotation, position)
    links = [link.get("name", "") for link in root.findall("link")]
    shapes, omitted = _shapes(geometry, name, links, _colors(root))
    check_inertias(model, file)
    reference, moved = _reference(model)
    mimics, unfollowed = mimics_of(model, root)
    omitted += _unmodelled(root) + unfollowed
    omitted += moved
    labels = {f"{name}/{link}" for link in links}
    apart, dropped = pairs_left_out(model, shapes, reference, disabled_pairs(srdf, name), labels)
    omitted += dropped
    where = str(file.resolve())
    return Robot(name, text, model, tuple(shapes), frozenset(apart), tuple(omitted), reference, where, mimics)


def build_model(
    text: str, base: str, rotation: Array, position: Array, file: Path | str = "URDF", planes: bool = True
) -> pin.Model:
    """Return the Pinocchio model of a URDF text, a fixed base placed in the world.

    `planes` is whether planar joints move across their axes; without, along x and y of their frames.
    """
    lines: list[str] = []
    try:
        with _caught() as lines:
            root = (pin.JointModelFreeFlyer(),) if base == "free" else ()
            model = pin.buildModelFromXML(text, *root)
    except (ValueError, RuntimeError) as error:
        reason = lines[0] if lines else _first_line(error)
        raise UrdfError(f"{file}: Pinocchio cannot build the mechanism: {reason}") from error
    if model.nv == 0:
        raise UrdfError(f"{file}: a fixed base and no moving joint leave nothing to simulate; use base='free'")
    if planes:
        turn_planar_joints(model, text)
    if base == "fixed":
        pose = pin.SE3(np.asarray(rotation, dtype=float), np.asarray(position, dtype=float))
        for joint in range(1, model.njoints):
            if model.parents[joint] == 0:
                model.jointPlacements[joint] = pose * model.jointPlacements[joint]
    return model


def _build_geometry(model: pin.Model, text: str, folders: Sequence[str], file: Path) -> pin.GeometryModel:
    lines: list[str] = []
    try:
        with _caught() as lines:
            return pin.buildGeomFromUrdfString(model, text, pin.GeometryType.COLLISION, package_dirs=folders)
    except (ValueError, RuntimeError) as error:
        reason = lines[0] if lines else _first_line(error)
        raise UrdfError(f"{file}: the collision shapes cannot be read: {reason}") from error


@contextmanager
def _caught() -> Iterator[list[str]]:
    """Catch what the C++ parsers write to stderr; its lines are in the list at the end."""
    lines: list[str] = []
    sys.stderr.flush()
    kept = os.dup(2)
    with tempfile.TemporaryFile() as file:
        os.dup2(file.fileno(), 2)
        try:
            yield lines
        finally:
            os.dup2(kept, 2)
            os.close(kept)
            file.seek(0)
            lines += [x.strip() for x in file.read().decode(errors="replace").splitlines() if x.strip()]


def _check_root(root: ElementTree.Element, file: Path) -> None:
    if root.tag == "sdf":
        raise UrdfError(f"{file} is SDF, for which Pinocchio's wheels have no parser: convert it to URDF or MJCF")
    if root.tag == "mujoco":
        raise UrdfError(f"{file} is a MJCF: use add_mjcf")
    if root.tag != "robot":
        raise UrdfError(f"{file} is no URDF: its root element is <{root.tag}>, not <robot>")
    if root.find("link") is None:
        raise UrdfError(f"{file} is no URDF: it has no <link>")


def _move_base(objects: Sequence[pin.GeometryObject], rotation: Array, position: Array) -> None:
    pose = pin.SE3(np.asarray(rotation, dtype=float), np.asarray(position, dtype=float))
    for item in objects:
        if item.parentJoint == 0:
            item.placement = pose * item.placement


def _shapes(
    geometry: pin.GeometryModel, name: str, names: Sequence[str], colors: dict[str, tuple[float, float, float, float]]
) -> tuple[list[PlacedShape], list[Omission]]:
    """Return the shapes of a robot whose links have the given names, and what was left out or replaced."""
    items = list(geometry.geometryObjects)
    links = [item.name.rsplit("_", 1)[0] for item in items]
    shapes: list[PlacedShape] = []
    omitted: list[Omission] = []
    labelled = [*zip(items, links, shape_labels(links, names), strict=True)]
    for item, link, own in watched(labelled, f"shapes of {name}"):
        label = f"{name}/{own}"
        try:
            shape = convex(item.geometry, metres_per_unit(Path(item.meshPath)))
        except InputError as error:
            omitted.append(Omission(f"shape {label}", str(error)))
            continue
        if shape.bound > LARGEST_LENGTH:
            raise UrdfError(f"shape {label} reaches {shape.bound:.3g} m; shapes may reach {LARGEST_LENGTH:g} m at most")
        if isinstance(shape, Hull):
            omitted.append(Omission(f"mesh {label}", f"replaced by its convex hull of {len(shape.vertices)} vertices"))
        pose = item.placement
        color = colors.get(link, (0.6, 0.65, 0.72, 1.0))
        rotation, position = np.array(pose.rotation), np.array(pose.translation)
        shapes.append(PlacedShape(label, shape, int(item.parentJoint), rotation, position, color))
    return shapes, omitted


def convex(geometry: coal.CollisionGeometry, unit: float = 1.0) -> Convex:
    """Return a Coal geometry as one of the convex shapes; a mesh as its hull, whose unit is given [m].

    Raises
    ------
    InputError
        If it has no volume or is of a kind that is not taken.
    """
    if isinstance(geometry, coal.Sphere):
        return Sphere(float(geometry.radius))
    if isinstance(geometry, coal.Box):
        return Box(tuple(2.0 * float(x) for x in geometry.halfSide))  # type: ignore[arg-type]
    if isinstance(geometry, coal.Cylinder):
        return Cylinder(float(geometry.radius), 2.0 * float(geometry.halfLength))
    if isinstance(geometry, coal.Capsule):
        return Capsule(float(geometry.radius), 2.0 * float(geometry.halfLength))
    if isinstance(geometry, coal.Ellipsoid):
        return Ellipsoid(tuple(float(x) for x in geometry.radii))  # type: ignore[arg-type]
    if isinstance(geometry, coal.BVHModelBase):
        return Hull(unit * geometry.vertices())
    if isinstance(geometry, coal.ConvexBase):
        return Hull(unit * np.array(geometry.points()))
    raise InputError(f"a shape of kind {type(geometry).__name__} is not taken")


def _colors(root: ElementTree.Element) -> dict[str, tuple[float, float, float, float]]:
    """Return the colour of each link's first visual."""
    named = {
        m.get("name"): m.find("color").get("rgba")  # type: ignore[union-attr]
        for m in root.iter("material")
        if m.find("color") is not None
    }
    colors = {}
    for link in root.findall("link"):
        material = link.find("visual/material")
        rgba = named.get(material.get("name")) if material is not None else None
        if rgba:
            values = [float(x) for x in rgba.split()]
            if len(values) == 4:
                colors[link.get("name", "")] = (values[0], values[1], values[2], values[3])
    return colors


def _reference(model: pin.Model) -> tuple[Array, list[Omission]]:
    """Return the neutral configuration clipped to the limits, and the names of the joints that were changed."""
    q = pin.neutral(model)
    moved = []
    for joint in range(1, model.njoints):
        k = model.idx_qs[joint]
        if model.nqs[joint] != 1:
            continue
        lower, upper = model.lowerPositionLimit[k], model.upperPositionLimit[k]
        if lower > upper:
            raise UrdfError(f"joint '{model.names[joint]}': its lower limit {lower:g} is above its upper {upper:g}")
        if lower > LARGEST or upper < -LARGEST:
            raise UrdfError(
                f"joint '{model.names[joint]}': its limits, {lower:g} and {upper:g}, leave no configuration"
            )
        if not lower <= 0.0 <= upper:
            q[k] = 0.5 * (lower + upper)
            why = f"outside its limits; it starts at their middle, {q[k]:.4g}"
            moved.append(Omission(f"zero of joint {model.names[joint]}", why))
    return q, moved


def _unmodelled(root: ElementTree.Element) -> list[Omission]:
    """Return the omitted parts of the URDF: effort and velocity limits, and safety controllers."""
    found = []
    guarded = [j.get("name", "") for j in root.findall("joint") if j.find("safety_controller") is not None]
    if guarded:
        found.append(
            Omission(f"safety controllers of {listed(guarded, _MOST_NAMED)}", "the limits of joints alone hold")
        )
    if root.find("joint/limit") is not None:
        found.append(Omission("effort and velocity limits", "they bound motors; clip in your control"))
    return found


def _first_line(error: Exception) -> str:
    return str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
