"""Signed distances are local maxima of the separation along a normal, to rounding, at any unit of length."""

import copy

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq, minimize

from mbvi.geometry.broad.separating_axis import SeparatingAxes
from mbvi.geometry.narrow import refined_distance
from mbvi.geometry.narrow.pair_distances import distances_from_axes
from mbvi.geometry.narrow.refined_distance import FAILED, FLAT, UNIQUE
from mbvi.geometry.shapes.shape_table import ShapeTable
from mbvi.geometry.shapes.shapes import Box, Capsule, Cylinder, Ellipsoid, PlacedShape, Sphere
from support.distance_kernel_arguments import SHAPES, refined, rotation, separated, unit
from support.plain.separating_axis import _compose, reach_plain

PAIRS = [(a, b) for a in range(len(SHAPES)) for b in range(len(SHAPES))]
BODIES = np.array([0, 1])


def placed(a, b, where_a, where_b):
    shapes = [PlacedShape(f"{k}", s, k + 1, np.eye(3), np.zeros(3)) for k, s in enumerate((a, b))]
    return SeparatingAxes(ShapeTable(shapes), BODIES[None]), places_of(where_a, where_b)


def places_of(*where):
    return np.array([np.vstack([R.T, p]) for R, p in where])


def touching(a, b, rng, gap):
    """Two shapes as far apart along a direction as makes the separation the gap, or as the bounds of both add up to."""
    towards, turns, most = unit(rng), (rotation(rng), rotation(rng)), SHAPES[a].bound + SHAPES[b].bound

    def at(distance):
        return (turns[0], np.zeros(3)), (turns[1], distance * towards)

    def missing(distance):
        return largest(axes, places_of(*at(distance)), towards) - gap

    axes, places = placed(SHAPES[a], SHAPES[b], *at(most))
    if missing(most) > 0.0:
        places = places_of(*at(brentq(missing, 0.0, most, xtol=1e-16, rtol=1e-15)))
    return axes, places, towards


def largest(axes, places, start):
    """The largest separation near a direction by a method without derivatives."""

    def lost(u):
        n = u / np.linalg.norm(u)
        return -separated(axes, places, 0, n)

    best = min((start + 0.3 * d for d in DIRECTIONS), key=lost)
    return -lost(best)


DIRECTIONS = np.concatenate([np.zeros((1, 3)), np.random.default_rng(7).normal(size=(40, 3))])


@pytest.mark.parametrize("gap", [0.05, 1e-9, -0.01])
@pytest.mark.parametrize(("a", "b"), PAIRS)
def test_no_direction_near_it_separates_more(a, b, gap, rng):
    found = 0
    for _ in range(3):
        axes, places, towards = touching(a, b, rng, gap)
        normal = minimize(
            lambda u, axes=axes, places=places: -separated(axes, places, 0, u / np.linalg.norm(u)), towards,
            method="Nelder-Mead", options={"xatol": 1e-5, "fatol": 1e-9},
        ).x  # fmt: skip
        normal /= np.linalg.norm(normal)
        given_d = separated(axes, places, 0, normal)
        result, distance, point = refined(axes, places, 0, normal)
        if result == FAILED:
            continue
        found += 1
        assert distance >= given_d - 1e-12
        assert separated(axes, places, 0, normal) == pytest.approx(distance, abs=1e-14)
        for size in 10.0 ** -np.arange(2, 9):
            for _ in range(5):
                other = normal + size * rng.normal(size=3)
                assert separated(axes, places, 0, other / np.linalg.norm(other)) <= distance + 1e-14
        if result == UNIQUE:
            # half the distance from either surface, along the normal
            for side, sign in ((0, 1.0), (1, -1.0)):
                reach = reach_of(axes, places, side, normal)
                assert sign * normal @ point - reach == pytest.approx(0.5 * distance, abs=1e-13)
    assert found >= 2


def reach_of(axes, places, side, n):
    return reach_plain(_compose(places[side], axes.shapes.fixed[side]), n, axes.shapes, 0, side)


@given(seed=st.integers(0, 10_000), exponent=st.integers(-14, 10))
def test_lengths_of_a_power_of_two_give_the_same_bytes(seed, exponent):
    rng = np.random.default_rng(seed)
    a, b = rng.integers(len(SHAPES), size=2)
    axes, places, towards = touching(a, b, rng, -0.01)
    s = 2.0**exponent
    first = towards.copy()
    result = refined(axes, places, 0, first)
    scaled, shapes = copy.copy(axes), axes.shapes
    lengths = np.array([1.0, 1.0, 1.0, s])[:, None]
    scaled.shapes = shapes._replace(fixed=shapes.fixed * lengths, sizes=s * shapes.sizes, points=s * shapes.points)
    second = towards.copy()
    again = refined(scaled, places * np.array([1.0, 1.0, 1.0, s])[:, None], 0, second)
    assert result[0] == again[0]
    if result[0] != FAILED:
        np.testing.assert_array_equal(first, second)
        assert again[1] == s * result[1]


def at_origin(shape):
    return shape, (np.eye(3), np.zeros(3))


def check_exact(a, b, where_b, distance, normal, point, start=(0.1, 0.05, 1.0)):
    (first, where_a) = at_origin(a)
    axes, places = placed(first, b, where_a, (np.eye(3), np.array(where_b)))
    n = np.array(start) / np.linalg.norm(start)
    result, found, at = refined(axes, places, 0, n)
    assert result == (FLAT if point is None else UNIQUE)
    assert found == pytest.approx(distance, abs=1e-15)
    np.testing.assert_allclose(n, normal, rtol=0, atol=1e-15)
    if point is not None:
        np.testing.assert_allclose(at, point, rtol=0, atol=1e-15)


def test_closed_forms():
    box, ellipsoid, up = Box((1.0, 1.0, 0.2)), Ellipsoid((0.2, 0.15, 0.1)), (0.0, 0.0, 1.0)
    check_exact(box, ellipsoid, (0.3, 0.2, 0.21), 0.01, up, (0.3, 0.2, 0.105))
    check_exact(box, ellipsoid, (0.3, 0.2, 0.2), 0.0, up, (0.3, 0.2, 0.1))
    check_exact(box, Sphere(0.1), (0.3, 0.2, 0.19), -0.01, up, (0.3, 0.2, 0.095))
    check_exact(box, Capsule(0.1, 0.2), (0.0, 0.0, 0.32), 0.02, up, (0.0, 0.0, 0.11))
    # two faces that lie on each other have no nearest points of their own
    check_exact(box, Cylinder(0.1, 0.2), (0.0, 0.0, 0.2), 0.0, up, None)
    check_exact(box, box, (0.1, 0.1, 0.2), 0.0, up, None)
    # beyond the edge of the box, and a corner
    beyond = np.array([3.0, 0.0, 4.0]) / 5.0
    check_exact(box, Sphere(0.1), (0.8, 0.0, 0.5), 0.4, beyond, (0.5 + 0.6 * 0.2, 0.0, 0.1 + 0.8 * 0.2), beyond)
    check_exact(Cylinder(0.5, 0.2), Sphere(0.1), (0.8, 0.0, 0.5), 0.4, beyond, (0.62, 0.0, 0.26), beyond)
    # from a face, whose edges the nearest point is beyond
    aslant = (1e-4, -1e-4, 1.0)
    check_exact(box, Sphere(0.1), (0.8, 0.0, 0.5), 0.4, beyond, (0.62, 0.0, 0.26), aslant)
    check_exact(Cylinder(0.5, 0.2), Sphere(0.1), (0.8, 0.0, 0.5), 0.4, beyond, (0.62, 0.0, 0.26), aslant)


def test_a_wrong_start_is_told():
    """A direction that leads nowhere ends in a refusal, not in numbers."""
    axes, places = placed(
        Sphere(0.1), Box((1.0, 1.0, 1.0)), (np.eye(3), np.zeros(3)), (np.eye(3), np.array([0, 0, 2.0]))
    )
    for wrong in (np.zeros(3), np.full(3, np.nan)):
        assert refined(axes, places, 0, wrong)[0] == FAILED
    assert refined_distance._MOST_SETS > 10


@given(
    exponent=st.floats(-8.5, -2.0), gap=st.floats(1e-10, 1e-3), side=st.sampled_from([1.0, -1.0]),
    wide_first=st.booleans(), seed=st.integers(0, 10_000),
)  # fmt: skip
def test_boxes_that_turned_about_a_common_edge_direction(exponent, gap, side, wide_first, seed):
    """A corner edge of a narrow box above a wide face: the distance is its height, whichever face the search starts at.

    Edges along y are straight for both boxes at every normal across y.
    """
    wide, narrow, tilt = Box((2.0, 0.3, 0.2)), Box((0.3, 0.4, 0.3)), side * 10.0**exponent
    turn = np.array([[np.cos(tilt), 0, np.sin(tilt)], [0, 1, 0], [-np.sin(tilt), 0, np.cos(tilt)]])
    # the lowest edge of the narrow box is at the height of the gap
    low = 0.15 * (abs(turn[2, 0]) + abs(turn[2, 2]))
    R = rotation(np.random.default_rng(seed))
    above = R @ np.array([0.0, 0.0, 0.1 + gap + low])
    below = (R, np.zeros(3))
    shapes = (wide, narrow) if wide_first else (narrow, wide)
    axes, places = placed(*shapes, *((below, (R @ turn, above)) if wide_first else ((R @ turn, above), below)))
    up = R[:, 2] if wide_first else -R[:, 2]
    for start in (up, R @ turn @ R.T @ up):
        normal = start.copy()
        result, distance, _ = refined(axes, places, 0, normal)
        assert result == FLAT
        assert distance == pytest.approx(gap, abs=1e-14)
        np.testing.assert_allclose(normal, up, atol=1e-12)


@pytest.mark.parametrize("gap", [0.3, 0.0, -0.01])
@pytest.mark.parametrize("lies", [False, True], ids=["upright", "lying"])
def test_the_point_between_parallel_faces_and_edges_is_one_of_them(lies, gap):
    radius, length = 0.2, 0.5
    turn = rotation_about_x(0.5 * np.pi) if lies else np.eye(3)
    height = 0.1 + gap + (radius if lies else 0.5 * length)
    shapes = Box((1.0, 1.0, 0.2)), Cylinder(radius, length)
    axes, places = placed(*shapes, (np.eye(3), np.zeros(3)), (turn, np.array([0.4, 0.1, height])))
    distance, normal, middle, state = np.empty(1), np.empty((1, 3)), np.full((1, 3), np.nan), np.empty(1, np.int64)
    bound = np.array([min(shape.bound for shape in shapes)])
    distances_from_axes(places, axes.tables, bound, np.array([0]), axes.axis, np.inf, distance, normal, middle, state)
    assert state[0] == FLAT and distance[0] == pytest.approx(gap, abs=1e-15)
    np.testing.assert_allclose(normal[0], (0.0, 0.0, 1.0), rtol=0, atol=1e-15)
    x, y, z = middle[0]
    assert z == pytest.approx(0.1 + 0.5 * gap, abs=1e-14)
    assert abs(x) <= 0.5 and abs(y) <= 0.5
    x, y = x - 0.4, y - 0.1
    assert (abs(x) < 1e-8 and abs(y) <= 0.5 * length) if lies else x**2 + y**2 <= radius**2


def rotation_about_x(angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
