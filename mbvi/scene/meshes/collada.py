"""The triangles of a COLLADA file and their colours, which Coal's loader leaves out."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterator
from pathlib import Path

import numpy as np

Array = np.ndarray
Element = ElementTree.Element

# colour of parts without a colour in a file that colours other parts
_NONE = (np.nan, np.nan, np.nan)


def collada_mesh(path: Path) -> tuple[Array, Array, Array | None] | None:
    """Return vertices (v, 3) [m], triangles (t, 3), and colours (v, 3), NaN where the file has none.

    The colours are None if the file has none at all. Returns None for a file with elements that this reader does not
    know; Coal reads its triangles then.
    """
    try:
        return _File(ElementTree.parse(path).getroot()).mesh()
    except (ElementTree.ParseError, AttributeError, KeyError, ValueError, IndexError, TypeError, OSError):
        return None


def metres_per_unit(path: Path) -> float:
    """Return the length of the unit of a COLLADA file [m], which Coal's loader leaves out; 1 of other files."""
    if path.suffix.lower() != ".dae":
        return 1.0
    try:
        # the first is that of the whole file
        asset = next(element for _, element in ElementTree.iterparse(path) if element.tag.rpartition("}")[2] == "asset")
        unit = asset.find("{*}unit")
        metres = 1.0 if unit is None else float(unit.get("meter", "1"))
    except (ElementTree.ParseError, StopIteration, ValueError, OSError):
        return 1.0
    return metres if 0.0 < metres < np.inf else 1.0


class _File:
    """A parsed file."""

    def __init__(self, root: Element) -> None:
        self.root = root
        self.of = {element.get("id", ""): element for element in root.iter() if element.get("id")}

    def mesh(self) -> tuple[Array, Array, Array | None] | None:
        scene = self.root.find("{*}scene/{*}instance_visual_scene")
        unit = self.root.find("{*}asset/{*}unit")
        metres = np.diag([*[1.0 if unit is None else float(unit.get("meter", "1"))] * 3, 1.0])
        points, colors, plain = [], [], True
        for triangles, color in self._nodes(self._at(scene.get("url")), metres):  # type: ignore[union-attr]
            points.append(triangles.reshape(-1, 3))
            colors.append(np.broadcast_to(_NONE if color is None else color, points[-1].shape))
            plain = plain and color is None
        if not points:
            return None
        vertices = np.concatenate(points)
        return vertices, np.arange(len(vertices)).reshape(-1, 3), None if plain else np.concatenate(colors)

    def _at(self, url: str | None) -> Element:
        return self.of[(url or "").removeprefix("#")]

    def _nodes(self, parent: Element, pose: Array) -> Iterator[tuple[Array, Array | None]]:
        """Yield the triangles, shape (t, 3, 3), below a node or scene, and their colour."""
        for element in parent:
            kind = element.tag.rpartition("}")[2]
            if kind == "node":
                yield from self._nodes(element, pose @ _pose(element))
            elif kind == "instance_node":
                node = self._at(element.get("url"))
                yield from self._nodes(node, pose @ _pose(node))
            elif kind == "instance_geometry":
                bound = {m.get("symbol"): m.get("target") for m in element.findall(".//{*}instance_material")}
                for points, material in self._triangles(self._at(element.get("url"))):
                    yield points @ pose[:3, :3].T + pose[:3, 3], self._color(bound.get(material))
            elif kind in ("instance_controller", "skin"):
                raise ValueError("bones are not read")

    def _color(self, material: str | None) -> Array | None:
        """Return the diffuse colour of a material, None where it has none or a picture in its place."""
        if material is None:
            return None
        effect = self._at(self._at(material).find("{*}instance_effect").get("url"))  # type: ignore[union-attr]
        color = effect.find(".//{*}diffuse/{*}color")
        return None if color is None else np.clip(_numbers(color)[:3], 0.0, 1.0)

    def _triangles(self, geometry: Element) -> Iterator[tuple[Array, str | None]]:
        for part in geometry.findall("{*}mesh/*"):
            kind = part.tag.rpartition("}")[2]
            if kind in ("polygons", "tristrips", "trifans"):
                raise ValueError(f"{kind} are not read")
            if kind not in ("triangles", "polylist") or part.find("{*}p") is None:
                continue
            inputs = part.findall("{*}input")
            width = 1 + max(int(i.get("offset", "0")) for i in inputs)
            (which,) = (i for i in inputs if i.get("semantic") == "VERTEX")
            (place,) = (i for i in self._at(which.get("source")) if i.get("semantic") == "POSITION")
            source = self._at(place.get("source"))
            stride = int(source.find(".//{*}accessor").get("stride", "3"))  # type: ignore[union-attr]
            points = _numbers(source.find("{*}float_array")).reshape(-1, stride)[:, :3]
            corners = _numbers(part.find("{*}p"), int).reshape(-1, width)[:, int(which.get("offset", "0"))]
            if kind == "polylist":
                corners = _fans(corners, _numbers(part.find("{*}vcount"), int))
            if (corners < 0).any():
                raise ValueError("a vertex has a negative number")
            yield points[corners].reshape(-1, 3, 3), part.get("material")


def _fans(corners: Array, counts: Array) -> Array:
    """Return the corners of the triangles that polygons with the given numbers of corners are cut into."""
    starts, cut = np.cumsum(counts) - counts, np.maximum(counts - 2, 0)
    first = np.repeat(starts, cut)
    second = first + np.arange(cut.sum()) - np.repeat(np.cumsum(cut) - cut, cut) + 1
    return corners[np.stack([first, second, second + 1], axis=1).ravel()]


def _pose(node: Element) -> Array:
    """Return the pose of a node in its parent, shape (4, 4)."""
    pose = np.eye(4)
    for element in node:
        kind, step = element.tag.rpartition("}")[2], np.eye(4)
        if kind == "matrix":
            step = _numbers(element).reshape(4, 4)
        elif kind == "translate":
            step[:3, 3] = _numbers(element)
        elif kind == "rotate":
            *axis, angle = _numbers(element)
            # imported here because it is slow to import, and few files rotate by angles
            from scipy.spatial.transform import Rotation

            step[:3, :3] = Rotation.from_rotvec(angle * np.array(axis), degrees=True).as_matrix()
        elif kind == "scale":
            step[:3, :3] = np.diag(_numbers(element))
        elif kind in ("lookat", "skew"):
            raise ValueError(f"{kind} is not read")
        pose = pose @ step
    return pose


def _numbers(element: Element | None, kind: type = float) -> Array:
    return np.array((element.text or "").split(), dtype=kind)  # type: ignore[union-attr]
