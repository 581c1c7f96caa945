"""Checks of URDF files beyond those of the parsers: invalid numbers, lengths, inertias and masses raise an error."""

from __future__ import annotations

import os
import re
import xml.etree.ElementTree as ElementTree
from collections import Counter
from collections.abc import Collection, Sequence
from pathlib import Path

import numpy as np
import pinocchio as pin
from scipy.linalg import lapack

from ...arguments import LARGEST, SMALLEST, Array, not_found, shown
from ...errors import InputError, MjcfError, UrdfError

# largest relative violation of A + B >= C by principal moments, because URDFs hold rounded numbers
_TRIANGLE = 1e-3
# configurations at which a mass matrix that is singular at one is looked at again
_OTHERS = 3


# which attributes are numbers and how many each; of lengths of shapes, all must be positive
_NUMBERS = {
    "origin": {"xyz": 3, "rpy": 3},
    "axis": {"xyz": 3},
    "mass": {"value": 1},
    "inertia": dict.fromkeys(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), 1),
    "box": {"size": 3},
    "sphere": {"radius": 1},
    "cylinder": {"radius": 1, "length": 1},
    "capsule": {"radius": 1, "length": 1},
    "mesh": {"scale": 3},
    "limit": {"lower": 1, "upper": 1, "effort": 1, "velocity": 1},
    "dynamics": {"damping": 1, "friction": 1},
    "mimic": {"multiplier": 1, "offset": 1},
    "color": {"rgba": 4},
}
_LENGTHS = ("box", "sphere", "cylinder", "capsule")
# declared in the first bytes of a file
_ENCODING = re.compile(rb"""<\?xml[^>]*?encoding\s*=\s*["']([A-Za-z0-9._-]+)["']""")


def read_xml(file: Path, refused: type[UrdfError | MjcfError] = UrdfError) -> tuple[str, ElementTree.Element]:
    """Return the text of an XML file and its root element.

    Raises
    ------
    UrdfError or MjcfError
        That of the argument `refused`: if there is no such file, it cannot be read, or it is no XML.
    """
    if not os.path.isfile(file):
        kind = "a URDF" if refused is UrdfError else "an MJCF"
        raise refused(f"{file} is a folder, not {kind}" if os.path.isdir(file) else not_found(file))
    try:
        data = file.read_bytes()
        declared = _ENCODING.match(data.lstrip()[:200])
        if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
            text = data.decode("utf-16")
        else:
            text = data.decode(declared[1].decode() if declared else "utf-8-sig")
    except OSError as error:
        raise refused(f"{file} cannot be read: {error.strerror or error}") from error
    except (UnicodeError, LookupError) as error:
        raise refused(f"{file} is no text in the encoding that it declares, UTF-8 if none: {error}") from error
    try:
        return text, ElementTree.fromstring(data)
    # for unknown encodings the parser raises other errors
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise refused(f"{file} is no XML: {error}") from error


def check_numbers(root: ElementTree.Element, file: Path) -> None:
    """Refuse texts that are no finite number, and lengths of shapes that are not positive."""
    for element in root.iter():
        for attribute, count in _NUMBERS.get(element.tag, {}).items():
            given = element.get(attribute)
            if given is None:
                continue
            where = f"{file}: <{element.tag} {attribute}={shown(given)}>"
            try:
                numbers = [float(x) for x in given.split()]
            except ValueError as error:
                raise UrdfError(f"{where}: not {'a number' if count == 1 else 'numbers'}") from error
            if len(numbers) != count:
                raise UrdfError(f"{where}: {count} number{'s' * (count > 1)} expected, {len(numbers)} found")
            # Pinocchio writes "no limit" as the largest float, and so do some files
            largest = np.finfo(float).max if element.tag == "limit" else LARGEST
            if not all(abs(x) <= largest for x in numbers):
                raise UrdfError(f"{where}: not finite, or larger than {largest:g}")
            if element.tag in _LENGTHS and min(numbers) < SMALLEST:
                raise UrdfError(f"{where}: lengths of shapes must be positive")
            if element.tag in ("mass", "inertia", "mesh") and any(0.0 < abs(x) < SMALLEST for x in numbers):
                raise UrdfError(f"{where}: smaller than {SMALLEST:g}")


def check_axes(root: ElementTree.Element, file: Path) -> None:
    """Refuse a moving joint whose axis is zero; a fixed one may say so."""
    for joint in root.findall("joint"):
        axis = joint.find("axis")
        if axis is None or joint.get("type") not in ("revolute", "continuous", "prismatic", "planar"):
            continue
        if max(abs(float(x)) for x in axis.get("xyz", "1 0 0").split()) < SMALLEST:
            raise UrdfError(f"{file}: joint '{joint.get('name')}': its axis must not be zero")


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


def check_mass_matrix(model: pin.Model, q: Array, locked: Sequence[str], file: Path) -> None:
    """Refuse a robot whose mass matrix is singular at its initial configuration, its locked joints left out.

    Raises
    ------
    UrdfError
        If it is singular everywhere: a joint turns or shifts nothing heavy.
    InputError
        If it is singular at that configuration only, as where two axes of a gimbal without mass are parallel.
    """
    kept = [j for j in range(1, model.njoints) if model.names[j] not in locked]
    columns = np.concatenate([np.arange(model.idx_vs[j], model.idx_vs[j] + model.nvs[j]) for j in kept])
    weak = _weak_column(model, q, columns)
    if weak is None:
        return
    joint = next(j for j in kept if model.idx_vs[j] <= weak < model.idx_vs[j] + model.nvs[j])
    rng = np.random.default_rng(0)
    others = (pin.integrate(model, q, rng.uniform(-1.0, 1.0, model.nv)) for _ in range(_OTHERS))
    if any(_weak_column(model, other, columns) is None for other in others):
        raise InputError(
            f"{file}: the mass matrix is singular at the initial configuration, at joint '{model.names[joint]}', and "
            "nearly everywhere else it is not: give other initial positions by joints={...}"
        )
    raise UrdfError(
        f"{file}: the mass matrix is singular at joint '{model.names[joint]}': link {_links_on(model, joint)} and "
        "what hangs on it have no inertia along it that no other joint moves; give them an <inertial> or fix the joint"
    )


def _weak_column(model: pin.Model, q: Array, columns: Array) -> int | None:
    """Return the velocity at which the Cholesky factorisation of the mass matrix fails, None if it does not."""
    mass = pin.crba(model, model.createData(), q)[np.ix_(columns, columns)]
    factor, minor = lapack.dpotrf(mass, 0, 0)
    # a pivot that is rounding beside its diagonal is a zero one
    weak = np.flatnonzero(~(factor.diagonal() ** 2 >= 1e-13 * mass.diagonal()))
    minor = minor or (int(weak[0]) + 1 if weak.size else 0)
    return int(columns[minor - 1]) if minor else None


def _links_on(model: pin.Model, joint: int) -> str:
    names = [f.name for f in model.frames if f.parentJoint == joint and f.type == pin.FrameType.BODY]
    return " + ".join(f"'{n}'" for n in names) or "?"


def check_meshes(root: ElementTree.Element, file: Path, folders: Sequence[str]) -> None:
    """Refuse a mesh file that is not there."""
    for mesh in root.findall("link/collision/geometry/mesh"):
        name = mesh.get("filename", "")
        if mesh_path(name, file, folders) is None:
            raise UrdfError(
                f"{file}: mesh '{name}' is not found; looked in the folders above the file and in ROS_PACKAGE_PATH"
            )


def mesh_folders(file: Path) -> list[str]:
    """Return where `package://` of a URDF is looked for: in the folders above it, then in ROS_PACKAGE_PATH."""
    ros = os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep)
    return [str(p) for p in file.resolve().parents] + [p for p in ros if p]


def mesh_path(name: str, file: Path, folders: Sequence[str]) -> Path | None:
    """Return where the mesh is that a URDF names, None if nowhere."""
    tail = name.split("://", 1)[-1]
    candidates = [Path(tail), file.parent / tail] if "package://" not in name else []
    candidates += [Path(folder) / tail.lstrip("/") for folder in folders]
    return next((c for c in candidates if c.is_file()), None)


def check_masses(model: pin.Model, shaped: Collection[int], locked: Collection[str], file: Path) -> None:
    """Refuse a moving body without inertia: one that carries a shape, or that nothing heavy hangs on.

    `shaped` has the joints whose links carry shapes. A link behind a locked joint is part of the link before.
    """
    mass = np.array([inertia.mass for inertia in model.inertias])
    part_of = list(range(model.njoints))
    for joint in range(1, model.njoints):
        if model.names[joint] in locked:
            part_of[joint] = part_of[model.parents[joint]]
    own, carriers = np.bincount(part_of, mass), {part_of[joint] for joint in shaped}

    def lacks_mass(joint: int) -> bool:
        hanging = mass[list(model.subtrees[joint])].sum()
        return part_of[joint] == joint and own[joint] <= 0.0 and (hanging <= 0.0 or joint in carriers)

    found = [joint for joint in range(1, model.njoints) if lacks_mass(joint)]
    if found:
        raise UrdfError(
            f"{file}: link {_links_on(model, found[0])} moves with joint '{model.names[found[0]]}' but has no mass; "
            f"give it an <inertial>, or make it part of the link before by locked={[model.names[j] for j in found]}"
        )
