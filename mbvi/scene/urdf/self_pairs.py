"""Finds the pairs of a robot's own shapes that are left out of contact detection, with the reasons."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from itertools import count
from math import dist, frexp
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin

from ...geometry.shapes.shapes import Array, PlacedShape
from ..reductions import Omission
from .checks import read_xml

# distance of shapes that touch, in sizes of the smaller
_TOUCHING = 1e-5


def shape_labels(links: Sequence[str], names: Collection[str]) -> list[str]:
    """Return a label for each shape, given its link and the names of all links.

    The only shape of a link has the name of the link; those of others are numbered, without the numbers that would give
    them the name of another link.
    """
    total, numbered = Counter(links), {link: _numbered(link, names) for link in links}
    return [link if total[link] == 1 else next(numbered[link]) for link in links]


def _numbered(link: str, names: Collection[str]) -> Iterator[str]:
    yield from (label for k in count() if (label := f"{link}_{k}") not in names)


def pairs_left_out(
    model: pin.Model, shapes: list[PlacedShape], reference: Array, disabled: set[frozenset[str]], links: Collection[str]
) -> tuple[set[tuple[str, str]], list[Omission]]:
    """Return the pairs of a robot's own shapes that are left out, and the reasons in words.

    `links` are the names of all links, "robot/link"; `disabled` has pairs of them, or of shapes.
    """
    neutral = pin.neutral(model)
    # most robots have all zeros within their limits
    starts = [neutral] if np.array_equal(neutral, reference) else [neutral, reference]
    overlaps = Overlaps(shapes, [poses_of(model, shapes, q) for q in starts])
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
            elif {frozenset(pair), frozenset(_link_of(label, links) for label in pair)} & disabled:
                apart.add(pair)
                srdf.append(pair)
            elif overlaps(i, j):
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


def _link_of(label: str, links: Collection[str]) -> str:
    """Return a shape's link: a link of several shapes has them numbered."""
    return label if label in links else label.rpartition("_")[0]


def poses_of(model: pin.Model, shapes: list[PlacedShape], q: Array) -> list[tuple[Array, Array]]:
    """Return the rotation and the position of each shape in the world at a configuration."""
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    poses = []
    for s in shapes:
        R, origin = data.oMi[s.body].rotation, data.oMi[s.body].translation
        poses.append((R @ s.rotation, R @ s.position + origin))
    return poses


class Overlaps:
    """Whether two shapes overlap in one of some poses; makes each shape's Coal geometry once for each unit."""

    def __init__(self, shapes: list[PlacedShape], poses: list[list[tuple[Array, Array]]]) -> None:
        self._shapes, self._poses = [s.shape for s in shapes], poses
        self._geometry: dict[tuple[int, float], Any] = {}
        self._transforms: dict[tuple[int, int, float], Any] = {}
        self._request, self._result = coal.DistanceRequest(), coal.DistanceResult()

    def __call__(self, i: int, j: int) -> bool:
        """Return whether two shapes, by their numbers, overlap."""
        bounds = self._shapes[i].bound, self._shapes[j].bound
        # Coal's tolerance is absolute
        unit = 2.0 ** frexp(min(bounds))[1]
        for k, pose in enumerate(self._poses):
            if dist(pose[i][1], pose[j][1]) > sum(bounds) + _TOUCHING * unit:
                continue
            sides = self._made(i, k, unit), self._made(j, k, unit)
            self._result.clear()
            if coal.distance(*sides[0], *sides[1], self._request, self._result) <= _TOUCHING:
                return True
        return False

    def _made(self, number: int, k: int, unit: float) -> tuple[Any, Any]:
        """Return a shape in a unit, and its place in one of the poses."""
        key, place = (number, unit), (number, k, unit)
        if key not in self._geometry:
            self._geometry[key] = self._shapes[number].coal(unit)
        if place not in self._transforms:
            rotation, position = self._poses[k][number]
            self._transforms[place] = coal.Transform3s(rotation, position / unit)
        return self._geometry[key], self._transforms[place]
