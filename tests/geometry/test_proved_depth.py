"""A proved penetration depth is the depth: against all axes of faces and edges, from whatever local maximum."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mbvi.geometry.polyhedron_overlap import overlap
from mbvi.geometry.proved_depth import disc_radius, is_greatest
from mbvi.geometry.refined_distance import FAILED, refined
from mbvi.geometry.separating_axis import SeparatingAxes, place_pair
from mbvi.geometry.shape_table import ShapeTable
from mbvi.geometry.shapes import Box, Hull, PlacedShape
from support.distance_kernel_arguments import rotation, unit

WORLD = np.vstack([np.eye(3), np.zeros(3)])


def axes_of(first, second):
    placed = [
        PlacedShape(name, s, k, np.eye(3), np.zeros(3)) for k, (name, s) in enumerate((("a", first), ("b", second)), 1)
    ]
    return SeparatingAxes(ShapeTable(placed), np.array([[0, 1]]))


def pressed(rng, depth):
    """Two hulls, one turned and pushed out of the other along some direction until only a depth is left."""
    a, b = (Hull(rng.normal(size=(rng.integers(5, 30), 3)) * rng.uniform(0.3, 1.0, size=3)) for _ in range(2))
    along, turn = unit(rng), rotation(rng)
    place = np.vstack([turn, 1e-3 * rng.normal(size=3)])
    for _ in range(60):
        distance, _ = overlap(a, WORLD, b, place)
        if distance >= -depth:
            break
        place[3] += (-distance - 0.9 * depth) * along
    return a, b, place


def local_maximum(axes, place, n):
    places = np.array([WORLD, place])
    found, apart, _ = refined(axes, places, 0, n)
    world = np.empty((2, 4, 3))
    place_pair(places, axes.shapes, 0, world)
    return found != FAILED, apart, world


@given(seed=st.integers(0, 1_000_000), depth=st.sampled_from([1e-6, 1e-3, 3e-2, 0.2]))
@settings(max_examples=150, deadline=None)
def test_what_is_proved_is_the_depth(seed, depth):
    rng = np.random.default_rng(seed)
    a, b, place = pressed(rng, depth)
    axes, exact = axes_of(a, b), overlap(a, WORLD, b, place)[0]
    for _ in range(6):
        n = unit(rng)
        known, apart, world = local_maximum(axes, place, n)
        if known and apart < 0.0 and is_greatest(world, axes.shapes, 0, n, -apart, 1.0):
            assert apart == pytest.approx(exact, abs=1e-9)


def test_most_shallow_depths_are_proved():
    rng, proved, refused = np.random.default_rng(0), 0, 0
    for _ in range(150):
        a, b, place = pressed(rng, 1e-4)
        exact, normal = overlap(a, WORLD, b, place)
        axes = axes_of(a, b)
        known, apart, world = local_maximum(axes, place, normal)
        if exact < 0.0 and known and is_greatest(world, axes.shapes, 0, normal, -apart, 1.0):
            proved += 1
        else:
            refused += exact < 0.0
    assert proved >= 20 * refused


def test_maxima_that_are_not_the_greatest_are_not_proved():
    rng, others = np.random.default_rng(0), 0
    for _ in range(60):
        a, b, place = pressed(rng, 0.5)
        axes, (exact, _) = axes_of(a, b), overlap(a, WORLD, b, place)
        for _ in range(10):
            n = unit(rng)
            known, apart, world = local_maximum(axes, place, n)
            if known and apart < exact - 1e-6:
                others += 1
                assert not is_greatest(world, axes.shapes, 0, n, -apart, 1.0)
    assert others >= 50


def test_only_hulls_are_proved():
    box, hull = Box((1.0, 1.0, 1.0)), Hull(np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]))
    place = np.vstack([np.eye(3), [0.0, 0.0, 1.4]])
    axes = axes_of(box, hull)
    known, apart, world = local_maximum(axes, place, np.array([0.0, 0.0, 1.0]))
    assert known
    assert not is_greatest(world, axes.shapes, 0, np.array([0.0, 0.0, 1.0]), -apart, 1.0)


def test_the_radius_of_a_disc_in_differences():
    square = np.array([[1.0, 1], [-1, 1], [-1, -1], [1, -1]])
    point = np.array([[0.25, 0.0]])
    # the square about the point
    assert disc_radius(square, point, 4, 1) == pytest.approx(0.75)
    assert disc_radius(point, square, 1, 4) == pytest.approx(0.75)
    # a square of twice the size
    assert disc_radius(square, square, 4, 4) == pytest.approx(2.0)
    # two segments that cross, one that does not reach the other, and points
    lines = np.array([[-1.0, 0], [2, 0]]), np.array([[0.0, -3], [0, 1]])
    assert disc_radius(*lines, 2, 2) == pytest.approx(1.0)
    assert disc_radius(lines[0], lines[1] + [3.0, 0.0], 2, 2) < 0.0
    assert disc_radius(point, point, 1, 1) == 0.0
