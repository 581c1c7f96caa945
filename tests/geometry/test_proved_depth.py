"""The search of two cores always ends with the distance or the penetration depth: against Coal, and all other axes.

That a normal separates by a distance is checked by the support functions of the shapes in plain numpy.
"""

import coal
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mbvi.geometry.broad.separating_axis import SeparatingAxes, place_pair
from mbvi.geometry.narrow.pair_distances import distances_from_axes
from mbvi.geometry.narrow.proved_depth import better_direction, disc_radius, least_within
from mbvi.geometry.shapes.shape_table import ShapeTable
from mbvi.geometry.shapes.shapes import Box, Capsule, Cylinder, Ellipsoid, Hull, PlacedShape
from support.distance_kernel_arguments import rotation, unit
from support.polyhedron_overlap import overlap

WORLD = np.vstack([np.eye(3), np.zeros(3)])
seeds = st.integers(0, 1_000_000)


def round_hull(rng, size):
    """A hull of many vertices."""
    points = rng.normal(size=(int(rng.integers(20, 200)), 3))
    return Hull(size * points / np.linalg.norm(points, axis=1)[:, None] * rng.uniform(0.3, 1.0, size=3))


def flat_hull(rng, size):
    """A plate or a needle."""
    return Hull(size * rng.normal(size=(int(rng.integers(4, 12)), 3)) * 10.0 ** rng.uniform(-6, 0, size=3))


def prism(rng, size):
    """A hull of two parallel faces of many vertices."""
    corners = rng.normal(size=(int(rng.integers(3, 20)), 2))
    return Hull(size * np.concatenate([np.column_stack([corners, np.full(len(corners), z)]) for z in (0.0, 0.3)]))


def on_a_grid(rng, size):
    """A hull with faces of many vertices."""
    return Hull(0.1 * size * rng.integers(-2, 3, size=(30, 3)))


def box(rng, size):
    return Box(tuple((size * rng.uniform(0.05, 1.0, 3)).tolist()))


def capsule(rng, size):
    return Capsule(*(size * rng.uniform(0.1, 1.0, 2)).tolist())


def cylinder(rng, size):
    return Cylinder(*(size * rng.uniform(0.1, 1.0, 2)).tolist())


def ellipsoid(rng, size):
    return Ellipsoid(tuple((size * rng.uniform(0.1, 1.0, 3)).tolist()))


HULLS, CURVED = (round_hull, flat_hull, prism, on_a_grid), (cylinder, ellipsoid)
FAR = [0.0, 0.1, 0.5, 1.0, 1.2]


class Pair:
    """Two shapes at random places, and what is measured of them from an axis."""

    def __init__(self, rng, kinds, far):
        size = 10.0 ** rng.uniform(-3.0, 2.0)
        sizes = rng.permutation([size, size * 10.0 ** rng.uniform(-2.0, 0.0)])
        self.shapes = [kind(rng, s) for kind, s in zip(kinds, sizes, strict=True)]
        placed = [PlacedShape(f"{k}", s, k + 1, np.eye(3), np.zeros(3)) for k, s in enumerate(self.shapes)]
        self.axes = SeparatingAxes(ShapeTable(placed), np.array([[0, 1]]))
        turns = [rotation(rng) if rng.random() < 0.7 else np.eye(3) for _ in range(2)]
        self.size, self.bound = sum(s.bound for s in self.shapes), min(s.bound for s in self.shapes)
        where = rng.uniform(0.0, far) * self.size * unit(rng)
        self.places = np.array([[*turns[0], np.zeros(3)], [*turns[1], where]])

    def measured(self, axis):
        """Distance, normal, midpoint and state by a search that starts from an axis, NaN for none."""
        found = np.empty(1), np.empty((1, 3)), np.empty((1, 3)), np.empty(1, np.int64)
        bound, axes = np.array([self.bound]), np.array([axis])
        distances_from_axes(self.places, self.axes.tables, bound, np.zeros(1, np.int64), axes, np.inf, *found)
        return tuple(part[0] for part in found)

    def separation(self, n):
        """The separation along n by the support functions of both shapes."""
        return -sum(reach(s, p, w) for s, p, w in zip(self.shapes, self.places, (n, -n), strict=True))

    def coal(self, accuracy):
        """Coal's distance and normal, in the unit of the smaller shape."""
        unit_of_length = float(np.ldexp(1.0, np.frexp(self.bound)[1]))
        request, result = coal.DistanceRequest(), coal.DistanceResult()
        request.gjk_tolerance = request.epa_tolerance = accuracy
        sides = []
        for shape, place in zip(self.shapes, self.places, strict=True):
            turn = np.ascontiguousarray(place[:3].T)
            sides += [shape.coal(unit_of_length), coal.Transform3s(turn, place[3] / unit_of_length)]
        return coal.distance(*sides, request, result) * unit_of_length, np.array(result.normal)


def reach(shape, place, n):
    """How far a shape at a place reaches along n."""
    u, along = place[:3] @ n, place[3] @ n
    match shape:
        case Capsule():
            return 0.5 * shape.length * abs(u[2]) + shape.radius + along
        case Cylinder():
            return 0.5 * shape.length * abs(u[2]) + shape.radius * np.hypot(u[0], u[1]) + along
        case Ellipsoid():
            return np.linalg.norm(np.array(shape.radii) * u) + along
    return (shape.vertices @ u).max() + along


def check(pair, rng, accuracy):
    """The distance is that along its normal, no normal of Coal's is better; apart, it is no less than Coal's."""
    start = unit(rng) if rng.random() < 0.7 else np.full(3, np.nan)
    distance, normal, middle, _ = pair.measured(start)
    assert np.linalg.norm(normal) == pytest.approx(1.0, abs=1e-14)
    assert pair.separation(normal) == pytest.approx(distance, abs=1e-13 * pair.size)
    assert np.isfinite(middle).all()
    for of_coal in (1e-11, 1e-9, 1e-6):
        gap, along = pair.coal(of_coal)
        length = np.linalg.norm(along)
        if np.isfinite(gap) and length > 0.5:
            # separations are sums of numbers of the size of both shapes, which round
            assert pair.separation(along / length) <= distance + accuracy * pair.bound + 1e-15 * pair.size
        # at 1e-9 Coal's gap may be too large by 2e-9 of itself
        if of_coal == 1e-11 and gap > 0.0:
            # the least distance is no less than the separation along any normal: only too small a one can be wrong
            assert distance >= (1.0 - max(1e-9, 1e-2 * accuracy)) * gap - max(1e-10, 1e-2 * accuracy) * pair.bound
    return distance, normal


@pytest.mark.parametrize("far", FAR)
@pytest.mark.parametrize("second", [*HULLS, box, capsule])
@pytest.mark.parametrize("first", HULLS)
def test_hulls_are_as_far_apart_or_as_deep_as_coal_says(first, second, far, rng):
    for _ in range(8):
        check(Pair(rng, (first, second), far), rng, 1e-11)


@pytest.mark.slow(seconds=60)
@given(seed=seeds, far=st.sampled_from(FAR), kinds=st.tuples(st.sampled_from(HULLS), st.sampled_from([*HULLS, box])))
@settings(max_examples=6_000, deadline=None)
def test_thousands_of_hulls(seed, far, kinds):
    rng = np.random.default_rng(seed)
    check(Pair(rng, kinds, far), rng, 1e-11)


@pytest.mark.parametrize("far", FAR)
@pytest.mark.parametrize("first", [*HULLS, box, capsule, *CURVED])
@pytest.mark.parametrize("second", CURVED)
def test_curved_shapes_are_as_deep_as_coal_says(first, second, far, rng):
    for _ in range(4):
        check(Pair(rng, (first, second), far), rng, 2e-6)


@pytest.mark.parametrize("far", [0.0, 0.3, 0.7])
@pytest.mark.parametrize("first", HULLS)
@pytest.mark.parametrize("second", [flat_hull, prism, on_a_grid, box])
def test_no_axis_of_faces_and_edges_separates_more(first, second, far, rng):
    for _ in range(3):
        pair = Pair(rng, (first, second), far)
        if np.prod([len(s.vertices) for s in pair.shapes]) < 1500:
            distance, _, _, _ = pair.measured(np.full(3, np.nan))
            exact = overlap(pair.shapes[0], pair.places[0], pair.shapes[1], pair.places[1])[0]
            if distance <= 0.0:
                # the edges of `overlap` are rounded to twelve digits
                assert distance == pytest.approx(exact, abs=1e-10 * pair.size)


@given(seed=seeds, far=st.sampled_from(FAR), kinds=st.tuples(st.sampled_from(HULLS), st.sampled_from([*HULLS, box])))
def test_what_was_known_before_does_not_change_a_byte(seed, far, kinds):
    rng = np.random.default_rng(seed)
    pair = Pair(rng, kinds, far)
    begin = pair.axes.shapes.first_point
    results, there = [], pair.places.copy()
    for start in (np.full(3, np.nan), unit(rng), unit(rng)):
        pair.axes.shapes.start[0, :2], pair.axes.shapes.start[0, 2:] = rng.integers(begin[:2], begin[1:3]), -1
        results.append(pair.measured(start))
    for way in (0.0, 1e-9, 1e-4, 0.1):
        # measured where it was before, with the corners of that result
        pair.places[1, 3] += way * pair.size * rng.normal(size=3)
        before = pair.measured(unit(rng))[1]
        pair.places[:] = there
        results.append(pair.measured(before))
    for other in results[1:]:
        assert other[0] == results[0][0]
        np.testing.assert_array_equal(other[1], results[0][1])
        assert other[3] == results[0][3]


@pytest.mark.parametrize("far", [0.0, 1.2])
@pytest.mark.parametrize("kinds", [(prism, capsule), (capsule, prism), (on_a_grid, box), (round_hull, round_hull)])
def test_the_midpoint_is_half_the_distance_from_both_surfaces(kinds, far, rng):
    for _ in range(20):
        pair = Pair(rng, kinds, far)
        distance, n, middle, _ = pair.measured(unit(rng))
        for shape, place, way in zip(pair.shapes, pair.places, (n, -n), strict=True):
            assert way @ middle - reach(shape, place, way) == pytest.approx(0.5 * distance, abs=1e-12 * pair.size)


def touching(rng, depth):
    """Two hulls, one pushed out of the other along some direction until only a depth is left."""
    pair = Pair(rng, (prism, flat_hull), 0.1)
    along = unit(rng)
    for _ in range(60):
        distance, *_ = pair.measured(np.full(3, np.nan))
        if distance >= -depth * pair.bound:
            break
        pair.places[1, 3] += (-distance - 0.9 * depth * pair.bound) * along
    return pair


@pytest.mark.parametrize("depth", [0.0, 1e-12, 1e-6, 1e-3])
def test_hulls_that_just_touch(depth, rng):
    for _ in range(20):
        check(touching(rng, depth), rng, 1e-11)


def test_no_better_direction_is_found_where_there_is_none_and_one_where_there_is(rng):
    found = 0
    for _ in range(100):
        pair, n = Pair(rng, (flat_hull, prism), 0.3), unit(rng)
        exact, best, *_ = pair.measured(np.full(3, np.nan))
        world = np.empty((2, 4, 3))
        place_pair(pair.places, pair.axes.shapes, 0, world)
        if exact < -1e-9 * pair.bound:
            tolerance = 1e-10 * pair.bound
            assert not better_direction(world, pair.axes.shapes, 0, best.copy(), -exact, 0.0, tolerance)
            depth, other = -pair.separation(n), n.copy()
            if depth > -exact + 2.0 * tolerance:
                found += 1
                assert better_direction(world, pair.axes.shapes, 0, other, depth, 0.0, tolerance)
                assert -pair.separation(other) < depth
    assert found >= 30


def test_heights_within_a_triangle_are_no_less_than_their_bound(rng):
    for _ in range(300):
        corners = unit(rng) + rng.uniform(0.05, 1.0) * rng.normal(size=(3, 3))
        corners /= np.linalg.norm(corners, axis=1)[:, None]
        points = rng.normal(size=(3, 3)) + rng.choice([2.0, -2.0]) * corners.mean(axis=0)
        low = least_within(np.array([corners, points]))
        inside = rng.dirichlet(np.ones(3), size=50) @ corners
        heights = (inside / np.linalg.norm(inside, axis=1)[:, None]) @ points.T
        # no mixture of points guarantees more than the greatest of them does somewhere
        assert heights.max(axis=1).min() >= low - 1e-12
        mixtures = rng.dirichlet(np.ones(3), size=200) @ points @ corners.T
        assert low <= 0.0 or low >= mixtures.min(axis=1).max() - 1e-12


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
