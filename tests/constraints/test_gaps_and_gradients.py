"""Gaps and gradients of every kind of constraint: against finite differences, closed forms and Coal itself."""

import tracemalloc
from functools import partial
from itertools import islice

import coal
import numpy as np
import pytest

import mbvi
from mbvi.constraints import HalfSpaceContacts, JointLimits, SignedDistances, SphereCentres, SphereContacts
from mbvi.constraints.families.half_space import few_points_within, points_within
from mbvi.geometry.closed_form.primitive_pairs import NONE
from mbvi.geometry.narrow.pair_distances import distances_from_axes
from mbvi.geometry.narrow.refined_distance import UNIQUE
from mbvi.geometry.narrow.spread import FEW_POINTS
from mbvi.geometry.narrow.support_points import Points, points_below
from mbvi.geometry.shapes.shape_table import indexed
from mbvi.geometry.shapes.shapes import Box, Capsule, Cylinder, Ellipsoid, HalfSpace, Hull, PlacedShape, Sphere
from mbvi.system import FreeBodies, Spheres
from support.kernel_arguments import few_points_within as few_points_arguments
from support.paths import ROBOTS
from support.plain.exits import exit_from
from support.polyhedron_overlap import overlap

TETRAHEDRON = Hull(0.3 * np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1], [0, 0, 0]], dtype=float))
SHAPES = [
    Sphere(0.2),
    Box((0.3, 0.4, 0.2)),
    Ellipsoid((0.3, 0.2, 0.1)),
    Capsule(0.1, 0.4),
    Cylinder(0.15, 0.3),
    TETRAHEDRON,
]
FLAT = [s for s in SHAPES if not s.smooth]


def rotation(rng):
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q *= np.sign(np.diag(r))
    return q * np.sign(np.linalg.det(q))


def bodies(n):
    return FreeBodies(
        np.ones(n), np.tile(np.diag([1.0, 2, 2.5]), (n, 1, 1)), np.zeros(3), tuple(f"b{k}" for k in range(n))
    )


def configuration(rng, positions):
    quaternions = rng.normal(size=(len(positions), 4))
    return np.hstack([positions, quaternions / np.linalg.norm(quaternions, axis=1)[:, None]]).reshape(-1)


def difference_quotient(system, f, q, size=1e-6):
    """Central differences of f along the retraction, shape (m, nv)."""
    columns = []
    for k in range(system.nv):
        step = np.zeros(system.nv)
        step[k] = size
        columns.append((f(system.integrate(q, step)) - f(system.integrate(q, -step))) / (2 * size))
    return np.stack(columns, axis=1)


def placed(shape, body, rng, name="s"):
    return PlacedShape(f"{name}{body}", shape, body, rotation(rng), 0.1 * rng.normal(size=3))


@pytest.mark.parametrize("shape", SHAPES, ids=lambda s: type(s).__name__)
def test_gradient_to_a_half_space(shape, rng):
    system = bodies(1)
    for _ in range(10):
        n = rotation(rng)[0]
        contacts = HalfSpaceContacts(system, [HalfSpace(tuple(n), 0.3)], [placed(shape, 1, rng)], ["pair"], np.zeros(1))
        q = configuration(rng, rng.normal(size=(1, 3)))
        numeric = difference_quotient(system, partial(contacts.gap, 0.0), q)
        np.testing.assert_allclose(contacts.gradient(0.0, q), numeric, atol=1e-7)


@pytest.mark.parametrize("first", SHAPES, ids=lambda s: type(s).__name__)
@pytest.mark.parametrize("second", SHAPES, ids=lambda s: type(s).__name__)
@pytest.mark.parametrize("apart", [1.0, 0.12])
def test_gradient_of_a_signed_distance(first, second, apart, rng):
    system, compared = bodies(2), 0
    for _ in range(6):
        shapes = placed(first, 1, rng), placed(second, 2, rng)
        contacts = SignedDistances(system, *indexed([shapes[0]], [shapes[1]]), np.zeros(1))
        direction = rng.normal(size=3)
        q = configuration(rng, np.array([np.zeros(3), apart * direction / np.linalg.norm(direction)]))
        shift = 1e-6
        numeric = difference_quotient(system, partial(distance_of, contacts), q, shift)
        gradient = contacts.gradient(0.0, q) if apart == 1.0 else nearest_gradient(contacts, system, q)
        # where two features are equally near the distance has a kink; no gradient to compare with
        coarser = difference_quotient(system, partial(distance_of, contacts), q, 10 * shift)
        if np.abs(coarser - numeric).max() < 1e-4:
            np.testing.assert_allclose(gradient, numeric, atol=1e-4)
            compared += 1
    assert compared >= 2


def measured(contacts, q):
    places = contacts.system.placements(q, contacts._axes.bodies)
    if contacts._closed.form[0] != NONE:
        # without the patch
        _, gap, point, normal = contacts._closed.contacts(places, np.array([0]), -np.inf)
        return gap[0], normal[0], point[0]
    return searched(contacts, places)[:3]


def searched(contacts, places):
    """Distance, normal, midpoint and state by the search for two convex shapes."""
    found = np.empty(1), np.empty((1, 3)), np.empty((1, 3)), np.empty(1, np.int64)
    axes = contacts._axes
    distances_from_axes(places, axes.tables, contacts._bound, np.zeros(1, np.int64), axes.axis, np.inf, *found)
    return tuple(part[0] for part in found)


def distance_of(contacts, q):
    return np.array([measured(contacts, q)[0]])


def nearest_gradient(contacts, system, q):
    """The gradient at the nearest points, whatever the patch of two flat faces says."""
    _, normal, middle = measured(contacts, q)
    return system.separation_rows(q, np.array([1]), np.array([2]), middle[None], normal[None])


@pytest.mark.parametrize("robot", ["hopper", "quadruped", "biped", "arm", "double_pendulum"])
def test_gradients_of_a_robot(robot, rng):
    base = "fixed" if robot in ("arm", "double_pendulum") else "free"
    scene = mbvi.Scene()
    scene.add_halfspace((0.1, -0.2, 1), -3.0)
    scene.add_urdf(ROBOTS / robot / f"{robot}.urdf", base=base)
    scene.add_sphere(0.1, position=(3, 0, 0))
    problem = scene.build(reduce=())
    q = problem.system.integrate(problem.q0, 0.3 * rng.normal(size=problem.system.nv))
    checked = 0
    for constraint in problem.constraints.constraints:
        numeric = difference_quotient(problem.system, lambda x, c=constraint: c.gap(0.0, x), q)
        gradient = constraint.gradient(0.0, q)
        smooth = constraint.gap(0.0, q) > 1e-3 if isinstance(constraint, SignedDistances) else slice(None)
        error = np.abs(gradient - numeric)[smooth].max(axis=1, initial=0.0)
        # a nearest point may pass from one vertex to the next within the quotient
        assert np.median(error) < 1e-6
        assert (error < 1e-3).mean() > 0.95
        checked += len(error)
    assert checked > 10


def test_sphere_contacts_equal_coal(rng):
    n = 12
    system = Spheres(np.ones(n), np.zeros(3), tuple(f"s{k}" for k in range(n)))
    radii = rng.uniform(0.05, 0.3, n)
    q = rng.uniform(-0.5, 0.5, 3 * n)
    contacts = SphereContacts(
        system, SphereCentres(0, n, 3), 1, radii, system.bodies[1:], np.zeros(n, dtype=int), np.zeros((1, 1))
    )
    expected = []
    for i in range(n):
        for j in range(i + 1, n):
            poses = [coal.Transform3s(np.eye(3), q[3 * k : 3 * k + 3]) for k in (i, j)]
            a, b = coal.Sphere(radii[i]), coal.Sphere(radii[j])
            expected.append(coal.distance(a, poses[0], b, poses[1], coal.DistanceRequest(), coal.DistanceResult()))
    np.testing.assert_allclose(contacts.gap(0.0, q), expected, atol=1e-12)
    numeric = difference_quotient(system, lambda x: contacts.gap(0.0, x), q)
    np.testing.assert_allclose(contacts.gradient(0.0, q), numeric, atol=1e-7)
    active = contacts.contacts(0.0, q, 1e-9)
    assert active.gap.size == (np.array(expected) <= 1e-9).sum()


def test_joint_limits():
    limits = JointLimits(
        3, np.array([0, 2]), np.array([0, 2]), np.array([-1.0, -np.inf]), np.array([1.0, 0.5]), ["a", "b"]
    )
    assert limits.names == ("a lower limit", "a upper limit", "b upper limit")
    q = np.array([-1.2, 9.0, 0.4])
    np.testing.assert_allclose(limits.gap(0.0, q), [-0.2, 2.2, 0.1])
    np.testing.assert_array_equal(limits.gradient(0.0, q), [[1, 0, 0], [-1, 0, 0], [0, 0, -1]])
    active = limits.contacts(0.0, q, 0.0)
    np.testing.assert_array_equal(active.constraint, [0])
    np.testing.assert_array_equal(active.jacobian, [[1, 0, 0]])


def test_gap_function_gradient_and_shapes():
    f = mbvi.GapFunction(lambda q: q @ q - 1, lambda q: 2 * q, name="outside the disc")
    q = np.array([0.6, 0.9])
    assert f.gap(0.0, q) == pytest.approx([q @ q - 1])
    np.testing.assert_allclose(f.gradient(0.0, q), [2 * q])
    with pytest.raises(mbvi.InputError, match="one number"):
        mbvi.GapFunction(lambda q: q, lambda q: q).gap(0.0, q)


@pytest.mark.parametrize(
    ("shape", "turn", "count"),
    [
        (Box((0.4, 0.3, 0.2)), np.eye(3), 4),
        (Cylinder(0.1, 0.3), np.eye(3), 12),
        (Cylinder(0.1, 0.3), np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), 2),
        (Capsule(0.1, 0.3), np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]), 2),
    ],
)
def test_a_flat_face_on_a_floor_gets_every_point_it_stands_on(shape, turn, count):
    system = bodies(1)
    contacts = HalfSpaceContacts(
        system, [HalfSpace((0.0, 0, 1), 0.0)], [PlacedShape("s", shape, 1, turn, np.zeros(3))], ["pair"], np.zeros(1)
    )
    q = np.array([0.0, 0, 1, 0, 0, 0, 1])
    q[2] -= contacts.gap(0.0, q)[0]
    active = contacts.contacts(0.0, q, 1e-9)
    assert len(np.unique(active.point.round(9), axis=0)) == count
    np.testing.assert_allclose(active.gap, 0, atol=1e-15)


def test_few_points_are_those_that_are_found_among_many():
    answers = set()
    for seed in range(30):
        some, all_ = (few_points_arguments(np.random.default_rng(seed)) for _ in range(2))
        (count, any_empty), expected = few_points_within(*some), points_within(*all_)
        answers.add(count < 0)
        if count < 0:
            found = Points(*some[1])
            assert max(points_below(some[0], found, pair, some[3], 0)[0] for pair in some[2]) > FEW_POINTS
            continue
        assert (count, any_empty) == expected
        np.testing.assert_array_equal(Points(*some[1]).found[:count], Points(*all_[1]).found[:count])
        np.testing.assert_array_equal(some[4], all_[4])
    assert answers == {True, False}


@pytest.mark.parametrize("tilt", [0.0, 1e-4, -1e-4])
@pytest.mark.parametrize("depth", [0.0, 1e-3])
def test_a_box_on_a_box_gets_four_points_each_with_its_own_gap(tilt, depth):
    system = bodies(1)
    below = PlacedShape("below", Box((2.0, 2, 1)), 0, np.eye(3), np.zeros(3))
    above = PlacedShape("above", Box((0.4, 0.4, 0.4)), 1, np.eye(3), np.zeros(3))
    contacts = SignedDistances(system, *indexed([below], [above]), np.zeros(1))
    q = np.array([0.3, 0.2, 0.7 - depth, 0, np.sin(tilt / 2), 0, np.cos(tilt / 2)])
    q[2] -= 0.2 * abs(tilt) * (depth == 0)
    found = contacts.measure(q, np.array([0]), 1e-9)
    assert len(found.gap) == 4
    R = np.array([[np.cos(tilt), 0, np.sin(tilt)], [0, 1, 0], [-np.sin(tilt), 0, np.cos(tilt)]])
    corners = np.array([[x, y, -0.2] for x in (-0.2, 0.2) for y in (-0.2, 0.2)]) @ R.T + q[:3]
    np.testing.assert_allclose(sorted(found.gap), sorted(corners[:, 2] - 0.5), atol=1e-8)
    for point, gap in zip(found.point, found.gap, strict=True):
        nearest = corners[np.argmin(np.linalg.norm((corners - point)[:, :2], axis=1))]
        assert gap == pytest.approx(nearest[2] - 0.5, abs=1e-8)


def test_a_rod_across_the_edge_of_a_table_has_two_points():
    system = bodies(1)
    table = PlacedShape("table", Box((1.0, 1, 1)), 0, np.eye(3), np.zeros(3))
    rod = PlacedShape("rod", Cylinder(0.05, 0.8), 1, np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]]), np.zeros(3))
    contacts = SignedDistances(system, *indexed([table], [rod]), np.zeros(1))
    q = np.array([0.3, 0, 0.55, 0, 0, 0, 1])
    active = contacts.contacts(0.0, q, 1e-7)
    np.testing.assert_allclose(sorted(active.point[:, 0]), [-0.1, 0.5], atol=1e-6)
    np.testing.assert_allclose(active.gap, 0, atol=1e-7)


def test_far_pairs_are_not_asked_and_near_ones_never_missed(rng):
    scene = mbvi.Scene(restitution=0.7)
    scene.add_halfspace((0, 0, 1), 0.0)
    for k in range(3):
        scene.add_box((0.3, 0.2, 0.1), position=(0, 0, 0.5 + k), angular_velocity=rng.normal(size=3) * 5)
    problem, fresh = scene.build(), scene.build()
    pairs = next(c for c in problem.constraints.constraints if isinstance(c, SignedDistances))
    asked, total = [], 0
    ask = pairs._measure_all
    pairs._measure_all = lambda places, due, *rest, **how: asked.append(len(due)) or ask(places, due, *rest, **how)
    for k, step in enumerate(mbvi.steps(problem, mbvi.Paoli(), step=2e-3)):
        fresh.constraints.cache.forget()
        every = fresh.constraints.active(step.t, step.q, problem.tolerance)
        np.testing.assert_array_equal(step.active.constraint, every.constraint)
        np.testing.assert_array_equal(step.active.gap, every.gap)
        total += len(pairs.names)
        if k == 600:
            break
    assert 0 < sum(asked) < 0.3 * total


def test_two_problems_that_share_constraints_do_not_mislead_each_other():
    def ball():
        scene = mbvi.Scene(restitution=0.5)
        scene.add_halfspace((0, 0, 1))
        scene.add_box((0.2, 0.2, 0.2), position=(0, 0, 0.5))
        scene.add_capsule(0.1, 0.2, position=(0.02, 0, 1.0))
        return scene.build()

    first = ball()
    higher = first.q0 + np.array([0, 0, 3.0, 0, 0, 0, 0] * 2)
    second = mbvi.Problem(first.system, first.constraints.constraints, higher, first.v0)
    alone = mbvi.steps(ball(), step=1e-3)
    both = zip(mbvi.steps(first, step=1e-3), mbvi.steps(second, step=1e-3), alone, strict=True)
    for step, _, expected in islice(both, 600):
        np.testing.assert_array_equal(step.q, expected.q)
    assert step.q[2] > 0.05


def test_a_thousand_spheres_are_built_without_listing_their_pairs():
    grid = np.stack(np.meshgrid(*[np.arange(10)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1))
    scene.add_spheres(0.2 + 0.25 * grid, 0.1, 1.0)
    tracemalloc.start()
    assert scene.build().system.nv == 3000
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    # half a million pairs with their gradients would take twelve gigabytes
    assert peak < 3e8


@pytest.mark.parametrize("shape", SHAPES, ids=lambda s: type(s).__name__)
def test_inertia_is_that_of_the_solid(shape, rng):
    inside = rng.uniform(-1, 1, size=(400_000, 3)) * shape.bound
    inside = inside[contains(shape, inside)]
    centre = inside.mean(axis=0)
    about = inside - centre
    numeric = 2.0 * ((about**2).sum(axis=1).mean() * np.eye(3) - about.T @ about / len(about))
    np.testing.assert_allclose(shape.inertia(2.0), numeric, atol=0.02 * np.trace(numeric))
    if isinstance(shape, Hull):
        np.testing.assert_allclose(shape.mass_properties(2.0)[0], centre, atol=3e-3)


def contains(shape, points):
    if isinstance(shape, Sphere):
        return (points**2).sum(axis=1) <= shape.radius**2
    if isinstance(shape, Ellipsoid):
        return ((points / np.array(shape.radii)) ** 2).sum(axis=1) <= 1
    if isinstance(shape, Capsule):
        axial = np.clip(points[:, 2], -shape.length / 2, shape.length / 2)
        return points[:, 0] ** 2 + points[:, 1] ** 2 + (points[:, 2] - axial) ** 2 <= shape.radius**2
    if isinstance(shape, Cylinder):
        return (np.hypot(points[:, 0], points[:, 1]) <= shape.radius) & (np.abs(points[:, 2]) <= shape.length / 2)
    normals, offsets = shape.faces
    return (points @ normals.T <= offsets).all(axis=1)


@pytest.mark.parametrize(
    ("shape", "face"),
    [(FLAT[0], (1, 0, 0)), (FLAT[1], (0, 1, 0)), (FLAT[2], (0, 0, 1)), (FLAT[2], (1, 0, 0)), (FLAT[3], (1, 1, -1))],
)
def test_a_line_across_a_face_leaves_the_shape_where_it_ends(shape, face, rng):
    for _ in range(20):
        direction = np.array(face) + 1e-3 * rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        point = 0.02 * rng.normal(size=3)
        way = exit_from(shape, point[None], direction)[0]
        assert contains(shape, (point + (way - 2e-5) * direction)[None]).all()
        assert not contains(shape, (point + (way + 2e-5) * direction)[None]).any()


@pytest.mark.parametrize("where", [(0.0, 0.0), (0.0, 0.05), (0.28, 0.0)])
def test_a_ball_deep_in_a_cylinder_is_thrown_back_the_short_way(where):
    scene = mbvi.Scene(gravity=(0, 0, 0), restitution=0.5)
    scene.add_cylinder(0.3, 0.4, fixed=True, position=(0, 0, 0))
    # one step takes its centre from above the upper end to 5 mm below
    scene.add_sphere(0.01, position=(*where, 0.2151), velocity=(0, 0, -20))
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=0.01)
    (impact,) = run.impacts
    np.testing.assert_allclose(run.v[-1], [0, 0, 10], atol=1e-12)
    np.testing.assert_allclose(np.abs(impact.normal[0]), [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(run.penetration().max(), 0.0149, atol=1e-9)


def overlapping(seed):
    """Two polyhedra in random poses that overlap, as shapes and as (R', p) stacked."""
    rng = np.random.default_rng(seed)
    shapes = [Box((0.2, 0.3, 0.15)) if rng.random() < 0.5 else Hull(0.2 * rng.normal(size=(12, 3))) for _ in range(2)]
    places = []
    for _ in range(2):
        q, r = np.linalg.qr(rng.normal(size=(3, 3)))
        q *= np.sign(np.diag(r))
        places.append(np.concatenate([q * np.sign(np.linalg.det(q)), rng.uniform(-0.05, 0.05, (1, 3))]))
    return shapes, places


@pytest.mark.parametrize("seed", range(60))
def test_axes_of_faces_and_edges_give_the_depth_that_coal_gives(seed):
    (a, b), places = overlapping(seed)
    distance, normal = overlap(a, places[0], b, places[1])
    result, request = coal.DistanceResult(), coal.DistanceRequest()
    poses = [coal.Transform3s(np.ascontiguousarray(place[:3].T), place[3]) for place in places]
    assert distance < 0.0
    assert distance == pytest.approx(coal.distance(a.coal(), poses[0], b.coal(), poses[1], request, result), abs=1e-6)
    np.testing.assert_allclose(normal, result.normal, atol=1e-4)
    still = [PlacedShape(f"s{k}", s, k + 1, np.eye(3), np.zeros(3)) for k, s in enumerate((a, b))]
    contacts = SignedDistances(bodies(2), *indexed(still[:1], still[1:]), np.zeros(1))
    refined, along, point, state = searched(contacts, np.array(places))
    assert state == UNIQUE
    # the edges of `overlap` are rounded to twelve digits
    assert refined == pytest.approx(distance, abs=1e-11)
    np.testing.assert_allclose(along, normal, atol=1e-9)
    # half the depth from the one's surface, and from the other's
    inside = [(point - place[3]) @ place[:3].T for place in places]
    for shape, place, here, way in zip((a, b), places, inside, (normal, -normal), strict=True):
        assert exit_from(shape, here[None], place[:3] @ way)[0] == pytest.approx(-0.5 * distance, abs=1e-9)


def separation_of_boxes(size, pose):
    """Signed distance of two boxes that overlap, by the axes of faces and of crossing edges; exact below zero."""
    (Ra, a), (Rb, b) = pose
    axes = [*Ra.T, *Rb.T, *(np.cross(x, y) for x in Ra.T for y in Rb.T)]
    lengths = np.linalg.norm(axes, axis=1)
    axes = np.array([axis / length for axis, length in zip(axes, lengths, strict=True) if length > 1e-6])
    half = 0.5 * np.array(size)
    return float((np.abs(axes @ (b - a)) - np.abs(axes @ Ra) @ half - np.abs(axes @ Rb) @ half).max())


@pytest.mark.parametrize("seed", range(300))
def test_the_deepest_contact_of_two_boxes_is_their_depth(seed):
    """Corners, faces, and edges that cross: none of the corners that two faces share may be as deep as these."""
    rng = np.random.default_rng(seed)
    size, sides = (0.2, 0.3, 0.15), []
    for _ in range(2):
        q, r = np.linalg.qr(rng.normal(size=(3, 3)))
        q *= np.sign(np.diag(r))
        sides.append(q * np.sign(np.linalg.det(q)))
    way = rng.normal(size=3)
    way /= np.linalg.norm(way)
    # to where they overlap by a few millimetres
    far = 0.5
    for _ in range(60):
        far -= separation_of_boxes(size, ((sides[0], np.zeros(3)), (sides[1], far * way)))
        depth = separation_of_boxes(size, ((sides[0], np.zeros(3)), (sides[1], far * way)))
        if abs(depth) < 1e-12:
            break
    far -= rng.uniform(1e-5, 5e-3)
    depth = separation_of_boxes(size, ((sides[0], np.zeros(3)), (sides[1], far * way)))
    scene = mbvi.Scene()
    scene.add_box(size, rotation=sides[0])
    scene.add_box(size, rotation=sides[1], position=(far + 1.0) * way)
    problem = scene.build()
    q = problem.q0.copy()
    q[7:10] = far * way
    rows = problem.constraints.active(0.0, q, 1e-8)
    assert rows.gap.min() == pytest.approx(depth, abs=1e-8)
