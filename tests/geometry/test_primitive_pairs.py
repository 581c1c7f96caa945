"""Closed forms of boxes, capsules, spheres and cylinders: certified, and equal to Coal and to the general search.

A signed distance is certified from both sides. The separation along the reported normal, by support functions alone, is
at most the distance. Of shapes apart, the points half the gap along the normal belong to both, so that the distance is
at most the gap. Of boxes that overlap, `overlap` tries every axis.
"""

import coal
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mbvi.geometry.broad.separating_axis import SeparatingAxes
from mbvi.geometry.closed_form.primitive_pairs import BOXES, FIRST_BALL, NONE, SECOND_BALL, PrimitivePairs
from mbvi.geometry.narrow.refined_distance import FAILED
from mbvi.geometry.shapes.shape_table import ShapeTable
from mbvi.geometry.shapes.shapes import Box, Capsule, Cylinder, Ellipsoid, Hull, PlacedShape, Sphere
from support.distance_kernel_arguments import refined, separated
from support.polyhedron_overlap import overlap

KINDS = {
    "box": lambda r: Box((r(), r(), r())),
    "capsule": lambda r: Capsule(r(), r()),
    "sphere": lambda r: Sphere(r()),
    "cylinder": lambda r: Cylinder(r(), r()),
}
PAIRS = [
    (a, b) for a in KINDS for b in KINDS
    if "cylinder" not in (a, b) or (a != b and "sphere" in (a, b))
]  # fmt: skip
every_pair = pytest.mark.parametrize(("first", "second"), PAIRS)
WAYS = ["random", "touching", "turned", "parallel edges", "deep"]
FLAT = np.eye(3), np.zeros(3)


class Measured:
    """The contacts of many pairs: shapes a[k] at A[k] = (rotation, origin) and b[k] at B[k]."""

    def __init__(self, poses, tolerance=-np.inf):
        self.poses = poses
        shapes = [s for a, b, _, _ in poses for s in (a, b)]
        placed = [PlacedShape(f"{k}", s, k + 1, np.eye(3), np.zeros(3)) for k, s in enumerate(shapes)]
        self.sides = np.arange(len(shapes)).reshape(-1, 2)
        table = ShapeTable(placed)
        self.axes = SeparatingAxes(table, self.sides)
        self.places = np.array([np.vstack([R.T, x]) for _, _, *both in poses for R, x in both])
        self.pairs = PrimitivePairs(table, self.sides)
        self.pair, self.gap, self.point, self.normal = self.measure(tolerance)

    def measure(self, tolerance):
        return self.pairs.contacts(self.places, np.arange(len(self.poses)), tolerance)

    def rows(self, k):
        """Gaps, points and normals of one pair."""
        chosen = self.pair == k
        return self.gap[chosen], self.point[chosen], self.normal[chosen]

    def deepest(self, k):
        gap, _, normal = self.rows(k)
        return gap.min(), normal[gap.argmin()]

    def separation(self, k, normal):
        return separated(self.axes, self.places, k, normal)

    def searched(self, k, start):
        """The signed distance that the general search finds from a direction."""
        normal = start / np.linalg.norm(start)
        result, distance, _ = refined(self.axes, self.places, k, normal)
        return -np.inf if result == FAILED else distance


def unit(rng):
    n = rng.normal(size=3)
    return n / np.linalg.norm(n)


def rotation(rng):
    return Rotation.random(random_state=rng).as_matrix()


def reach(shape):
    """Half of the extent of a shape along each of its axes."""
    if isinstance(shape, Box):
        return 0.5 * np.array(shape.size)
    top = {Sphere: lambda s: s.radius, Capsule: lambda s: s.bound, Cylinder: lambda s: 0.5 * s.length}
    return np.array([shape.radius, shape.radius, top[type(shape)](shape)])


def pose(way, first, second, rng):
    """Two shapes of 1e-4 to 1e3 m, now and then of an aspect ratio up to 1e3, and where they are."""
    scale, aspect = 10.0 ** rng.uniform(-4, 3), rng.choice([0.5, 3.0])
    a, b = (KINDS[kind](lambda: scale * 10.0 ** rng.uniform(-aspect, 0.0)) for kind in (first, second))
    R, x, k = rotation(rng), scale * rng.choice([0.0, 1.0, 10.0]) * unit(rng), rng.integers(3)
    far, turn = a.bound + b.bound, np.eye(3)
    if way == "random":
        return a, b, (R, x), (rotation(rng), x + rng.uniform(0.0, 1.2) * far * unit(rng))
    if way == "deep":
        turn = rotation(rng) if rng.random() < 0.5 else turn
        return a, b, (R, x), (R @ turn, x + rng.choice([0.0, 1e-9, 0.1]) * min(a.bound, b.bound) * unit(rng))
    if way == "parallel edges":
        turn = Rotation.from_rotvec(0.25 * np.pi * rng.integers(1, 4) * np.eye(3)[k]).as_matrix()
        along = rng.choice([-1.0, 0.0, 1.0], size=3)
        return a, b, (R, x), (R @ turn, x + R @ along * rng.uniform(0.0, 0.8) * far)
    # faces at one height, exactly, to rounding, or nearly; the second is turned about an edge or any other direction
    shift = (reach(a) + reach(b)) * rng.uniform(-1.0, 1.0, 3) * rng.choice([1.0, 0.5, 0.0], size=3)
    shift[k] = (reach(a) + reach(b))[k] * rng.choice([1.0, 1.0 - 1e-12, 1.0 + 1e-9, 0.9, 1.01])
    if way == "turned":
        axis = np.eye(3)[rng.integers(3)] if rng.random() < 0.5 else unit(rng)
        turn = Rotation.from_rotvec(axis * 10.0 ** rng.uniform(-8, -3)).as_matrix()
    return a, b, (R, x), (R @ turn, x + R @ shift)


def poses(first, second, count, seed, ways=WAYS):
    rng = np.random.default_rng(seed)
    return [pose(way, first, second, rng) for way in ways for _ in range(count)]


def outside(shape, where, point):
    """The distance of a point in the world from a shape."""
    local = (point - where[1]) @ where[0]
    if isinstance(shape, Cylinder):
        across = np.hypot(local[0], local[1]) - shape.radius
        return float(np.hypot(max(across, 0.0), max(abs(local[2]) - 0.5 * shape.length, 0.0)))
    core = 0.5 * np.array(shape.size) if isinstance(shape, Box) else reach(shape) - shape.radius
    radius = 0.0 if isinstance(shape, Box) else shape.radius
    return max(float(np.linalg.norm(np.maximum(np.abs(local) - core, 0.0))) - radius, 0.0)


@every_pair
@pytest.mark.parametrize("tolerance", [-np.inf, np.inf])
def test_the_distance_is_certified(first, second, tolerance):
    """The referees are support functions, the shapes' own points, the search from other starts, and all axes."""
    found, rng = Measured(poses(first, second, 40, 1), tolerance), np.random.default_rng(2)
    for k, (a, b, A, B) in enumerate(found.poses):
        size, (gap, point, normal) = min(a.bound, b.bound), found.rows(k)
        distance, n = found.deepest(k)
        np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1.0, rtol=0, atol=1e-14)
        # a face normal is preferred to one along which the separation is larger by 1e-8 of the size
        within = 1e-10 if tolerance < 0.0 else 1.001e-8
        assert found.separation(k, n) == pytest.approx(distance, abs=within * size)
        for i in range(len(gap)):
            half, near = 0.5 * gap[i] * normal[i], (1e-10 if tolerance < 0.0 else 1e-6) * size
            assert outside(a, A, point[i] - half) < near
            assert outside(b, B, point[i] + half) < near
        for start in (n, unit(rng), B[1] - A[1] + 1e-3 * size * unit(rng)):
            assert found.searched(k, start) <= distance + 1e-10 * size
        if first == second == "box" and distance < 0.0:
            exact, _ = overlap(a, found.places[2 * k], b, found.places[2 * k + 1])
            assert distance == pytest.approx(exact, abs=1e-10 * size)


def coal_distance(a, b, A, B, accuracy):
    """Coal's signed distance and normal, in the unit of the smaller shape."""
    unit_of_length = 2.0 ** np.frexp(min(a.bound, b.bound))[1]
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    request.gjk_tolerance = request.epa_tolerance = accuracy
    where = [coal.Transform3s(R, x / unit_of_length) for R, x in (A, B)]
    shapes = a.coal(unit_of_length), b.coal(unit_of_length)
    return coal.distance(shapes[0], where[0], shapes[1], where[1], request, result) * unit_of_length, result.normal


def check_against_coal(first, second, count, seed):
    """Distances within 1e-7 of the size and normals within 1e-5.

    Coal's tolerances are absolute and its penetration depths now and then wrong: where they differ the referees are the
    separations along both normals. That of a true normal is the distance, that of any other is less.
    """
    found, agreed = Measured(poses(first, second, count, seed)), 0
    for k, (a, b, A, B) in enumerate(found.poses):
        size, (distance, n) = min(a.bound, b.bound), found.deepest(k)
        candidates = [coal_distance(a, b, A, B, accuracy) for accuracy in (1e-9, 1e-6)]
        expected, normal = min(candidates, key=lambda both: abs(both[0] - distance))
        if not abs(np.linalg.norm(normal) - 1.0) < 1e-6:
            # now and then Coal finds no normal
            continue
        if not abs(distance - expected) <= 1e-7 * size:
            assert not found.separation(k, normal) > distance + 1e-10 * size
        elif np.linalg.norm(np.cross(n, normal)) > 1e-5 or n @ normal < 0.0:
            along = found.separation(k, normal)
            # Coal's normal separates less, or both are normals
            assert along <= distance + 1e-10 * size
        else:
            agreed += 1
    return agreed / len(found.poses)


@every_pair
def test_it_equals_coal(first, second):
    assert check_against_coal(first, second, 60, 3) > 0.4


@pytest.mark.slow
@every_pair
def test_it_equals_coal_on_thousands_of_poses(first, second):
    assert check_against_coal(first, second, 1000, 4) > 0.4


@every_pair
def test_normals_of_shapes_well_apart_or_overlapping_are_those_of_coal(first, second):
    """Where the normal is unique: at random poses."""
    found, compared = Measured(poses(first, second, 200, 5, ["random"])), 0
    for k, (a, b, A, B) in enumerate(found.poses):
        size, (distance, n) = min(a.bound, b.bound), found.deepest(k)
        expected, normal = coal_distance(a, b, A, B, 1e-9)
        if abs(distance) > 1e-2 * size and abs(distance - expected) < 1e-9 * size:
            compared += 1
            assert np.linalg.norm(n - normal) < 1e-5
    assert compared > 60


@every_pair
def test_exchanged_shapes_have_opposite_normals(first, second):
    one = Measured(poses(first, second, 20, 6))
    other = Measured([(b, a, B, A) for a, b, A, B in one.poses])
    for k, (a, b, _, _) in enumerate(one.poses):
        size, (distance, n), (again, m) = min(a.bound, b.bound), one.deepest(k), other.deepest(k)
        assert again == pytest.approx(distance, abs=1e-10 * size)
        # of two normals that separate equally the first shape's is taken
        if np.linalg.norm(n + m) > 1e-7:
            assert one.separation(k, -m) == pytest.approx(distance, abs=1e-10 * size)


@given(seed=st.integers(0, 10_000), exponent=st.integers(-14, 10))
def test_lengths_of_a_power_of_two_give_the_same_bytes(seed, exponent):
    rng = np.random.default_rng(seed)
    first, second = PAIRS[rng.integers(len(PAIRS))]
    found = Measured(poses(first, second, 1, seed), np.inf)
    s, again = 2.0**exponent, Measured(found.poses, np.inf)
    _, fixed, sizes = again.axes.shapes[:3]
    again.pairs._fixed, again.pairs._sizes = fixed * np.array([1.0, 1.0, 1.0, s])[:, None], s * sizes
    again.places = again.places * np.array([1.0, 1.0, 1.0, s])[:, None]
    pair, gap, point, normal = again.measure(np.inf)
    np.testing.assert_array_equal(pair, found.pair)
    np.testing.assert_array_equal(gap, s * found.gap)
    np.testing.assert_array_equal(point, s * found.point)
    np.testing.assert_array_equal(normal, found.normal)


@every_pair
def test_the_patch_has_the_deepest_point_and_no_gap_below_it(first, second):
    rows = poses(first, second, 40, 7)
    nearest, patches = Measured(rows), Measured(rows, np.inf)
    for k in range(len(rows)):
        gap = patches.rows(k)[0]
        assert gap.min() == nearest.rows(k)[0].min()
        assert len(gap) <= (9 if first == second == "box" else 3)
        assert len(nearest.rows(k)[0]) == 1


def one(a, b, A, B, tolerance=1e-8):
    """Gaps, points and normals of one pair, sorted by x, then y."""
    found = Measured([(a, b, A, B)], tolerance)
    gap, point, normal = found.rows(0)
    order = np.lexsort(np.round(point.T[::-1], 9))
    return gap[order], point[order], normal[order]


def about(axis, angle):
    return Rotation.from_rotvec(angle * np.eye(3)["xyz".index(axis)]).as_matrix()


def test_patches_of_parallel_faces():
    wide, up = Box((2.0, 2.0, 1.0)), [0.0, 0.0, 1.0]
    small, aside = Box((1.0, 0.6, 0.4)), about("y", 0.5 * np.pi)
    cases = [
        # within the face, across its corner, turned within it
        (small, (np.eye(3), np.array([0.2, 0.1, 0.69])), [[-0.3, -0.2], [-0.3, 0.4], [0.7, -0.2], [0.7, 0.4]]),
        (small, (np.eye(3), np.array([1.0, 1.0, 0.69])), [[0.5, 0.7], [0.5, 1.0], [1.0, 0.7], [1.0, 1.0]]),
        (Box((0.4, 1.0, 0.6)), (aside, np.array([0, 0, 0.69])), [[-0.3, -0.5], [-0.3, 0.5], [0.3, -0.5], [0.3, 0.5]]),
    ]
    for box, where, corners in cases:
        gap, point, normal = one(wide, box, FLAT, where)
        np.testing.assert_allclose(gap, -0.01, atol=1e-15)
        np.testing.assert_allclose(point, [[*c, 0.495] for c in corners], atol=1e-15)
        np.testing.assert_array_equal(normal, [up] * 4)


def test_two_squares_turned_by_45_degrees_share_an_octagon():
    cube = Box((2.0, 2.0, 2.0))
    gap, point, normal = one(cube, cube, FLAT, (about("z", 0.25 * np.pi), np.array([0.0, 0.0, 2.0])))
    at = np.sqrt(2.0) - 1.0
    expected = [[s * x, t * y, 1.0] for x, y in ((1.0, at), (at, 1.0)) for s in (-1, 1) for t in (-1, 1)]
    np.testing.assert_allclose(gap, 0.0, atol=1e-15)
    np.testing.assert_allclose(point, sorted(expected), atol=1e-15)
    np.testing.assert_array_equal(normal, [[0.0, 0.0, 1.0]] * 8)


def test_a_tilted_box_has_a_gap_at_each_corner():
    """The gap of a corner is its height over the face, up to 0.02 of the size above the deepest."""
    wide, box = Box((4.0, 4.0, 1.0)), Box((1.0, 1.0, 1.0))
    tilt = about("y", 1e-3)
    low = 0.5 * (np.cos(1e-3) + np.sin(1e-3))
    gap, point, _ = one(wide, box, FLAT, (tilt, np.array([0.0, 0.0, 0.5 + low])))
    np.testing.assert_allclose(sorted(gap), [0.0, 0.0, np.sin(1e-3), np.sin(1e-3)], atol=1e-15)
    assert len(one(wide, box, FLAT, (about("y", 0.1), np.array([0.0, 0.0, 1.0])))[0]) == 2
    assert point[:, 2].min() >= 0.5 - 1e-15


def test_crossed_edges_give_their_crossing():
    box, root = Box((2.0, 2.0, 2.0)), np.sqrt(2.0)
    below, above = about("y", 0.25 * np.pi), about("x", 0.25 * np.pi)
    gap, point, normal = one(box, box, (below, np.zeros(3)), (above, np.array([0.3, 0.2, 2.0 * root - 0.01])))
    np.testing.assert_allclose(gap, [-0.01], atol=1e-15)
    np.testing.assert_allclose(point, [[0.0, 0.2, root - 0.005]], atol=1e-14)
    np.testing.assert_allclose(normal, [[0.0, 0.0, 1.0]], atol=1e-15)


def test_a_capsule_on_a_face_stands_on_the_ends_of_its_shadow():
    box, lying = Box((2.0, 2.0, 2.0)), about("y", 0.5 * np.pi)
    for x, ends in ((0.3, [-0.2, 0.8]), (0.8, [0.3, 1.0])):
        gap, point, normal = one(box, Capsule(0.1, 1.0), FLAT, (lying, np.array([x, 0.2, 1.1])))
        np.testing.assert_allclose(gap, 0.0, atol=1e-15)
        np.testing.assert_allclose(point, [[end, 0.2, 1.0] for end in ends], atol=1e-15)
        np.testing.assert_array_equal(normal, [[0.0, 0.0, 1.0]] * 2)
    # on its end, and a sphere: one point
    gap, point, _ = one(Capsule(0.1, 1.0), box, (np.eye(3), np.array([0.3, 0.2, 1.6])), FLAT)
    np.testing.assert_allclose((gap[0], *point[0]), (0.0, 0.3, 0.2, 1.0), atol=1e-15)
    assert len(gap) == len(one(box, Sphere(0.1), FLAT, (np.eye(3), np.array([0.3, 0.2, 1.1])))[0]) == 1


def test_capsules_on_each_other():
    first, second = Capsule(0.2, 1.0), Capsule(0.1, 1.0)
    lying = about("y", 0.5 * np.pi)
    gap, point, normal = one(first, second, (lying, np.zeros(3)), (lying, np.array([0.4, 0.0, 0.29])))
    np.testing.assert_allclose(gap, -0.01, atol=1e-15)
    np.testing.assert_allclose(point, [[-0.1, 0.0, 0.195], [0.5, 0.0, 0.195]], atol=1e-14)
    np.testing.assert_allclose(normal, [[0.0, 0.0, 1.0]] * 2, atol=1e-15)
    # crossed, and with their axes on one line, apart and overlapping
    gap, point, _ = one(first, second, (lying, np.zeros(3)), (about("x", 0.5 * np.pi), np.array([0.0, 0.0, 0.29])))
    np.testing.assert_allclose((gap[0], *point[0]), (-0.01, 0.0, 0.0, 0.195), atol=1e-15)
    gap, point, normal = one(first, second, (lying, np.zeros(3)), (lying, np.array([1.5, 0.0, 0.0])), np.inf)
    np.testing.assert_allclose((gap.min(), *point[0], *normal[0]), (0.2, 0.8, 0, 0, 1, 0, 0), atol=1e-15)
    gap, _, normal = one(first, second, (lying, np.zeros(3)), (lying, np.array([0.3, 0.0, 0.0])))
    np.testing.assert_allclose(gap, -0.3, atol=1e-15)
    np.testing.assert_allclose(normal[:, 0], 0.0, atol=1e-15)


def test_spheres():
    ball, corner = Sphere(0.5), np.array([2.0, 3.0, 6.0]) / 7.0
    cases = [
        (Sphere(0.2), np.array([0.0, 0.0, 0.6]), -0.1, [0.0, 0.0, 1.0]),
        (Capsule(0.2, 1.0), np.array([0.6, 0.0, 0.3]), -0.1, [1.0, 0.0, 0.0]),
        (Box((2.0, 2.0, 2.0)), 1.0 + 0.7 * corner, 0.2, corner),
        # the centre in a box, in a cylinder beside its axis, and above the rim
        (Box((2.0, 2.0, 2.0)), np.array([0.1, 0.7, 0.2]), -0.8, [0.0, 1.0, 0.0]),
        (Cylinder(1.0, 4.0), np.array([0.0, 0.8, 0.5]), -0.7, [0.0, 1.0, 0.0]),
        (Cylinder(1.0, 4.0), np.array([0.0, 1.3, 2.4]), 0.0, [0.0, 0.6, 0.8]),
    ]
    for shape, centre, distance, normal in cases:
        for shapes in ((shape, ball), (ball, shape)):
            sign, swapped = (1.0, False) if shapes[1] is ball else (-1.0, True)
            places = [FLAT, (np.eye(3), centre)]
            gap, point, n = one(*shapes, *(places[::-1] if swapped else places), np.inf)
            np.testing.assert_allclose(gap, [distance], atol=1e-15)
            np.testing.assert_allclose(n, [sign * np.array(normal)], atol=1e-15)
            np.testing.assert_allclose(point[0], centre - (0.5 + 0.5 * distance) * np.array(normal), atol=1e-15)


@every_pair
def test_shapes_about_one_centre_have_a_normal(first, second):
    """Where no normal is unique one of those that separate most is returned."""
    a, b = (KINDS[kind](lambda: 0.3) for kind in (first, second))
    found = Measured([(a, b, FLAT, FLAT), (a, b, FLAT, (about("x", 1.0), np.zeros(3)))], np.inf)
    for k in range(2):
        distance, n = found.deepest(k)
        assert found.separation(k, n) == pytest.approx(distance, abs=1e-15)
        assert max(found.separation(k, unit(np.random.default_rng(s))) for s in range(200)) <= distance


def test_of_two_nearly_parallel_faces_the_first_shape_gives_the_normal():
    """Until it is off by more than 1e-8, whatever was measured before."""
    wide, box = Box((4.0, 4.0, 1.0)), Box((1.0, 1.0, 1.0))

    def at(tilt):
        # the lowest edge of the second shape is at the height of the first one's face, but beyond its end
        low = 0.5 * (np.cos(tilt) + abs(np.sin(tilt)))
        return np.vstack([about("y", tilt).T, [1.9, 0.0, 0.5 + low]])

    found = Measured([(wide, box, FLAT, (np.eye(3), at(0.0)[3]))], 1e-3)
    for tilt, side in ((1e-9, 1), (1e-6, 2), (1e-9, 1), (1e-4, 2), (0.0, 1)):
        found.places[1] = at(tilt)
        normal = found.measure(1e-3)[3]
        face = np.array([0.0, 0.0, 1.0]) if side == 1 else found.places[1, 2]
        np.testing.assert_array_equal(normal, [face] * len(normal))


def test_many_contacts_find_room():
    cube = Box((2.0, 2.0, 2.0))
    turned = about("z", 0.25 * np.pi), np.array([0.0, 0.0, 2.0])
    found = Measured([(cube, cube, FLAT, turned)] * 50, 1e-8)
    assert np.bincount(found.pair).tolist() == [8] * 50
    np.testing.assert_array_equal(found.point[:8], found.point[-8:])


def test_shapes_of_the_world_and_on_bodies(rng):
    """A shape's placement on its body counts, and the world's bodies stand at the origin."""
    a, b, where = Box((1.0, 2.0, 3.0)), Capsule(0.2, 1.0), (rotation(rng), rng.normal(size=3))
    on_body = rotation(rng), rng.normal(size=3)
    placed = [PlacedShape("a", a, 0, *where), PlacedShape("b", b, 1, *on_body)]
    sides, body = np.array([[0, 1], [1, 0]]), (rotation(rng), rng.normal(size=3))
    pairs = PrimitivePairs(ShapeTable(placed), sides)
    pair, gap, point, normal = pairs.contacts(np.array([np.vstack([body[0].T, body[1]])]), np.array([0, 1]), -np.inf)
    expected = Measured([(a, b, where, (body[0] @ on_body[0], body[0] @ on_body[1] + body[1]))])
    assert pair.tolist() == [0, 1]
    np.testing.assert_allclose(gap, expected.gap[[0, 0]], atol=1e-14)
    np.testing.assert_allclose(point, expected.point[[0, 0]], atol=1e-14)
    np.testing.assert_allclose(normal, [expected.normal[0], -expected.normal[0]], atol=1e-14)


def test_which_pairs_have_a_closed_form():
    shapes = [
        Sphere(1.0), Capsule(1.0, 0.0), Capsule(1.0, 1.0), Box((1.0, 1.0, 1.0)), Cylinder(1.0, 1.0),
        Ellipsoid((1.0, 2.0, 3.0)), Hull(np.vstack([np.eye(3), np.zeros((1, 3))])),
    ]  # fmt: skip
    placed = [PlacedShape(f"{k}", s, k + 1, np.eye(3), np.zeros(3)) for k, s in enumerate(shapes)]
    sides = np.array([(a, b) for a in range(7) for b in range(7)])
    pairs = PrimitivePairs(ShapeTable(placed), sides)
    expected = np.full((7, 7), NONE)
    expected[2:4, 2:4] = BOXES
    expected[:5, :2], expected[:2, :5] = SECOND_BALL, FIRST_BALL
    np.testing.assert_array_equal(pairs.form.reshape(7, 7), expected)
    expected[:], expected[:3, :3], expected[2, 2] = False, True, False
    np.testing.assert_array_equal(pairs.smooth.reshape(7, 7), expected)


@every_pair
def test_a_placement_that_is_no_number_gives_none(first, second):
    a, b = (KINDS[kind](lambda: 0.3) for kind in (first, second))
    for wrong in ((np.full((3, 3), np.nan), np.zeros(3)), (np.eye(3), np.array([0.0, np.nan, 0.0]))):
        gap, _, _ = Measured([(a, b, FLAT, wrong)], np.inf).rows(0)
        assert np.isnan(gap).all()
