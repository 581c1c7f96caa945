"""Height fields for the replay: triangles coloured by height, and contour lines."""

from __future__ import annotations

import meshcat.geometry as g
import numpy as np

from ...geometry.meshes.height_field import height_field
from ...scene.items import SurfaceItem
from .meshes import round_number

Array = np.ndarray

# most rows and columns that are drawn, those of larger fields at equal distances
_MOST = 200
# contour lines between the least and the largest height, about; fewer, where all are longer than so many sides of the
# field, and none where these were few
_LINES, _LONGEST, _FEWEST = 12, 80.0, 3
# from the least height to the largest
_COLORS = np.array([[0.36, 0.52, 0.38], [0.66, 0.70, 0.46], [0.80, 0.69, 0.50], [0.93, 0.92, 0.90]])
_LINE_COLOR = 0x4A4438
# three.js numbers the sides that are drawn
_FRONT = 0


def field_meshes(item: SurfaceItem) -> tuple[g.Mesh, g.LineSegments | None]:
    """Return the surface of a height field at its pose, and its contour lines, None of a level one."""
    assert item.heights is not None
    rows, columns = (np.unique(np.linspace(0, n - 1, min(n, _MOST)).astype(int)) for n in item.heights.shape)
    z = item.heights[np.ix_(rows, columns)].ravel()
    place = item.placed().vertices.reshape(*item.heights.shape, 3)[np.ix_(rows, columns)].reshape(-1, 3)
    triangles = height_field(z.reshape(len(rows), len(columns)), (1.0, 1.0)).triangles
    low, extent = float(z.min()), float(np.ptp(z))
    share = (z - low) / extent if extent > 0.0 else np.full(z.size, 0.5)
    colors = np.stack([np.interp(share, np.linspace(0.0, 1.0, len(_COLORS)), one) for one in _COLORS.T], axis=1)
    # as a wall it is drawn from its free side only, and a little behind its lines
    material = g.MeshPhongMaterial(
        color=0xFFFFFF, vertexColors=True, side=_FRONT, flatShading=True, shininess=5, polygonOffset=True,
        polygonOffsetFactor=1, polygonOffsetUnits=1,
    )  # fmt: skip
    surface = g.Mesh(g.TriangularMeshGeometry(place, triangles, colors), material)
    apart = max(extent / _LINES, float(np.ptp(z[triangles], axis=1).sum()) / max(len(rows), len(columns)) / _LONGEST)
    drawn = 0.0 < _FEWEST * apart < extent
    ends = contour_lines(place, z, triangles, round_number(apart)) if drawn else np.zeros((0, 3))
    if not len(ends):
        return surface, None
    return surface, g.LineSegments(g.PointsGeometry(ends.T), g.LineBasicMaterial(color=_LINE_COLOR))


def contour_lines(place: Array, z: Array, triangles: Array, apart: float) -> Array:
    """Return the ends of the segments where heights over triangles are multiples of a number, shape (2 k, 3).

    Parameters
    ----------
    place, z : ndarray, shapes (v, 3) and (v,)
        Corners of the triangles, and their heights [m].
    triangles : ndarray of int, shape (t, 3)
        The corners of each.
    apart : float
        The difference of two lines [m].
    """
    ends = [np.zeros((0, 3))]
    corners = z[triangles]
    for level in apart * np.arange(np.ceil(z.min() / apart), np.floor(z.max() / apart) + 1):
        above = corners > level
        crossed = np.flatnonzero(above.any(axis=1) & ~above.all(axis=1))
        # the corner that is alone on its side, and the two sides that meet there
        alone = np.where(above[crossed].sum(axis=1)[:, None] == 1, above[crossed], ~above[crossed]).argmax(axis=1)
        a, b, c = (triangles[crossed, (alone + k) % 3] for k in range(3))
        for other in (b, c):
            share = ((level - z[a]) / (z[other] - z[a]))[:, None]
            ends.append(place[a] + share * (place[other] - place[a]))
        if len(crossed):
            ends[-2:] = [np.stack(ends[-2:], axis=1).reshape(-1, 3)]
    return np.concatenate(ends)
