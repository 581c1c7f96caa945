"""Support points by hill climbing, and the few points of a face that are kept."""

import pickle
from functools import wraps

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbvi.constraints import HalfSpaceContacts
from mbvi.geometry.narrow.spread import BESIDE, FEW_POINTS, spread_out
from mbvi.geometry.shapes import flat_faces, shape_table, shapes
from mbvi.geometry.shapes.hull_graph import DIRECTIONS, cell_of, guides_of, neighbours, outermost
from mbvi.geometry.shapes.shape_table import ShapeTable, outermost_of_shape
from mbvi.geometry.shapes.shapes import HalfSpace, Hull, PlacedShape
from mbvi.projection import project
from mbvi.system import FreeBodies
from support.comparisons import beside


def bodies(n):
    return FreeBodies(np.ones(n), np.tile(np.diag([1.0, 2, 2.5]), (n, 1, 1)), np.zeros(3), tuple("abc"[:n]))


seeds = st.integers(0, 10_000)
# a direction is at most so far from the centre of its cell; the outermost point along this is, for points within a
# radius, lower by at most the radius times twice the distance of both unit vectors
FARTHEST = np.arctan(np.sqrt(2.0) / 8.0)
BESIDE_CELL = 2.0 * 2.0 * np.sin(0.5 * FARTHEST)


def counted(make, made):
    """Return a function that appends its name to a list when it is called."""

    @wraps(make)
    def call(*given):
        made.append(make.__name__)
        return make(*given)

    return call


def tables(shape):
    """The arrays of a hull on a body and over a floor."""
    placed = [PlacedShape(name, shape, 1 + k, np.eye(3), np.zeros(3)) for k, name in enumerate("ab")]
    floor = HalfSpaceContacts(bodies(2), [HalfSpace((0.0, 0.0, 1.0), 0.0)] * 2, placed, list("ab"), np.zeros(2))
    # the last ones are room for results
    return [*ShapeTable(placed).pairs(np.array([[0, 1]])), *floor.points[:-3]]


def radius(points):
    return np.linalg.norm(points, axis=1).max()


def hull(rng, flat):
    """A hull of many vertices; if flat, half of them lie in one plane."""
    points = rng.normal(size=(200, 3)) * rng.uniform(0.1, 2.0, size=3)
    points /= np.linalg.norm(points, axis=1)[:, None]
    if flat:
        points[:, 2] = np.maximum(points[:, 2], 0.0)
    return Hull(points)


@given(seed=seeds, flat=st.booleans())
def test_the_climb_ends_at_the_outermost_vertex_wherever_it_begins(seed, flat):
    rng = np.random.default_rng(seed)
    shape = hull(rng, flat)
    graph = neighbours(shape.triangles, len(shape.vertices))
    for _ in range(20):
        n = rng.normal(size=3)
        heights = shape.vertices @ n
        found = outermost(shape.vertices, 0, len(heights), *graph, *n.tolist(), int(rng.integers(len(heights))))
        assert heights[found] == pytest.approx(heights.max(), abs=1e-14)


@given(seed=seeds, flat=st.booleans())
def test_climbs_begin_near_their_end(seed, flat):
    """Along the axes of the frame too, between cells, and along no direction at all."""
    rng = np.random.default_rng(seed)
    table = ShapeTable([PlacedShape(name, hull(rng, flat), 1, np.eye(3), np.zeros(3)) for name in "ab"])
    shapes = table.pairs(np.array([[0, 1]]))
    begin, end = shapes.first_point[1:].tolist()
    for n in (*rng.normal(size=(20, 3)), *np.eye(3), *-np.eye(3), np.ones(3), np.array([1.0, -1.0, 0.0])):
        heights = shapes.points[begin:end] @ n
        found = outermost_of_shape(shapes, 1, *n.tolist(), int(rng.integers(begin, end)))
        assert heights[found - begin] == pytest.approx(heights.max(), abs=1e-14)
        # the point that a climb may begin at is nearly the outermost one
        guide, size = shapes.guides[1, cell_of(*n.tolist())], radius(shapes.points[begin:end])
        assert heights[guide - begin] >= heights.max() - BESIDE_CELL * size * np.linalg.norm(n)
    for n in ((np.nan,) * 3, (0.0,) * 3, (np.inf, -np.inf, np.nan)):
        assert 0 <= cell_of(*n) < DIRECTIONS


def test_guides_are_the_outermost_points_of_their_cells():
    points = np.random.default_rng(0).normal(size=(500, 3))
    guides = guides_of(points)
    for n in np.random.default_rng(1).normal(size=(2000, 3)):
        n /= np.linalg.norm(n)
        assert points[guides[cell_of(*n.tolist())]] @ n >= (points @ n).max() - BESIDE_CELL * radius(points)


def test_what_is_made_of_a_hull_is_made_once_for_it_and_its_copies(monkeypatch):
    """Copies of a problem are made of copies of its shapes, and need none of the tables of their corners again."""
    shape, made = hull(np.random.default_rng(0), True), []
    for module, name in (
        (flat_faces, "flat_faces"),
        (flat_faces, "half_width"),
        (shapes, "neighbours"),
        (shape_table, "guides_of"),
    ):
        make = getattr(module, name)
        monkeypatch.setattr(module, name, counted(make, made))
    first, copies = tables(shape), pickle.loads(pickle.dumps([shape] * 2))
    assert sorted(made) == ["flat_faces", "guides_of", "half_width", "neighbours"]
    for table, again in zip(first, tables(copies[0]), strict=True):
        np.testing.assert_array_equal(table, again)
    assert len(made) == 4


@given(seed=seeds, flat=st.booleans(), depth=st.sampled_from([0.0, 1e-9, 1e-3, 0.1]))
def test_every_sunk_vertex_is_a_row_or_adds_nothing(seed, flat, depth):
    """Of the sunk vertices those that are no rows lie beside the hull of the others by no more than the tolerance.

    A flat face has at most eight rows, and its corners are some 24: they lie beside by what eight corners leave.
    """
    rng = np.random.default_rng(seed)
    shape, system = hull(rng, flat), bodies(1)
    floor = HalfSpaceContacts(
        system, [HalfSpace((0.0, 0.0, 1.0), 0.0)], [PlacedShape("s", shape, 1, np.eye(3), np.zeros(3))], ["s"],
        np.zeros(1),
    )  # fmt: skip
    q = np.array([0.0, 0.0, 0.0, *(np.zeros(3) if flat else rng.normal(size=3)), 1.0])
    q[3:] /= np.linalg.norm(q[3:])
    every = floor.measure(q, np.array([0]), 0.0)
    q[2] -= every.gap.min() + depth
    every, rows = floor.measure(q, np.array([0]), 0.0), floor.contacts(0.0, q, 1e-9)
    sunk = every.point[every.gap <= 1e-9]
    assert rows.gap.min() == every.gap.min()
    if len(sunk) <= FEW_POINTS:
        np.testing.assert_array_equal(rows.point, sunk)
        return
    assert set(map(tuple, rows.point)) <= set(map(tuple, sunk))
    for point in sunk:
        assert beside(point[:2], rows.point[:, :2]) <= (0.25 if flat else 0.02) * shape.bound


@given(seed=seeds, count=st.integers(9, 60))
def test_rows_left_out_change_the_projected_velocity_by_no_more_than_the_tolerance(seed, count):
    """A disk whose rim has many corners strikes the floor: a corner without a row sinks by distance times angle."""
    rng = np.random.default_rng(seed)
    angle = np.sort(rng.uniform(0.0, 2.0 * np.pi, count))
    place = np.column_stack([np.cos(angle), np.sin(angle)])
    chosen = np.empty(count + 1, np.int64)
    number = spread_out(place, np.zeros(count), BESIDE, chosen)
    assert number < count or count <= 3 * FEW_POINTS
    # rates of the gaps: vertical speed and two angular velocities
    J = np.column_stack([np.ones(count), place[:, 1], -place[:, 0]])
    B = rng.normal(size=(3, 3))
    M, x = B @ B.T + 0.1 * np.eye(3), rng.normal(size=3) - np.array([2.0, 0.0, 0.0])
    few = project(x, M, J[chosen[:number]], 0.0).velocity
    turning = np.linalg.norm(few[1:])
    assert (J @ few).min() >= -0.01 * turning - 1e-9
