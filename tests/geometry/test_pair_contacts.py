"""Contact points of two convex shapes: the corners of the region they share, each with its own gap."""

import coal
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, reject
from hypothesis import strategies as st
from scipy.optimize import linprog
from scipy.spatial import ConvexHull, HalfspaceIntersection

import mbvi
from mbvi.constraints import SignedDistances
from mbvi.geometry.closed_form.convex_polygon import common_polygon, convex_hull
from mbvi.geometry.shapes.shape_table import indexed
from mbvi.geometry.shapes.shapes import Box, Capsule, Cylinder, Hull, PlacedShape
from mbvi.system import FreeBodies
from support.comparisons import beside
from support.distance_kernel_arguments import rotation
from support.paths import ROBOTS
from support.polyhedron_overlap import overlap

seeds = st.integers(0, 10_000)


def pair(first, second):
    system = FreeBodies(np.ones(2), np.tile(np.eye(3), (2, 1, 1)), np.zeros(3), ("a", "b"))
    shapes = [PlacedShape(f"s{k}", s, k + 1, np.eye(3), np.zeros(3)) for k, s in enumerate((first, second))]
    return SignedDistances(system, *indexed(shapes[:1], shapes[1:]), np.zeros(1))


def pose(where, turn):
    return [*where, *pin.Quaternion(np.ascontiguousarray(turn)).coeffs()]


def egg(rng, count):
    """A hull of many vertices."""
    points = rng.normal(size=(count, 3))
    return Hull(points / np.linalg.norm(points, axis=1)[:, None] * rng.uniform(0.3, 1.0, size=3))


@given(seed=seeds, scale=st.sampled_from([1e-3, 1.0, 1e2]), apart=st.floats(0.2, 2.2))
def test_hulls_of_many_vertices_are_as_far_apart_as_coal_says(seed, scale, apart):
    rng = np.random.default_rng(seed)
    shapes = [Hull(scale * egg(rng, int(rng.integers(20, 300))).vertices) for _ in range(2)]
    contacts, turns = pair(*shapes), [rotation(rng), rotation(rng)]
    towards = rng.normal(size=3)
    towards *= scale * apart / np.linalg.norm(towards)
    # the axis of the last distance begins each search: first from beside, then on the way there
    aside = np.cross(towards, rng.normal(size=3))
    aside *= scale * apart / np.linalg.norm(aside)
    for share, beside_it in ((1.0, 1.5), (1.0, 0.7), (1.02, 0.0), (1.001, 0.0), (1.0, 0.0)):
        places = [np.zeros(3), share * towards + beside_it * aside]
        q = np.concatenate([pose(p, R) for p, R in zip(places, turns, strict=True)])
        gap = contacts.gap(0.0, q)[0]
        fresh = pair(*shapes)
        assert fresh.gap(0.0, q)[0] == gap
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    request.gjk_tolerance = request.epa_tolerance = 1e-9 * scale
    poses = [coal.Transform3s(R, p) for R, p in zip(turns, places, strict=True)]
    found = coal.distance(shapes[0].coal(), poses[0], shapes[1].coal(), poses[1], request, result)
    assert gap == pytest.approx(found, abs=1e-7 * scale)


def prism(corners, height):
    return Hull(np.concatenate([np.column_stack([corners, np.full(len(corners), z)]) for z in (0.0, height)]))


@given(seed=seeds, gap=st.sampled_from([0.0, -1e-3, 1e-10]), many=st.booleans())
def test_faces_on_each_other_get_the_corners_of_what_they_share(seed, gap, many):
    rng = np.random.default_rng(seed)
    count = 30 if many else int(rng.integers(3, 7))
    polygons = [rng.normal(size=(count, 2)) for _ in range(2)]
    polygons = [p[ConvexHull(p).vertices] for p in polygons]
    shift = 0.3 * rng.normal(size=2)
    contacts = pair(prism(polygons[0], -0.4), prism(polygons[1], 0.5))
    turn, q = rotation(rng), []
    for where in (np.zeros(3), np.array([*shift, gap])):
        q += pose(turn @ where, turn)
    found = contacts.contacts(0.0, np.array(q), 1e-9)
    # half-planes that hold both polygons
    sides = np.concatenate([ConvexHull(p + s).equations for p, s in zip(polygons, (0.0, shift), strict=True)])
    corners = HalfspaceIntersection(sides, centre(polygons[0], polygons[1] + shift)).intersections
    corners = corners[ConvexHull(corners).vertices]
    local = found.point @ turn
    np.testing.assert_allclose(found.gap, gap, atol=1e-12)
    np.testing.assert_allclose(found.normal, np.tile(turn[:, 2], (len(local), 1)), atol=1e-12)
    np.testing.assert_allclose(local[:, 2], 0.5 * gap, atol=1e-12)
    # every corner is a point, or lies beside the hull of the points by no more than a hundredth of the size
    apart = np.linalg.norm(local[:, None, :2] - corners[None], axis=2)
    assert (apart.min(axis=1) < 1e-6).all()
    if len(corners) <= 8:
        assert (apart.min(axis=0) < 1e-6).all()


def centre(one, other):
    """A point inside both polygons: the middle of the largest disk that fits."""
    sides = np.concatenate([ConvexHull(p).equations for p in (one, other)])
    found = linprog([0, 0, -1], A_ub=np.column_stack([sides[:, :2], np.ones(len(sides))]), b_ub=-sides[:, 2],
                    bounds=[(None, None)] * 2 + [(1e-3, None)])  # fmt: skip
    if not found.success:
        # they share too little to be compared
        reject()
    return found.x[:2]


@given(seed=seeds)
def test_overlapping_hulls_keep_their_deepest_point(seed):
    """Whatever the faces share, one row is as deep as the shapes overlap, and none is deeper."""
    rng = np.random.default_rng(seed)
    shapes = [Hull(rng.normal(size=(int(rng.integers(6, 30)), 3))) for _ in range(2)]
    contacts, turns = pair(*shapes), [rotation(rng), rotation(rng)]
    places = [np.zeros(3), rng.uniform(-0.8, 0.8, 3)]
    q = np.concatenate([pose(p, R) for p, R in zip(places, turns, strict=True)])
    world = [np.concatenate([R.T, p[None]]) for p, R in zip(places, turns, strict=True)]
    depth, normal = overlap(shapes[0], world[0], shapes[1], world[1])
    if depth >= 0.0:
        return
    found = contacts.measure(q, np.array([0]), 0.0)
    assert found.gap.min() == pytest.approx(depth, abs=1e-6)
    np.testing.assert_allclose(found.normal[0], normal, atol=2e-3)


@pytest.mark.parametrize("tilt", [1e-3, 1e-2, 0.05])
@pytest.mark.parametrize("heading", [0.2, 0.4, 0.6, 1.0])
def test_of_many_corners_the_sunk_ones_are_kept(tilt, heading):
    """A tilted wheel is sunk with part of its rim: rows above the table must not stand for corners below.

    Eight rows are those of its face: on an arc of 180 degrees with corners anywhere they leave 0.05 of the radius.
    """
    angle = np.sort(np.random.default_rng(2).uniform(0.0, 2.0 * np.pi, 60))
    rim = np.column_stack([np.cos(angle), np.sin(angle)])
    contacts = pair(Box((6.0, 6.0, 1.0)), prism(rim, 0.5))
    turn = pin.exp3(tilt * np.array([np.cos(heading), np.sin(heading), 0.0]))
    q = np.array([*pose(np.zeros(3), np.eye(3)), *pose(np.array([0.0, 0.0, 0.5 + 0.5 * np.sin(tilt)]), turn)])
    found = contacts.contacts(0.0, q, 1e-9)
    corners = np.column_stack([rim, np.zeros(len(rim))]) @ turn.T + q[7:10] - [0.0, 0.0, 0.5]
    sunk = corners[corners[:, 2] < 0.0]
    assert 8 < len(sunk) < 60 and len(found.gap) == 8
    assert found.gap.min() == pytest.approx(sunk[:, 2].min(), abs=1e-9)
    for corner in sunk:
        assert beside(corner[:2], found.point[:, :2]) <= 0.05


@pytest.mark.parametrize("tilt", [0.0, 1e-9, 1e-6])
@pytest.mark.parametrize("shape", [Capsule(0.1, 1.0), Cylinder(0.1, 1.0)], ids=["capsule", "cylinder"])
def test_two_rods_side_by_side_share_a_line(shape, tilt):
    contacts = pair(shape, shape)
    turn = np.array([[1.0, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    q = np.array([*pose(np.zeros(3), np.eye(3)), *pose(np.array([0.2, 0.0, 0.3]), turn)])
    found = contacts.contacts(0.0, q, 1e-5)
    ends = np.sort(found.point[:, 2])
    np.testing.assert_allclose(ends, [-0.2, 0.5], atol=1e-5)
    np.testing.assert_allclose(found.gap, 0.0, atol=1e-6)


def test_polygons_that_only_touch_share_what_they_touch():
    square, room = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]]), np.empty((16, 2))

    def shared(other):
        place, hull = np.array(other, dtype=float), np.empty((2 * len(other), 2))
        m = convex_hull(place, len(place), 1.0, hull)
        k = common_polygon(square, 4, hull, m, 1.0, room, np.empty((16, 2)))
        return set(map(tuple, np.round(room[:k], 6).tolist()))

    assert shared([[1, 0.25], [2, 0.25], [2, 0.75], [1, 0.75]]) == {(1.0, 0.25), (1.0, 0.75)}
    assert shared([[1, 1], [2, 1], [2, 2]]) == {(1.0, 1.0)}
    assert shared([[0.5, -1], [0.5, 3]]) == {(0.5, 0.0), (0.5, 1.0)}
    assert shared([[0.5, 0.5]]) == {(0.5, 0.5)}
    assert not shared([[2, 2], [3, 2], [3, 3]])
    assert shared(square) == set(map(tuple, square.tolist()))


def test_distances_do_not_depend_on_what_was_measured_before(rng):
    """Links of boxes and cylinders far from where they were: the axis of the last time is far from the right one."""
    scene = mbvi.Scene()
    scene.add_urdf(ROBOTS / "arm/arm.urdf", base="fixed")
    scene.add_box((0.3, 0.3, 0.3), position=(0.5, 0.0, 0.2), fixed=True)
    problem = scene.build()
    for _ in range(40):
        q = problem.system.integrate(problem.q0, rng.normal(size=problem.system.nv))
        fresh = scene.build()
        # to the last digit of the largest
        found, expected = problem.constraints.gap(0.0, q), fresh.constraints.gap(0.0, q)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-15)


@pytest.mark.parametrize("seed", range(20))
def test_points_inside_others_change_no_corner(seed):
    rng = np.random.default_rng(seed)
    angles = rng.uniform(0.0, 2.0 * np.pi, int(rng.integers(1, 12)))
    outer = np.column_stack([np.cos(angles), rng.choice([1e-8, 0.1, 1.0]) * np.sin(angles)])
    mixed = rng.dirichlet(np.full(len(outer), 0.3), 60) @ outer
    mixed[:5] = outer[rng.integers(len(outer), size=5)]
    corners = []
    for place in (outer, rng.permutation(np.concatenate([outer, mixed]))):
        room = np.zeros((2 * len(place), 2))
        corners.append(room[: convex_hull(place.copy(), len(place), 1.0, room)])
    # what is outside neither is in the other one
    for one, other in (corners, corners[::-1]):
        for corner in one:
            assert _outside(other, corner) <= 3e-9


def _outside(polygon, point):
    """Return how far a point is outside a convex polygon, a segment or a point."""
    ends = np.roll(polygon, -1, axis=0)
    along = ends - polygon
    part = ((point - polygon) * along).sum(1) / np.maximum((along * along).sum(1), 1e-300)
    nearest = np.linalg.norm(polygon + np.clip(part, 0.0, 1.0)[:, None] * along - point, axis=1).min()
    side = along[:, 0] * (point - polygon)[:, 1] - along[:, 1] * (point - polygon)[:, 0]
    return 0.0 if len(polygon) > 2 and (side >= 0.0).all() else nearest
