"""What Pinocchio and the URDF parser take without a word, and no simulation should: each is refused by name."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin
from scipy.linalg import lapack

from ..errors import UrdfError

Array = np.ndarray

# how far principal moments may miss A + B >= C by, as drawn from rounded numbers
_TRIANGLE = 1e-3


def check_shapes(root: ElementTree.Element, geometry: pin.GeometryModel, file: Path) -> None:
    """Refuse a link that lost a shape: the parser drops what it cannot read without an error."""
    read = Counter(item.name.rsplit("_", 1)[0] for item in geometry.geometryObjects)
    for link in root.findall("link"):
        name, drawn = link.get("name", ""), len(link.findall("collision"))
        if read[name] < drawn:
            raise UrdfError(
                f"{file}: link '{name}' has {drawn} collision shapes, of which {drawn - read[name]} cannot be read; "
                "a URDF knows box, cylinder, sphere and mesh, with positive sizes"
            )


def check_links(root: ElementTree.Element, file: Path) -> None:
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


def check_inertias(model: pin.Model, file: Path) -> None:
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


def check_mass_matrix(model: pin.Model, q: Array, file: Path) -> None:
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


def check_meshes(root: ElementTree.Element, file: Path, folders: Sequence[str]) -> None:
    """Refuse a mesh file that is not there."""
    for mesh in root.findall("link/collision/geometry/mesh"):
        name = mesh.get("filename", "")
        tail = name.split("://", 1)[-1]
        candidates = [Path(tail), file.parent / tail] if "package://" not in name else []
        candidates += [Path(folder) / tail.lstrip("/") for folder in folders]
        if not any(c.is_file() for c in candidates):
            raise UrdfError(
                f"{file}: mesh '{name}' is not found; looked in the folders above the file and in ROS_PACKAGE_PATH"
            )


def check_masses(model: pin.Model, geometry: pin.GeometryModel, file: Path) -> None:
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
