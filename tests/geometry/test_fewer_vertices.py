"""Hulls of fewer vertices: bounds against distances by least squares, and who is kept."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import nnls

from mbvi.geometry.shapes.fewer_vertices import _distances, _needed, fewer_vertices
from mbvi.geometry.shapes.fit_primitive import fit_primitive
from mbvi.geometry.shapes.shapes import Hull
from support.plain.triangles import nearest_on_triangles


def distance(points, x):
    """Distance of a point to a hull of points, by least squares over nonnegative weights."""
    # with a sum s of the weights the least square is s^2 d^2 + (1 - s)^2, which is least where d is least
    weights = nnls(np.vstack([(points - x).T, np.ones(len(points))]), np.array([0.0, 0.0, 0.0, 1.0]))[0]
    return np.linalg.norm(weights / weights.sum() @ (points - x))


def random_hull(rng):
    """A flat or long egg with a flat side, off the origin."""
    points = rng.normal(size=(60, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    points[:, 2] = np.maximum(points[:, 2], -0.5)
    return Hull(points * 10.0 ** rng.uniform(-1.5, 0.0, size=3) + rng.normal(size=3))


@given(seed=st.integers(0, 2**32 - 1), part=st.floats(1e-3, 0.3))
def test_every_vertex_is_within_the_stated_distance(seed, part):
    hull = random_hull(np.random.default_rng(seed))
    tolerance = part * np.ptp(hull.vertices, axis=0).min()
    found = fewer_vertices(hull, tolerance)
    if found is None:
        return
    fewer, stated = found
    assert stated <= tolerance
    assert len(fewer.vertices) <= 0.9 * len(hull.vertices)
    # it lies within the hull, for it has no vertices but the hull's
    assert {tuple(x) for x in fewer.vertices} <= {tuple(x) for x in hull.vertices}
    true = max(distance(fewer.vertices, x) for x in hull.vertices)
    assert true <= stated + 1e-12


@given(seed=st.integers(0, 2**32 - 1))
def test_a_needed_vertex_is_far_from_the_others(seed):
    hull = random_hull(np.random.default_rng(seed))
    points, bound = hull.vertices, _needed(hull)
    assert (bound >= 0.0).all()
    for k in np.argsort(bound)[-5:]:
        assert bound[k] <= distance(np.delete(points, k, axis=0), points[k]) + 1e-12


@given(seed=st.integers(0, 2**32 - 1), thin=st.floats(1e-12, 1.0))
def test_distances_of_triangles(seed, thin):
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(2, 50, 3))
    c = a + rng.uniform(-0.5, 1.5, size=(50, 1)) * (b - a) + thin * rng.normal(size=(50, 3))
    x = rng.normal(size=(50, 3))
    found = _distances(x, a, b, c)
    assert (found <= np.linalg.norm(x[:, None] - np.stack([a, b, c], axis=1), axis=2).min(axis=1) + 1e-15).all()
    if thin > 1e-4:
        near = np.array([nearest_on_triangles(*(p[k : k + 1] for p in (a, b, c, x)))[0][0] for k in range(50)])
        np.testing.assert_allclose(found, np.linalg.norm(x - near, axis=1), rtol=1e-9, atol=1e-9)


def test_a_triangle_without_an_area_is_its_longest_side():
    a, b, c = (np.array([[x, 0.0, 0.0]]) for x in (0.0, 1.0, 3.0))
    assert _distances(np.array([[2.0, 1.0, 0.0]]), a, b, c) == pytest.approx(1.0)


def test_a_fine_ball_keeps_its_vertices_and_noise_on_a_flat_side_goes(rng):
    ball = rng.normal(size=(200, 3))
    ball /= np.linalg.norm(ball, axis=1)[:, None]
    assert fewer_vertices(Hull(ball), 1e-6) is None
    # as a file in single precision has them
    sides = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
    sheet = np.column_stack([rng.uniform(-1, 1, size=(300, 2)), 1.0 + 1e-7 * rng.random(300)])
    hull = Hull(np.concatenate([sides, sheet]))
    assert len(hull.vertices) > 20
    fewer, stated = fewer_vertices(hull, 1e-6)
    assert len(fewer.vertices) < 12 and 0.0 < stated <= 1e-7


@given(seed=st.integers(0, 2**32 - 1), length=st.sampled_from([1e-3, 1.0, 1e3]), shift=st.sampled_from([0.0, 10.0]))
def test_the_default_is_a_ten_thousandth_of_the_size(seed, length, shift):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(50, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    # several vertices in place of each; a hull whose frame lies elsewhere has the same size
    hull = Hull((np.repeat(points, 5, axis=0) + 1e-5 * rng.normal(size=(250, 3)) + shift) * length)
    size = np.linalg.norm(hull.vertices - hull.mass_properties(1.0)[0], axis=1).max()
    found, same = fit_primitive(hull, None), fit_primitive(hull, 1e-4 * size)
    assert found.distance == same.distance <= 1e-4 * size
    np.testing.assert_array_equal(found.shape.vertices, same.shape.vertices)
    assert fit_primitive(hull, 0.0) is None


@given(seed=st.integers(0, 2**32 - 1))
def test_a_hull_of_vertices_has_the_triangles_of_the_hull(seed):
    rng = np.random.default_rng(seed)
    # many points on flat sides, and many within
    points = np.round(rng.normal(size=(300, 3)) * 3.0)
    hull = Hull(points)
    again = Hull(hull.vertices)
    np.testing.assert_array_equal(again.vertices, hull.vertices)
    np.testing.assert_array_equal(again.triangles, hull.triangles)
    made = hull.coal(0.25)
    np.testing.assert_array_equal(made.points(), hull.vertices / 0.25)
    assert [tuple(made.polygons(k)[i] for i in range(3)) for k in range(made.num_polygons)] == [
        tuple(t) for t in hull.triangles.tolist()
    ]
