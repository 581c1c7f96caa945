"""Tables of a robot's joints and shapes for `mbvi inspect`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ..geometry.shapes.shapes import PlacedShape
    from ..problem import Problem
    from ..scene.connected.items import CouplingItem


def joint_table(problem: Problem) -> str:
    """Return type, degrees of freedom, limits of each joint, and what it follows; the scene holds one robot."""
    model = problem.system.model
    assert model is not None and problem.scene is not None
    rows, follows = [], {c.first: _follows(c) for c in problem.scene.items.couplings}
    for joint in range(1, model.njoints):
        kind = _joint_type(model.joints[joint])
        limits = "none"
        if model.nqs[joint] == 1:
            unit = "m" if kind == "prismatic" else "rad"
            lower, upper = (float(x[model.idx_qs[joint]]) for x in (model.lowerPositionLimit, model.upperPositionLimit))
            limits = _limits(lower, upper, unit)
        row = model.names[joint], kind, str(model.nvs[joint]), limits
        rows.append((*row, follows.get(f"{problem.system.name}/{row[0]}", "")) if follows else row)
    head = ("name", "type", "dof", "limits", *(["follows"] if follows else []))
    return _table("Joints", head, rows)


def _limits(lower: float, upper: float, unit: str) -> str:
    """Return the limits of a joint in words."""
    # Pinocchio writes "no limit" as the largest float
    least, most = (f"{x:.4g} {unit}" if abs(x) < 1e100 else "" for x in (lower, upper))
    if least and most:
        return f"{lower:.4g} to {most}"
    return f"at least {least}" if least else (f"at most {most}" if most else "none")


def _follows(one: CouplingItem) -> str:
    """Return in words what a joint follows."""
    leader, ratio = one.second.partition("/")[2], "" if one.ratio == 1.0 else f"{one.ratio:g} "
    moving = f"{ratio}{leader}" if leader else ""
    found = " + ".join([*([moving] if moving else []), *([f"{one.offset:g}"] if one.offset or not moving else [])])
    return found if one.active else f"{found}, switched off"


def shape_table(problem: Problem) -> str:
    """Return link, kind, size and moving joint of each shape; the scene holds one robot."""
    model = problem.system.model
    assert problem.scene is not None and model is not None
    rows = []
    for placed in problem.scene.shapes:
        carrier = model.names[placed.body] if placed.body else "fixed"
        rows.append((placed.name.partition("/")[2], type(placed.shape).__name__.lower(), _size(placed), carrier))
    if not rows:
        return "Shapes\n  none: it touches nothing"
    kinds = Counter(row[1] for row in rows)
    title = f"Shapes ({', '.join(f'{n} {kind}' for kind, n in sorted(kinds.items()))})"
    return _table(title, ("link", "kind", "size [m]", "moves with"), rows)


def _table(title: str, head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    widths = [max(map(len, column)) for column in zip(head, *rows, strict=True)]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) for row in (head, *rows)]
    return "\n".join([title, *(f"  {line.rstrip()}" for line in lines)])


def _joint_type(joint: Any) -> str:
    name = joint.shortname().removeprefix("JointModel")
    if name.startswith("R"):
        # a joint without limits stores cosine and sine
        return "revolute" if joint.nq == 1 else "continuous"
    if name.startswith("P") and joint.nv == 1:
        return "prismatic"
    return {"FreeFlyer": "free"}.get(name, name.lower())


def _size(placed: PlacedShape) -> str:
    shape: Any = placed.shape
    if hasattr(shape, "size"):
        return " x ".join(f"{x:.4g}" for x in shape.size)
    if hasattr(shape, "triangles"):
        return f"{len(shape.vertices)} vertices within {shape.bound:.4g}"
    if hasattr(shape, "radii"):
        return "semi-axes " + ", ".join(f"{x:.4g}" for x in shape.radii)
    return f"radius {shape.radius:.4g}" + (f", length {shape.length:.4g}" if hasattr(shape, "length") else "")
