"""Geoms of a MJCF: convex shapes, walls, and which pairs of them touch and with which friction."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from ...arguments import made_label
from ...errors import InputError, MjcfError
from ...geometry.meshes.height_field import height_field
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
from ..items import SurfaceItem
from ..meshes.visual import LARGEST_LENGTH
from ..reductions import Omission
from ..urdf.self_pairs import Overlaps, poses_of, shape_labels
from .file import disabled, placement

_PLANE, _HEIGHTS, _SPHERE, _CAPSULE, _ELLIPSOID, _CYLINDER, _BOX, _MESH = range(8)
_KINDS = ("plane", "height field", "sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh", "distance field")
# mu, and the lengths of torsional and of rolling friction [m]
Coefficients = tuple[float, float, float]


class Geoms:
    """The geoms of an MjModel that can touch something.

    Parameters
    ----------
    m : mujoco.MjModel
        The compiled file.
    joint, place
        Of each body the joint that carries it, and its frame's pose there.
    names : sequence of str
        Of each body.
    name : str
        Of the robot in the scene.
    taken : collection of str
        Names that walls and static shapes must not have.

    Attributes
    ----------
    shapes : list of PlacedShape
        Those of the robot.
    statics, walls, fields : dict of str to PlacedShape, HalfSpace, or SurfaceItem
        Those of the world that carry nothing; planes and height fields of all static bodies.
    omitted : list of Omission
        What was left out or replaced.
    ignored : list of str
        Geoms that touch something in MuJoCo and nothing here.
    """

    def __init__(
        self,
        m: Any,
        joint: Sequence[int],
        place: Sequence[pin.SE3],
        names: Sequence[str],
        name: str,
        taken: Collection[str],
    ) -> None:
        self._m, self._joint, self._names, self._taken = m, joint, names, taken
        self._name = name
        self._filters_parents = not disabled(m, "FILTERPARENT")
        self._excluded = set(m.exclude_signature.tolist())
        self.shapes: list[PlacedShape] = []
        self.statics: dict[str, PlacedShape] = {}
        self.walls: dict[str, HalfSpace] = {}
        self.fields: dict[str, SurfaceItem] = {}
        self.omitted: list[Omission] = []
        self.ignored: list[str] = []
        # geoms by their labels, in the order in which the scene holds their shapes
        self._geom: dict[str, int] = {}
        paired = {*m.pair_geom1.tolist(), *m.pair_geom2.tolist()}
        seen = [g for g in range(m.ngeom) if m.geom_contype[g] == m.geom_conaffinity[g] == 0 and g not in paired]
        why = "contype and conaffinity are 0"
        if disabled(m, "CONTACT", "CONSTRAINT"):
            seen, why = list(range(m.ngeom)), "a flag of the file disables contacts"
        if seen:
            self.omitted.append(Omission(f"{len(seen)} geoms without contact", why))
        carriers = self._carriers()
        for g in range(m.ngeom):
            if g in seen:
                continue
            body = int(m.geom_bodyid[g])
            wall = m.geom_type[g] in (_PLANE, _HEIGHTS) and joint[body] == 0
            of_robot = body in carriers and not wall
            label = self._label(g, body, f"{name}/" if of_robot else "", seen)
            pose = place[body] * placement(m.geom_pos[g], m.geom_quat[g])
            if wall and m.geom_type[g] == _HEIGHTS:
                self.fields[label] = self._field(g, label, pose)
                self._geom[label] = g
                continue
            if wall:
                normal = pose.rotation[:, 2]
                self.walls[label] = HalfSpace(tuple(normal.tolist()), float(normal @ pose.translation))
                self._geom[label] = g
                continue
            shape = self._shape(g, label)
            if shape is None:
                continue
            turn, shift = pose.rotation.copy(), pose.translation.copy()
            placed = PlacedShape(label, shape, joint[body], turn, shift, self._color(g))
            if of_robot:
                self.shapes.append(placed)
            else:
                self.statics[label] = placed
            self._geom[label] = g

    def _field(self, g: int, label: str, pose: pin.SE3) -> SurfaceItem:
        """Return a height field; MuJoCo holds its heights in [0, 1], row after row along x from the least y."""
        m, k = self._m, int(self._m.geom_dataid[g])
        rows, columns, first = int(m.hfield_nrow[k]), int(m.hfield_ncol[k]), int(m.hfield_adr[k])
        along_x, along_y, top, _ = m.hfield_size[k].tolist()
        heights = top * np.array(m.hfield_data[first : first + rows * columns], dtype=float).reshape(rows, columns)
        size = 2.0 * along_x, 2.0 * along_y
        self.omitted.append(Omission(f"base and sides of {label}", "the surface alone bears"))
        surface, turn, place = height_field(heights, size), pose.rotation.copy(), pose.translation.copy()
        return SurfaceItem(label, surface, place, turn, None, heights, size)

    def _carriers(self) -> set[int]:
        """Return the bodies that move, and the static ones that something moves on; not the world."""
        parents, found = self._m.body_parentid, set()
        for body in range(1, self._m.nbody):
            if self._joint[body]:
                while body and body not in found:
                    found.add(body)
                    body = int(parents[body])
        return found

    def _label(self, g: int, body: int, prefix: str, seen: Sequence[int]) -> str:
        m = self._m
        first, count = int(m.body_geomadr[body]), int(m.body_geomnum[body])
        beside = [k for k in range(first, first + count) if k not in seen]
        own = shape_labels([self._names[body]] * len(beside), self._names)
        label = prefix + own[beside.index(g)]
        if not prefix:
            label = made_label(m.geom(g).name or (label if body else _KINDS[m.geom_type[g]]))
        default, number = label, 1
        while label in self._geom or (not prefix and label in self._taken):
            number += 1
            label = f"{default}_{number}"
        return label

    def _shape(self, g: int, label: str) -> Convex | None:
        m = self._m
        kind = int(m.geom_type[g])
        a, b, c = m.geom_size[g].tolist()
        if kind == _MESH:
            mesh = int(m.geom_dataid[g])
            first, count = int(m.mesh_vertadr[mesh]), int(m.mesh_vertnum[mesh])
            try:
                hull = Hull(np.array(m.mesh_vert[first : first + count], dtype=float))
            except InputError as error:
                self.omitted.append(Omission(f"shape {label}", str(error)))
                self.ignored.append(f"shape {label}")
                return None
            why = f"replaced by its convex hull of {len(hull.vertices)} vertices"
            self.omitted.append(Omission(f"mesh {label}", why))
            shape: Convex = hull
        elif kind == _SPHERE:
            shape = Sphere(a)
        elif kind == _CAPSULE:
            shape = Capsule(a, 2.0 * b)
        elif kind == _ELLIPSOID:
            shape = Ellipsoid((a, b, c))
        elif kind == _CYLINDER:
            shape = Cylinder(a, 2.0 * b)
        elif kind == _BOX:
            shape = Box((2.0 * a, 2.0 * b, 2.0 * c))
        else:
            what = _KINDS[kind] + (" on a body that moves" if kind in (_PLANE, _HEIGHTS) else "")
            self.omitted.append(Omission(f"shape {label}", f"a {what} is not taken"))
            self.ignored.append(f"shape {label}, a {what}")
            return None
        if shape.bound > LARGEST_LENGTH:
            raise MjcfError(f"shape {label} reaches {shape.bound:.3g} m; shapes may reach {LARGEST_LENGTH:g} m at most")
        return shape

    def _color(self, g: int) -> tuple[float, float, float, float]:
        m = self._m
        rgba = m.geom_rgba[g] if m.geom_matid[g] < 0 else m.mat_rgba[m.geom_matid[g]]
        red, green, blue, opacity = np.clip(rgba, 0.0, 1.0).tolist()
        return red, green, blue, opacity

    def pairs_left_out(self, model: pin.Model, reference: Array) -> tuple[set[tuple[str, str]], list[Omission]]:
        """Return the pairs of labels that never touch, in the order of the scene's shapes, and the reasons.

        Shapes of one mechanism that overlap where the file puts them are made to. Those of two, such as boxes that lie
        on each other, are not: they touch, and the scene checks where they start.
        """
        apart: set[tuple[str, str]] = set()
        omitted = []
        for a, b, g, h in self._pairs():
            why = self._reason(g, h)
            if why:
                apart.add((a, b))
                if why != "same body":
                    omitted.append(Omission(f"pair {a} | {b}", why, pairs=1))
        overlaps = Overlaps(self.shapes, [poses_of(model, self.shapes, reference)])
        for i, first in enumerate(self.shapes):
            for j in range(i + 1, len(self.shapes)):
                pair = first.name, self.shapes[j].name
                if pair not in apart and self._root(pair[0]) == self._root(pair[1]) and overlaps(i, j):
                    apart.add(pair)
                    omitted.append(Omission(f"pair {pair[0]} | {pair[1]}", "overlap at the file's configuration", 0, 1))
        return apart, omitted

    def friction(self, rolling: bool) -> dict[frozenset[str], Coefficients]:
        """Return mu and the lengths of torsional and rolling friction of pairs that touch; 0 unless `rolling`."""
        found = {frozenset((a, b)): self._friction(g, h) for a, b, g, h in self._pairs() if not self._reason(g, h)}
        if not rolling:
            found = {pair: (mu, 0.0, 0.0) for pair, (mu, *_) in found.items()}
        if len(set(found.values())) > 1 or not found:
            return found
        # said once for all pairs
        mu = next(iter(found.values()))
        return {frozenset((self._name, other)): mu for other in (self._name, *self.statics, *self.walls, *self.fields)}

    def _pairs(self) -> Iterator[tuple[str, str, int, int]]:
        """Yield pairs of labels and their geoms: of shapes, then of walls and shapes."""
        shapes = [*(s.name for s in self.shapes), *self.statics]
        for k, a in enumerate(shapes):
            for b in shapes[k + 1 :]:
                if a not in self.statics:
                    yield a, b, self._geom[a], self._geom[b]
        for wall in (*self.walls, *self.fields):
            for s in self.shapes:
                yield wall, s.name, self._geom[wall], self._geom[s.name]

    def _reason(self, g: int, h: int) -> str:
        """Return why MuJoCo lets two geoms pass through each other; empty if it does not."""
        m = self._m
        first, second = sorted((int(m.geom_bodyid[g]), int(m.geom_bodyid[h])))
        weld, other = int(m.body_weldid[first]), int(m.body_weldid[second])
        if weld == other:
            return "same body"
        if self._explicit(g, h) is not None:
            return ""
        if (first << 16) + second in self._excluded:
            return "excluded in the file"
        above, beyond = (int(m.body_weldid[m.body_parentid[w]]) for w in (weld, other))
        if self._filters_parents and weld and other and (weld == beyond or other == above):
            return "adjacent links"
        if not (m.geom_contype[g] & m.geom_conaffinity[h] or m.geom_contype[h] & m.geom_conaffinity[g]):
            return "contype and conaffinity do not meet"
        return ""

    def _root(self, label: str) -> int:
        """Return the body of the world that carries all of a shape's mechanism."""
        return int(self._m.body_rootid[self._m.geom_bodyid[self._geom[label]]])

    def _explicit(self, g: int, h: int) -> int | None:
        """Return the number of the <pair> of two geoms."""
        m = self._m
        for k in range(m.npair):
            if {int(m.pair_geom1[k]), int(m.pair_geom2[k])} == {g, h}:
                return k
        return None

    def _friction(self, g: int, h: int) -> Coefficients:
        """Return MuJoCo's friction of two geoms: that of the one of higher priority, else the greater numbers."""
        m = self._m
        k = self._explicit(g, h)
        if k is not None:
            dimensions, numbers = int(m.pair_dim[k]), m.pair_friction[k, [0, 2, 3]]
        else:
            if m.geom_priority[g] != m.geom_priority[h]:
                g = h = g if m.geom_priority[g] > m.geom_priority[h] else h
            dimensions = max(int(m.geom_condim[g]), int(m.geom_condim[h]))
            numbers = np.maximum(m.geom_friction[g], m.geom_friction[h])
        if dimensions == 1 or numbers[0] == 0.0:
            return 0.0, 0.0, 0.0
        return float(numbers[0]), float(numbers[1]) * (dimensions > 3), float(numbers[2]) * (dimensions > 4)
