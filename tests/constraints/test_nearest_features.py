"""Which vertex, edge or face of a polyhedron is nearest to a point beside one of its vertices."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from mbvi.constraints.features.normal_cones import bounding_directions, nearest_feature


def drawn_hull(seed):
    """Random points, their hull, and of one of its triangles the corners and its neighbour across the first two."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(12, 3))
    hull = ConvexHull(points)
    triangle = int(rng.integers(len(hull.simplices)))
    p, first, second = rng.permutation(hull.simplices[triangle])
    beside = next(k for k, other in enumerate(hull.simplices) if k != triangle and {p, first} <= set(other.tolist()))
    planes = hull.equations * np.array([1.0, 1.0, 1.0, -1.0])
    through = (hull.simplices == p).any(axis=1)
    return rng, points[[p, first, second]], planes, planes[[triangle, beside]], planes[through, :3]


@pytest.mark.parametrize("seed", range(40))
@pytest.mark.parametrize("begins", ["vertex", "edge"])
def test_a_point_above_a_face_an_edge_or_a_vertex_is_nearest_to_that(seed, begins):
    rng, (p, first, second), planes, faces, normals = drawn_hull(seed)
    along, aside = ((corner - p) / np.linalg.norm(corner - p) for corner in (first, second))
    height, near = rng.uniform(0.1, 1.0), 1e-5
    part = np.array([p, np.zeros(3) if begins == "vertex" else along])

    found, face = nearest_feature(part, planes, 1.0, p + height * faces[0, :3] + near * (along + aside))
    assert face is not None
    np.testing.assert_allclose(face, faces[0], atol=1e-9)

    above_edge = faces[:, :3].T @ rng.uniform(0.2, 1.0, size=2)
    found, face = nearest_feature(part, planes, 1.0, p + height * above_edge + near * along)
    assert face is None
    np.testing.assert_allclose(found, [p, along], atol=1e-9)

    if begins == "vertex":
        found, face = nearest_feature(part, planes, 1.0, p + height * normals.sum(axis=0))
        assert face is None and (found == part).all()


@pytest.mark.parametrize("seed", range(20))
def test_the_directions_at_a_vertex_are_its_edges(seed):
    _, corners, planes, _, normals = drawn_hull(seed)
    edges, _ = bounding_directions(np.array([corners[0], np.zeros(3)]), planes, 1.0)
    # as many as faces, each in two of them and below the others
    assert len(edges) == len(normals)
    heights = edges @ normals.T
    assert ((np.abs(heights) < 1e-9).sum(axis=1) == 2).all() and heights.max() < 1e-9
