"""Which pairs of a robot's own shapes are not asked, and why."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import coal
import pinocchio as pin

from ..constraints.shapes import Array, PlacedShape
from ..errors import UrdfError
from .reductions import Omission


def pairs_left_out(
    model: pin.Model, shapes: list[PlacedShape], reference: Array, disabled: set[frozenset[str]]
) -> tuple[set[tuple[str, str]], list[Omission]]:
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
    return apart, [Omission(f"pair {a} | {b}", why, pairs=1) for pairs, why in reasons for a, b in pairs]


def disabled_pairs(srdf: str | None, name: str) -> set[frozenset[str]]:
    """Return the pairs of names that an SRDF disables."""
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
