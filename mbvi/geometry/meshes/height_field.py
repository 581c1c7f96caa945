"""Height fields: surfaces over a grid in a plane, as triangle meshes."""

from __future__ import annotations

import numpy as np

from ...arguments import Array
from .triangles import FEW, Surface, Tree, boxes_about, curve_order


def height_field(heights: Array, size: tuple[float, float]) -> Surface:
    """Return the one-sided mesh of heights over a rectangle about the origin.

    Parameters
    ----------
    heights : ndarray, shape (rows, columns)
        Heights [m]; rows ascend along y, columns along x.
    size : (float, float)
        Lengths of the rectangle along x and y [m].

    Notes
    -----
    Each cell is two triangles; the edge between them leads from its corner of the least x and y to the opposite one.
    All that `Surface` finds for any mesh by sorting is known of a grid.
    """
    rows, columns = heights.shape
    x, y = (np.linspace(-0.5, 0.5, n) * length for n, length in zip((columns, rows), size, strict=True))
    vertices = np.stack([np.tile(x, rows), y.repeat(columns), heights.ravel()], axis=1)
    corner = np.arange(rows * columns).reshape(rows, columns)
    # edges along x, along y, and the diagonals are numbered behind the corners
    along_x = rows * columns + np.arange(rows * (columns - 1)).reshape(rows, columns - 1)
    along_y = along_x[-1, -1] + 1 + np.arange((rows - 1) * columns).reshape(rows - 1, columns)
    across = along_y[-1, -1] + 1 + np.arange((rows - 1) * (columns - 1)).reshape(rows - 1, columns - 1)
    face = across[-1, -1] + 1 + np.arange(across.size).reshape(across.shape)
    here, right, above, beyond = corner[:-1, :-1], corner[:-1, 1:], corner[1:, :-1], corner[1:, 1:]
    # two triangles in a row: below and above the diagonal
    features = np.empty((*across.shape, 2, 7), np.int64)
    for k, columns_of in enumerate((
        (here, right, beyond, along_x[:-1], along_y[:, 1:], across, face),
        (here, beyond, above, across, along_x[1:], along_y[:, :-1], face + face.size),
    )):  # fmt: skip
        for j, numbers in enumerate(columns_of):
            features[:, :, k, j] = numbers
    features = features.reshape(-1, 7)
    triangles = np.ascontiguousarray(features[:, :3])
    tree = _tree(x, y, heights)
    return Surface.one_sided_of(vertices, (triangles, features, *_sharers(rows, columns)), tree)


def _sharers(rows: int, columns: int) -> tuple[Array, Array]:
    """Return `Surface.sharers` and `Surface.rim` of a grid."""
    corner, outer = np.zeros((rows, columns), np.int64), np.ones((rows, columns), bool)
    outer[1:-1, 1:-1] = False
    for up, along, count in ((0, 0, 2), (0, 1, 1), (1, 1, 2), (1, 0, 1)):
        corner[up : rows - 1 + up, along : columns - 1 + along] += count
    along_x, along_y = np.full((rows, columns - 1), 2), np.full((rows - 1, columns), 2)
    along_x[[0, -1]], along_y[:, [0, -1]] = 1, 1
    cells = (rows - 1) * (columns - 1)
    edges = np.concatenate([along_x.ravel(), along_y.ravel(), np.full(cells, 2)])
    sharers = np.concatenate([corner.ravel(), edges, np.ones(2 * cells, np.int64)])
    return sharers, np.concatenate([outer.ravel(), edges == 1, np.zeros(2 * cells, bool)])


def _tree(x: Array, y: Array, heights: Array) -> Tree:
    """Return the tree of the triangles over a grid, in which both of a cell are in one box."""
    i, j = np.divmod(np.arange((len(y) - 1) * (len(x) - 1)), len(x) - 1)
    cells = curve_order(np.stack([j, i], axis=1))
    i, j = i[cells], j[cells]
    four = heights[:-1, :-1], heights[:-1, 1:], heights[1:, :-1], heights[1:, 1:]
    low, high = (extreme.reduce(four).ravel()[cells] for extreme in (np.minimum, np.maximum))
    boxes = boxes_about(np.stack([x[j], y[i], low], axis=1), np.stack([x[j + 1], y[i + 1], high], axis=1), FEW // 2)
    return Tree((2 * cells[:, None] + np.arange(2)).ravel(), boxes)
