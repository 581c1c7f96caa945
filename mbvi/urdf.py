"""A robot from its URDF: read, checked, its collision shapes made convex, its own pairs sorted out."""

from __future__ import annotations

import os
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
from scipy.linalg import lapack

from .constraints.shapes import Array, Box, Capsule, Convex, Cylinder, Ellipsoid, Hull, PlacedShape, Sphere
from .errors import InputError, UrdfError

# how far principal moments may miss A + B >= C by, as drawn from rounded numbers
_TRIANGLE = 1e-3


@dataclass(frozen=True)
class Robot:
    """A mechanism as its file describes it.

    Attributes
    ----------
    name : str
        Name in the scene.
    text : str
        The URDF.
    model : pinocchio.Model
        Joints, inertias, limits; the base where the user put it.
    shapes : tuple of PlacedShape
        Convex collision shapes on the joints' frames; body 0 is the base of a fixed robot.
    apart : frozenset of (str, str)
        Pairs of shapes that are not asked, in the order of `shapes`.
    omitted : tuple of (str, str)
        What was left out, and why.
    reference : ndarray, shape (nq,)
        Neutral configuration; a joint whose limits leave zero out stands in the middle of them.
    """

    name: str
    text: str
    model: pin.Model
    shapes: tuple[PlacedShape, ...]
    apart: frozenset[tuple[str, str]]
    omitted: tuple[tuple[str, str], ...] = field(repr=False)
    reference: Array = field(repr=False)


def load_robot(
    path: str | os.PathLike[str], base: str, rotation: Array, position: Array, name: str | None, srdf: str | None
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
    name : str, optional
        Name in the scene; the URDF's own by default.
    srdf : path, optional
        File whose `disable_collisions` pairs are left out.

    Raises
    ------
    UrdfError
        If a file is missing, is no URDF, or describes no physical mechanism.
    """
    file = Path(path)
    if not file.is_file():
        raise UrdfError(f"no such file: {file}")
    text = file.read_text(encoding="utf-8", errors="replace")
    root = _parse(text, file)
    # a slash parts a robot from its link
    name = name or (root.get("name") or file.stem).replace("/", "_")
    _check_links(root, file)
    folders = [str(p) for p in file.resolve().parents] + [
        p for p in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if p
    ]
    _check_meshes(root, file, folders)
    model = build_model(text, base, rotation, position, file)
    geometry = _build_geometry(model, text, folders, file)
    _check_shapes(root, geometry, file)
    if base == "fixed":
        _move_base(geometry.geometryObjects, rotation, position)
    shapes, omitted = _shapes(geometry, name, _colors(root))
    _check_masses(model, geometry, file)
    _check_inertias(model, file)
    reference, moved = _reference(model)
    _check_mass_matrix(model, reference, file)
    omitted += _unmodelled(model, root)
    omitted += moved
    apart, dropped = _pairs_left_out(model, shapes, reference, _disabled(srdf, name))
    return Robot(name, text, model, tuple(shapes), frozenset(apart), tuple(omitted + dropped), reference)


def build_model(text: str, base: str, rotation: Array, position: Array, file: Path | str = "URDF") -> pin.Model:
    """Return the Pinocchio model of a URDF text, a fixed base placed in the world."""
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


def _check_shapes(root: ElementTree.Element, geometry: pin.GeometryModel, file: Path) -> None:
    """Refuse a link that lost a shape: the parser drops what it cannot read without an error."""
    read = Counter(item.name.rsplit("_", 1)[0] for item in geometry.geometryObjects)
    for link in root.findall("link"):
        name, drawn = link.get("name", ""), len(link.findall("collision"))
        if read[name] < drawn:
            raise UrdfError(
                f"{file}: link '{name}' has {drawn} collision shapes, of which {drawn - read[name]} cannot be read; "
                "a URDF knows box, cylinder, sphere and mesh, with positive sizes"
            )


def _parse(text: str, file: Path) -> ElementTree.Element:
    try:
        root = ElementTree.fromstring(text.encode())
    except ElementTree.ParseError as error:
        raise UrdfError(f"{file} is no XML: {error}") from error
    if root.tag != "robot":
        raise UrdfError(f"{file} is no URDF: its root element is <{root.tag}>, not <robot>")
    if root.find("link") is None:
        raise UrdfError(f"{file} is no URDF: it has no <link>")
    return root


def _check_links(root: ElementTree.Element, file: Path) -> None:
    """Refuse an <inertial> that cannot be read."""
    for link in root.findall("link"):
        inertial = link.find("inertial")
        if inertial is None:
            continue
        where = f"{file}: link '{link.get('name')}'"
        try:
            mass = float(inertial.find("mass").get("value"))  # type: ignore[union-attr, arg-type]
            entries = inertial.find("inertia")
            xx, xy, xz, yy, yz, zz = (float(entries.get(f"i{k}")) for k in ("xx", "xy", "xz", "yy", "yz", "zz"))  # type: ignore[union-attr, arg-type]
        except (AttributeError, TypeError, ValueError) as error:
            raise UrdfError(f"{where}: its <inertial> lacks a mass or one of the six inertia entries") from error
        moments = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        if not (np.isfinite(mass) and np.isfinite(moments).all()):
            raise UrdfError(f"{where}: its mass or inertia is not finite")


def _check_inertias(model: pin.Model, file: Path) -> None:
    """Refuse moving bodies that no matter can make, each with all links welded into it."""
    for joint in range(1, model.njoints):
        inertia = model.inertias[joint]
        a, b, c = np.linalg.eigvalsh(inertia.inertia)
        rounding = _TRIANGLE * abs(c) + 1e-12 * abs(inertia.mass)
        if inertia.mass < 0.0 or a < -rounding or a + b < c - rounding:
            raise UrdfError(
                f"{file}: link {_links_on(model, joint)}: unphysical inertia, mass {inertia.mass:g} and principal "
                f"moments {a:g}, {b:g}, {c:g}: none may be negative and the sum of two must reach the third"
            )


def _check_mass_matrix(model: pin.Model, q: Array, file: Path) -> None:
    """Refuse a joint that turns or shifts nothing heavy."""
    mass = pin.crba(model, model.createData(), q)
    factor, minor = lapack.dpotrf(mass, 0, 0)
    # a pivot that is rounding beside its diagonal is a zero one
    weak = np.flatnonzero(factor.diagonal() ** 2 < 1e-13 * mass.diagonal())
    minor = minor or (int(weak[0]) + 1 if weak.size else 0)
    if minor:
        joint = next(
            j for j in range(1, model.njoints) if model.idx_vs[j] <= minor - 1 < model.idx_vs[j] + model.nvs[j]
        )
        raise UrdfError(
            f"{file}: the mass matrix is singular at joint '{model.names[joint]}': link {_links_on(model, joint)} and "
            "what hangs on it have no inertia along it; give them an <inertial> or fix the joint"
        )


def _links_on(model: pin.Model, joint: int) -> str:
    names = [f.name for f in model.frames if f.parentJoint == joint and f.type == pin.FrameType.BODY]
    return " + ".join(f"'{n}'" for n in names) or "?"


def _check_meshes(root: ElementTree.Element, file: Path, folders: Sequence[str]) -> None:
    for mesh in root.findall("link/collision/geometry/mesh"):
        name = mesh.get("filename", "")
        tail = name.split("://", 1)[-1]
        candidates = [Path(tail), file.parent / tail] if "package://" not in name else []
        candidates += [Path(folder) / tail.lstrip("/") for folder in folders]
        if not any(c.is_file() for c in candidates):
            raise UrdfError(
                f"{file}: mesh '{name}' is not found; looked in the folders above the file and in ROS_PACKAGE_PATH"
            )


def _check_masses(model: pin.Model, geometry: pin.GeometryModel, file: Path) -> None:
    """Refuse a moving body without inertia: one that carries a shape, or that nothing heavy hangs on."""
    shaped = {int(g.parentJoint) for g in geometry.geometryObjects}
    for joint in range(1, model.njoints):
        hanging = sum(model.inertias[k].mass for k in model.subtrees[joint])
        if model.inertias[joint].mass > 0.0 or (hanging > 0.0 and joint not in shaped):
            continue
        raise UrdfError(
            f"{file}: link {_links_on(model, joint)} moves with joint '{model.names[joint]}' but has no mass; "
            "give it an <inertial>"
        )


def _move_base(objects: Sequence[pin.GeometryObject], rotation: Array, position: Array) -> None:
    pose = pin.SE3(np.asarray(rotation, dtype=float), np.asarray(position, dtype=float))
    for item in objects:
        if item.parentJoint == 0:
            item.placement = pose * item.placement


def _shapes(
    geometry: pin.GeometryModel, name: str, colors: dict[str, tuple[float, float, float, float]]
) -> tuple[list[PlacedShape], list[tuple[str, str]]]:
    items = list(geometry.geometryObjects)
    links = [item.name.rsplit("_", 1)[0] for item in items]
    shapes: list[PlacedShape] = []
    omitted: list[tuple[str, str]] = []
    for item, link in zip(items, links, strict=True):
        # a link's only shape goes by the link's name
        label = f"{name}/{link if links.count(link) == 1 else item.name}"
        try:
            shape = convex(item.geometry)
        except InputError as error:
            omitted.append((f"shape {label}", str(error)))
            continue
        if isinstance(shape, Hull):
            omitted.append((f"mesh {label}", f"replaced by its convex hull of {len(shape.vertices)} vertices"))
        pose = item.placement
        color = colors.get(link, (0.6, 0.65, 0.72, 1.0))
        rotation, position = np.array(pose.rotation), np.array(pose.translation)
        shapes.append(PlacedShape(label, shape, int(item.parentJoint), rotation, position, color))
    return shapes, omitted


def convex(geometry: coal.CollisionGeometry) -> Convex:
    """Return a Coal geometry as one of the convex shapes; a mesh as its hull.

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
        return Hull(geometry.vertices())
    if isinstance(geometry, coal.ConvexBase):
        return Hull(np.array(geometry.points()))
    raise InputError(f"a shape of kind {type(geometry).__name__} is not taken")


def _colors(root: ElementTree.Element) -> dict[str, tuple[float, float, float, float]]:
    """Return each link's colour as its first visual names it."""
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


def _reference(model: pin.Model) -> tuple[Array, list[tuple[str, str]]]:
    """Return the neutral configuration moved inside the limits, and which joints were moved."""
    q = pin.neutral(model)
    moved = []
    for joint in range(1, model.njoints):
        k = model.idx_qs[joint]
        if model.nqs[joint] != 1:
            continue
        lower, upper = model.lowerPositionLimit[k], model.upperPositionLimit[k]
        if lower > upper:
            raise UrdfError(f"joint '{model.names[joint]}': its lower limit {lower:g} is above its upper {upper:g}")
        if not lower <= 0.0 <= upper:
            q[k] = 0.5 * (lower + upper)
            moved.append(
                (f"zero of joint {model.names[joint]}", f"outside its limits; it starts at their middle, {q[k]:.4g}")
            )
    return q, moved


def _unmodelled(model: pin.Model, root: ElementTree.Element) -> list[tuple[str, str]]:
    """Return what the URDF says and the model does not: dry friction, effort and velocity limits, mimic joints."""
    found = []
    names = [model.names[j] for j in range(1, model.njoints) if model.nvs[j]]
    dry = [
        n
        for n, j in zip(names, [j for j in range(1, model.njoints) if model.nvs[j]], strict=True)
        if model.upperDryFrictionLimit[model.idx_vs[j]] > 0.0
    ]
    if dry:
        found.append((f"dry friction of {', '.join(dry)}", "constraints are perfect: no friction is modelled"))
    if root.find("joint/limit") is not None:
        found.append(("effort and velocity limits", "they bound motors; clip in your control"))
    for joint in root.findall("joint"):
        if joint.find("mimic") is not None:
            found.append((f"mimic of joint {joint.get('name')}", "the joint moves on its own"))
    return found


def _disabled(srdf: str | None, name: str) -> set[frozenset[str]]:
    if srdf is None:
        return set()
    file = Path(srdf)
    if not file.is_file():
        raise UrdfError(f"no such file: {file}")
    try:
        root = ElementTree.fromstring(file.read_bytes())
    except ElementTree.ParseError as error:
        raise UrdfError(f"{file} is no XML: {error}") from error
    return {
        frozenset((f"{name}/{p.get('link1')}", f"{name}/{p.get('link2')}")) for p in root.iter("disable_collisions")
    }


def _link_of(label: str) -> str:
    """Return a shape's link: a link of several shapes has them numbered."""
    head, _, tail = label.rpartition("_")
    return head if tail.isdigit() else label


def _pairs_left_out(
    model: pin.Model, shapes: list[PlacedShape], reference: Array, disabled: set[frozenset[str]]
) -> tuple[set[tuple[str, str]], list[tuple[str, str]]]:
    """Return the pairs of a robot's own shapes that are not asked, and in words why."""
    poses = [_poses(model, shapes, q) for q in (pin.neutral(model), reference)]
    geometry = [s.shape.coal() for s in shapes]
    apart: set[tuple[str, str]] = set()
    adjacent, overlapping, srdf = [], [], []
    for i, a in enumerate(shapes):
        for j in range(i + 1, len(shapes)):
            b, pair = shapes[j], (a.name, shapes[j].name)
            if a.body == b.body:
                apart.add(pair)
            elif a.body in (model.parents[b.body],) or b.body in (model.parents[a.body],):
                apart.add(pair)
                adjacent.append(pair)
            elif {frozenset(pair), frozenset(map(_link_of, pair))} & disabled:
                apart.add(pair)
                srdf.append(pair)
            elif any(_overlap(geometry[i], pose[i], geometry[j], pose[j]) for pose in poses):
                apart.add(pair)
                overlapping.append(pair)
    reasons = (
        (adjacent, "adjacent links"),
        (overlapping, "overlap at the neutral configuration"),
        (srdf, "disabled by the SRDF"),
    )
    return apart, [(f"pair {a} | {b}", reason) for pairs, reason in reasons for a, b in pairs]


def _poses(model: pin.Model, shapes: list[PlacedShape], q: Array) -> list[coal.Transform3s]:
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    poses = []
    for s in shapes:
        R, origin = data.oMi[s.body].rotation, data.oMi[s.body].translation
        poses.append(coal.Transform3s(R @ s.rotation, R @ s.position + origin))
    return poses


def _overlap(
    a: coal.CollisionGeometry, pose_a: coal.Transform3s, b: coal.CollisionGeometry, pose_b: coal.Transform3s
) -> bool:
    distance = coal.distance(a, pose_a, b, pose_b, coal.DistanceRequest(), coal.DistanceResult())
    return bool(distance <= 1e-6)


def _first_line(error: Exception) -> str:
    return str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
