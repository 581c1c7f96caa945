"""The triangles of a Wavefront OBJ file and the colours of its materials, which Coal's loader leaves out."""

from __future__ import annotations

from pathlib import Path

import numpy as np

Array = np.ndarray
Color = tuple[float, ...]

# of what has no colour in a file that colours other parts
_NONE = (np.nan, np.nan, np.nan)


def wavefront_mesh(path: Path) -> tuple[Array, Array, Array | None] | None:
    """Return vertices (v, 3), triangles (t, 3), and colours (v, 3), NaN where the file has none.

    The colours are None if the file has none at all. Returns None for a file that cannot be read; Coal then says what
    is wrong with it.
    """
    points: list[list[float]] = []
    corners: list[int] = []
    colors: list[Color | None] = []
    known: dict[str, Color] = {}
    color: Color | None = None
    try:
        for line in path.read_text(encoding="utf-8", errors="replace").replace("\\\n", " ").splitlines():
            text = line.split("#", 1)[0]
            key, *words = text.split() or [""]
            if key in ("v", "f") and "_" in text:
                # Python would read 1_0 as a number
                return None
            if key == "v":
                points.append([float(x) for x in words[:3]])
            elif key == "f":
                # negative numbers count from the last vertex so far
                numbers = [int(word.split("/")[0]) for word in words]
                places = [n - 1 if n > 0 else len(points) + n for n in numbers]
                if min(places, default=0) < 0:
                    return None
                for k in range(1, len(places) - 1):
                    corners += [places[0], places[k], places[k + 1]]
                    colors.append(color)
            elif key == "usemtl":
                color = known.get(" ".join(words))
            elif key == "mtllib":
                known |= _materials(path.parent / " ".join(words))
        vertices, triangles = np.array(points, dtype=float).reshape(-1, 3), np.array(corners, dtype=int).reshape(-1, 3)
        used = vertices[triangles.ravel()]
    except (ValueError, IndexError, OverflowError, OSError):
        return None
    if all(one is None for one in colors):
        return vertices, triangles, None
    each = np.array([_NONE if one is None else one for one in colors])
    return used, np.arange(len(used)).reshape(-1, 3), np.repeat(each, 3, axis=0)


def _materials(path: Path) -> dict[str, Color]:
    """Return the diffuse colours of the materials in a file that have one and no picture in its place."""
    colors: dict[str, Color] = {}
    pictures: set[str] = set()
    name = ""
    if path.is_file():
        for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
            key, *words = line.split() or [""]
            if key == "newmtl":
                name = " ".join(words)
            elif key == "Kd":
                colors[name] = tuple(min(max(float(x), 0.0), 1.0) for x in words[:3])
            elif key == "map_Kd":
                pictures.add(name)
    return {name: color for name, color in colors.items() if name not in pictures and len(color) == 3}
