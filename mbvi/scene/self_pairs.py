"""Finds the pairs of a robot's own shapes that are left out of contact detection, with the reasons."""

from __future__ import annotations

from pathlib import Path

import coal
import pinocchio as pin

from ..geometry.shapes import Array, Convex, PlacedShape, length_unit
from .reductions import Omission
from .urdf_checks import read_xml

# distance of shapes that touch, in sizes of the smaller
_TOUCHING = 1e-5


def pairs_left_out(
    model: pin.Model, shapes: list[PlacedShape], reference: Array, disabled: set[frozenset[str]]
) -> tuple[set[tuple[str, str]], list[Omission]]:
    """Return the pairs of a robot's own shapes that are left out, and the reasons in words."""
    poses = [_poses(model, shapes, q) for q in (pin.neutral(model), reference)]
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
            elif any(_overlap(a.shape, pose[i], b.shape, pose[j]) for pose in poses):
                apart.add(pair)
                overlapping.append(pair)
    reasons = (
        (adjacent, "adjacent links"),
        (overlapping, "overlap at the neutral configuration"),
        (srdf, "disabled by the SRDF"),
    )
    return apart, [Omission(f"pair {a} | {b}", why, pairs=1) for pairs, why in reasons for a, b in pairs]


def disabled_pairs(file: Path | None, name: str) -> set[frozenset[str]]:
    """Return the pairs of names that an SRDF disables."""
    if file is None:
        return set()
    _, root = read_xml(file)
    return {
        frozenset((f"{name}/{p.get('link1')}", f"{name}/{p.get('link2')}")) for p in root.iter("disable_collisions")
    }


def _link_of(label: str) -> str:
    """Return a shape's link: a link of several shapes has them numbered."""
    head, _, tail = label.rpartition("_")
    return head if tail.isdigit() else label


def _poses(model: pin.Model, shapes: list[PlacedShape], q: Array) -> list[tuple[Array, Array]]:
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    poses = []
    for s in shapes:
        R, origin = data.oMi[s.body].rotation, data.oMi[s.body].translation
        poses.append((R @ s.rotation, R @ s.position + origin))
    return poses


def _overlap(a: Convex, pose_a: tuple[Array, Array], b: Convex, pose_b: tuple[Array, Array]) -> bool:
    # Coal's tolerance is absolute
    unit = length_unit([min(a.bound, b.bound)])
    sides = ((shape.coal(unit), coal.Transform3s(R, p / unit)) for shape, (R, p) in ((a, pose_a), (b, pose_b)))
    first, second = sides
    distance = coal.distance(*first, *second, coal.DistanceRequest(), coal.DistanceResult())
    return bool(distance <= _TOUCHING)
