"""Boxes, hulls and capsules on triangle meshes: rows of the features that touch, and motion without inner edges."""

import coal
import numpy as np
import pytest
from scipy.spatial import ConvexHull, Delaunay

import mbvi
from mbvi.constraints import ShapeSurface
from mbvi.geometry.at_meshes.cores_at_mesh import ON_IT, free_way, place_feature, travel_from, write_place
from mbvi.geometry.at_meshes.feature_clearance import clearance_of_feature, rim_clearance
from mbvi.geometry.at_meshes.surface_rows import sharp_row, vertex_row

SCHEMES = [mbvi.Paoli(), mbvi.Centered(), mbvi.StewartTrinkle()]
CORNERS = 0.5 * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
UPRIGHT = np.eye(3)


def about(axis, angle):
    """A rotation about x, y or z."""
    c, s, i = np.cos(angle), np.sin(angle), "xyz".index(axis)
    turn = np.eye(3)
    j, k = (i + 1) % 3, (i + 2) % 3
    turn[j, j] = turn[k, k] = c
    turn[k, j], turn[j, k] = s, -s
    return turn


def tiled_plane(seed, points=300, half=8.0):
    """A square whose triangles are drawn at random, with normals along z."""
    rng = np.random.default_rng(seed)
    corners = half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    place = np.concatenate([rng.uniform(-half, half, (points, 2)), corners])
    corner = Delaunay(place).simplices
    a, b, c = (place[corner[:, k]] for k in range(3))
    turn = np.linalg.det(np.stack([b - a, c - a], axis=1))
    corner = np.where(turn[:, None] > 0.0, corner, corner[:, ::-1])
    return np.column_stack([place, np.zeros(len(place))]), corner


def extruded(profile, half=2.0, cuts=2):
    """A mesh over a profile of points (x, z), along y, cut into strips."""
    profile = np.asarray(profile, dtype=float)
    n, lines = len(profile), np.linspace(-half, half, cuts)
    vertices = np.concatenate([np.column_stack([profile[:, 0], np.full(n, y), profile[:, 1]]) for y in lines])
    corner = [
        part + s * n
        for s in range(cuts - 1)
        for i in range(n - 1)
        for part in (np.array([i, i + 1, n + i + 1]), np.array([i, n + i + 1, n + i]))
    ]
    return vertices, np.array(corner)


ROOF = extruded([(-1, -1), (0, 0), (1, -1)])
VALLEY = extruded([(-1, 1), (0, 0), (1, 1)])
STEP = extruded([(-1, 0), (0, 0), (0, -0.5), (1, -0.5)])
TRENCH = extruded([(-1, 0), (0, 0), (0, -0.5), (0.05, -0.5), (0.05, 0), (3, 0)])
_BASE = [[-0.05, -0.05, -0.1], [0.05, -0.05, -0.1], [0.05, 0.05, -0.1], [-0.05, 0.05, -0.1]]
PYRAMID = np.array([*_BASE, [0.0, 0.0, 0.0]]), np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])


def rough_field(rng, n=18, d=0.1):
    """Drawn heights over a square grid."""
    line = (np.arange(n) - 0.5 * (n - 1)) * d
    x, y = np.meshgrid(line, line)
    height = 0.05 * np.sin(3 * x) * np.cos(2.5 * y) + rng.uniform(0.002, 0.03) * rng.standard_normal((n, n))
    number = np.arange(n * n).reshape(n, n)
    a, b, c, e = (part.ravel() for part in (number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]))
    corner = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, e])])
    return np.column_stack([x.ravel(), y.ravel(), height.ravel()]), corner


def scene_of(kind, position, rotation=UPRIGHT, velocity=(0, 0, 0), mesh=None, size=(0.2, 0.15, 0.1), **settings):
    scene = mbvi.Scene(restitution=settings.pop("restitution", 0.0), **settings)
    given = {"mass": 1.0, "position": position, "rotation": rotation, "velocity": velocity, "name": "body"}
    if mesh is not None:
        scene.add_surface(*mesh, name="ground")
    if kind == "box":
        scene.add_box(size, **given)
    elif kind == "capsule":
        # lying along x
        scene.add_capsule(0.05, 0.3, **{**given, "rotation": rotation @ about("y", 0.5 * np.pi)})
    elif kind == "cylinder":
        # standing
        scene.add_cylinder(0.08, 0.1, **given)
    elif kind == "wheel":
        # lying along y
        scene.add_cylinder(0.05, 0.06, **{**given, "rotation": rotation @ about("x", 0.5 * np.pi)})
    else:
        # a prism of six sides on one of them, 0.05 above its lowest points
        angles = np.pi / 3 * np.arange(6)
        ring = 0.1 / np.sqrt(3) * np.column_stack([np.cos(angles), np.sin(angles)])
        points = np.concatenate([np.column_stack([np.full(6, x), ring]) for x in (-0.1, 0.1)])
        scene.add_convex(points, [position], mass=1.0, rotations=[rotation], velocities=[velocity], name="body")
    return scene


def surface_of(problem):
    return next(f for f in problem.constraints.families if isinstance(f, ShapeSurface))


def nothing_placed(at):
    return np.zeros((2, max(len(at.points), len(at.faces))), bool)


def rows_of(problem, tolerance=1e-9):
    return surface_of(problem).contacts(0.0, problem.q0, tolerance)


def same_points(found, expected):
    order = np.lexsort(np.round(found, 9).T)
    other = np.lexsort(np.round(expected, 9).T)
    np.testing.assert_allclose(found[order], np.asarray(expected)[other], rtol=0, atol=1e-12)


@pytest.mark.parametrize("kind", ["box", "capsule", "hull"])
def test_rows_do_not_depend_on_the_ways_that_led_to_a_place(kind):
    """Features are listed now and then only; what touches is the same as if they were listed anew."""
    rng, touched, kept = np.random.default_rng(0), 0, 0
    for _ in range(10):
        problem = scene_of(kind, (0, 0, 1), mesh=rough_field(rng), size=(0.3, 0.2, 0.1)).build()
        family = surface_of(problem)
        q = problem.q0.copy()
        q[2] = 0.12
        for k in range(60):
            # it creeps, and leaps now and then
            size = 1e-3 if k % 10 else rng.choice([0.02, 0.1])
            q = problem.system.integrate(q, size * rng.normal(size=6) * [1, 1, 0.3, 3, 3, 3])
            for tolerance in (1e-9, 3e-3):
                listed = family.at_mesh.place.copy()
                found = family.measure(q, np.arange(1), tolerance)
                kept += np.array_equal(listed, family.at_mesh.place)
                family.at_mesh.slack[:] = -1.0
                anew = family.measure(q, np.arange(1), tolerance)
                for one, other in zip(found, anew, strict=True):
                    np.testing.assert_array_equal(one, other)
                touched += len(found.gap)
                # the list goes on from an older place
                if k % 3:
                    family.at_mesh.slack[:] = -1.0
                    family.measure(problem.system.integrate(q, 1e-3 * rng.normal(size=6)), np.arange(1), tolerance)
    assert touched > 300
    assert kept > 300


@pytest.mark.parametrize("kind", ["box", "hull", "cylinder"])
def test_rows_are_the_same_where_features_that_touch_nothing_are_skipped(kind):
    rng, touched, skipped, listed = np.random.default_rng(1), 0, 0, 0
    for _ in range(6):
        field = rough_field(rng)
        problem, twin = (scene_of(kind, (0, 0, 1), mesh=field, size=(0.3, 0.2, 0.1)).build() for _ in range(2))
        kept, anew = surface_of(problem), surface_of(twin)
        q, step = problem.q0.copy(), np.zeros(6)
        q[2] = 0.1
        for k in range(150):
            # it swings, and sinks a little
            step = 0.8 * step + 2e-4 * rng.normal(size=6) * [1, 1, 1, 4, 4, 4]
            q = problem.system.integrate(q, step - [0, 0, 1e-4, 0, 0, 0])
            tolerance = 1e-9 if k % 3 else 2e-3
            anew.at_mesh.slack[:] = -1.0
            found, expected = (one.measure(q, np.arange(1), tolerance) for one in (kept, anew))
            for one, other in zip(found, expected, strict=True):
                np.testing.assert_array_equal(one, other)
            at, count = kept.at_mesh, int(kept.at_mesh.counts[0])
            skipped += (at.clear_to[0, :count] > at.way[0] + tolerance).sum()
            touched, listed = touched + len(found.gap), listed + count
    assert touched > 100
    # a cylinder evaluates what its rims may touch
    assert skipped > (0.3 if kind == "cylinder" else 0.6) * listed


@pytest.mark.parametrize("kind", ["box", "hull"])
def test_no_feature_has_a_row_within_its_clearance(kind):
    """At the end of each way, in many directions; the rows are those of the kernels that are given every feature."""
    rng, tried, beyond, far_ones, out = np.random.default_rng(2), 0, 0, 0, np.zeros((4, 3))
    for _ in range(36):
        problem = scene_of(kind, (0, 0, 1), mesh=rough_field(rng), size=(0.3, 0.2, 0.1)).build()
        family, system = surface_of(problem), problem.system
        q = system.integrate(problem.q0, np.concatenate([rng.uniform(-0.2, 0.2, 2), [-0.92], rng.normal(size=3)]))
        family.measure(q, np.arange(1), 1e-9)
        at, places = family.at_mesh, family._places(q)
        before = out.copy()
        write_place(at, places, 0, before)

        def rows_at(there, t, k, e, at=at):
            write_place(at, there, 0, out)
            place_feature(at, there, 0, k, e, nothing_placed(at))
            given = at, 0, t, *((e,) if k == ON_IT else (k, e)), out[3].copy(), 0.0, 0
            return (vertex_row if k == ON_IT else sharp_row)(*given)

        for t, k, e in rng.permutation(at.features[0, : at.counts[0]])[:150].tolist():
            place_feature(at, places, 0, k, e, nothing_placed(at))
            far = clearance_of_feature(at, 0, t, k, e, before[3])
            if far <= 0.0:
                continue
            for turns in (0.0, 0.0, 1.0, 5.0):
                way = rng.normal(size=6) * [1, 1, 1, turns, turns, turns]
                low, high = 0.0, 2.0 * far / np.linalg.norm(way[:3])
                for _ in range(30):
                    middle = 0.5 * (low + high)
                    there = family._places(system.integrate(q, middle * way))
                    low, high = (middle, high) if travel_from(at, before, there, 0) < far else (low, middle)
                there, farther = (family._places(system.integrate(q, x * low * way)) for x in (1.0, 2.0))
                assert rows_at(there, t, k, e) == 0
                tried, beyond = tried + 1, beyond + rows_at(farther, t, k, e)
            far_ones += far > 0.01
    assert tried > 1000
    # of few it is known no better than to half
    assert beyond > 10
    assert far_ones > 0.15 * tried / 4


def test_the_clearance_of_rims_is_the_height_of_their_lowest_point():
    """By points all around both rims, 1e-3 apart in angle."""
    rng, angle = np.random.default_rng(4), 1e-3 * np.arange(6284)
    ring = 0.08 * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(len(angle))])
    half = np.array([0.0, 0.0, 0.05])
    rims = np.concatenate([ring - half, ring + half])
    problem = scene_of("cylinder", (0, 0, 0.3), mesh=rough_field(rng)).build()
    family, system = surface_of(problem), problem.system
    at = family.at_mesh
    for _ in range(50):
        places = family._places(system.integrate(problem.q0, rng.normal(size=6)))
        t, middle = int(rng.integers(len(at.mesh.triangles))), places[0, 3].copy()
        normal, offset = at.mesh.planes[t, 0, :3], at.mesh.planes[t, 0, 3]
        lowest = ((rims @ places[0, :3] + middle) @ normal - offset).min()
        assert lowest - 1e-7 <= rim_clearance(at, places, 0, t, middle) <= lowest


@pytest.mark.parametrize("kind", ["box", "hull", "cylinder"])
def test_nothing_is_touched_within_the_free_way(kind):
    rng, tried, near = np.random.default_rng(3), 0, 0
    for _ in range(60):
        problem = scene_of(kind, (0, 0, 1), mesh=rough_field(rng), size=(0.3, 0.2, 0.1)).build()
        family, system = surface_of(problem), problem.system
        q = problem.q0.copy()
        q[:3] = *rng.uniform(-0.3, 0.3, 2), rng.uniform(0.1, 0.25)
        touched = family.measure(q, np.arange(1), 1e-9)
        at, places, before = family.at_mesh, family._places(q), np.zeros((4, 3))
        free = free_way(at, places, 0)
        assert free <= 0.0 or not len(touched.gap)
        near += free > 0.0 and at.counts[0] > 0
        gap = family.nearest(q, np.arange(1)).gap
        for share in (0.5, 0.99, 1.01):
            assert family.are_within(q, np.arange(1), abs(gap) / share)[0] == (gap[0] < abs(gap[0]) / share)
        write_place(at, places, 0, before)
        for _ in range(10 if free > 0.0 else 0):
            way = rng.normal(size=6) * [1, 1, 1, 0, 0, 0] - [0, 0, 2, 0, 0, 0]
            there = system.integrate(q, 0.999 * free * way / np.linalg.norm(way))
            assert travel_from(at, before, family._places(there), 0) < free
            assert not len(family.measure(there, np.arange(1), 0.0).gap)
            tried += 1
    # what its rims may touch is evaluated each time
    assert near > 5 or kind == "cylinder"
    assert tried > 100


# motion


@pytest.mark.parametrize("scheme", SCHEMES, ids=lambda s: type(s).__name__)
@pytest.mark.parametrize(
    ("kind", "slope", "mu"),
    [
        ("box", 0.0, 0.0),
        ("box", 0.3, 0.2),
        ("hull", 0.3, 0.2),
        ("capsule", 0.3, 0.0),
        ("cylinder", 0.0, 0.0),
        ("cylinder", 0.3, 0.2),
        ("wheel", 0.3, 0.2),
    ],
)
def test_motion_over_any_triangulation_is_that_over_a_half_space(scheme, kind, slope, mu):
    turn = about("y", slope) @ about("x", 0.1 * (slope > 0.0))

    def run(seed):
        scene = scene_of(kind, turn @ [0.02, 0.01, 0.05], turn, turn @ [1.0, 0.05, 0.0], friction=mu)
        if seed is None:
            scene.add_halfspace(turn @ [0, 0, 1], name="ground")
        else:
            vertices, corner = tiled_plane(seed)
            scene.add_surface(vertices, corner, rotation=turn, name="ground")
        return mbvi.simulate(scene.build(), scheme, step=2e-2, duration=2.0, progress=False)

    expected = run(None)
    for seed in (1, 2):
        found = run(seed)
        np.testing.assert_allclose(found.q, expected.q, rtol=0, atol=1e-9)
        np.testing.assert_allclose(found.v, expected.v, rtol=0, atol=1e-9)
    if slope == 0.0:
        np.testing.assert_allclose(found.v[-1], [1.0, 0.05, 0, 0, 0, 0], rtol=0, atol=1e-9)


@pytest.mark.parametrize("scheme", SCHEMES, ids=lambda s: type(s).__name__)
def test_a_box_slides_over_a_trench_at_its_speed(scheme):
    scene = scene_of("box", (-0.3, 0, 0.05), about("z", 0.3), (1.0, 0, 0), TRENCH)
    run = mbvi.simulate(scene.build(), scheme, step=1e-3, duration=0.5, progress=False)
    np.testing.assert_allclose(run.v[-1], [1, 0, 0, 0, 0, 0], rtol=0, atol=1e-12)
    assert abs(run.q[-1][2] - 0.05) < 1e-9


def clipped(triangle, planes):
    """The part of a triangle inside of planes n . x + c <= 0."""
    polygon = list(triangle)
    for plane in planes:
        kept, heights = [], [float(plane[:3] @ x + plane[3]) for x in polygon]
        for i, a in enumerate(polygon):
            b, one, two = polygon[(i + 1) % len(polygon)], heights[i], heights[(i + 1) % len(polygon)]
            if one <= 0.0:
                kept.append(a)
            if one * two < 0.0:
                kept.append(a + (b - a) * one / (one - two))
        polygon = kept
        if not polygon:
            break
    return polygon


def depth_in_graph(mesh, points):
    """How far a hull of points must rise to leave a graph: triangles are clipped by its faces, none of mbvi's code."""
    vertices, corner = mesh
    planes, worst = ConvexHull(points).equations, 0.0
    below, triangles = planes[planes[:, 2] < -1e-9], vertices[corner]
    near = (triangles.max(axis=1) >= points.min(axis=0)).all(axis=1)
    near &= (triangles.min(axis=1) <= points.max(axis=0)).all(axis=1)
    for triangle in triangles[near]:
        for x in clipped(triangle, planes):
            worst = max(worst, float(((below[:, :3] @ x + below[:, 3]) / below[:, 2]).min()))
    return worst


@pytest.mark.parametrize("seed", range(6))
def test_boxes_fall_on_rough_fields_no_deeper_than_a_step_leads(seed):
    rng = np.random.default_rng(seed)
    mesh, size = rough_field(rng), rng.uniform(0.05, 0.3, 3)
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    scheme, h = SCHEMES[seed % 3], 2e-3
    place = (*rng.uniform(-0.2, 0.2, 2), 0.4)
    scene = scene_of("box", place, turn * np.linalg.det(turn), (0.3, 0.2, 0), mesh, size, friction=0.5 * (seed % 2))
    problem = scene.build()
    run = mbvi.simulate(problem, scheme, step=h, duration=0.6, progress=False)
    body = problem.system.bodies.index("body") if "body" in problem.system.bodies else 1
    fastest = np.abs(run.v[:, :3]).max() + np.linalg.norm(size) * np.abs(run.v[:, 3:]).max()
    depths = []
    for q in run.q[::10]:
        placement = problem.system.placements(q, np.array([body]))[0]
        depths.append(depth_in_graph(mesh, (CORNERS * size) @ placement[:3] + placement[3]))
    assert len(run.impacts) > 0
    assert max(depths) <= (1e-4 if isinstance(scheme, mbvi.StewartTrinkle) else h * fastest)


# corners of the shapes of `scene_of`; of those that are round, points on them
_TURN = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)
_RING, _ANGLES = np.column_stack([np.cos(_TURN), np.sin(_TURN)]), np.linspace(0.0, 0.5 * np.pi, 3)
_CAP = np.concatenate([0.05 * np.column_stack([np.cos(a) * _RING, np.full(12, np.sin(a))]) for a in _ANGLES])
_HALVES = np.array([[0.0, 0.0, 0.15]]), np.array([[1.0, 1.0, -1.0]])
_PRISM = 2.0 * np.pi * np.arange(48) / 48
POINTS = {
    "box": CORNERS * [0.2, 0.15, 0.1],
    "hull": np.concatenate([np.column_stack([np.full(6, x), 0.1 / np.sqrt(3) * _RING[::2]]) for x in (-0.1, 0.1)]),
    "capsule": np.concatenate([_CAP + _HALVES[0], (_CAP + _HALVES[0]) * _HALVES[1]]),
    "cylinder": np.array([(0.08 * np.cos(a), 0.08 * np.sin(a), z) for a in _PRISM for z in (-0.05, 0.05)]),
}
# the depth of an impact over h |v| as docs/howto/schemes.md states it
DEEPEST = [(mbvi.Paoli(), 1.0), (mbvi.Centered(), 0.5), (mbvi.Centered(project_positions=True), 0.5)]
DEEPEST.append((mbvi.StewartTrinkle(), 0.05))


@pytest.mark.slow(seconds=15)
@pytest.mark.parametrize("kind", POINTS)
@pytest.mark.parametrize(("scheme", "share"), DEEPEST, ids=lambda one: repr(one) if hasattr(one, "name") else "")
def test_no_drawn_body_is_deeper_in_a_drawn_field_than_stated(kind, scheme, share):
    """By triangles that are clipped by the hull of the body's points, at every eighth of all states: 17 fields each."""
    rng, h = np.random.default_rng(100 * len(kind) + len(repr(scheme))), 2e-3
    for friction in [0.0, 0.5] * 8 + [0.2]:
        mesh = rough_field(rng, int(rng.integers(20, 28)), rng.uniform(0.07, 0.15))
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        turn *= np.linalg.det(turn)
        problem = scene_of(
            kind, (*rng.uniform(-0.2, 0.2, 2), 0.45), turn, (0.3, 0.2, 0), mesh, friction=friction
        ).build()
        run = mbvi.simulate(problem, scheme, step=h, duration=0.5, progress=False)
        (shape,) = (one for one in problem.scene.shapes if one.body)
        points = POINTS[kind] @ shape.rotation.T + shape.position
        places = [problem.system.placements(q, np.array([shape.body]))[0] for q in run.q[::8]]
        depth = max(depth_in_graph(mesh, points @ place[:3] + place[3]) for place in places)
        speeds = np.linalg.norm(run.v[:, :3], axis=1)
        speeds += np.linalg.norm(points, axis=1).max() * np.linalg.norm(run.v[:, 3:], axis=1)
        assert run.impacts
        assert depth <= share * h * speeds.max()
        # along the vertical on slopes of up to 55 degrees, along normals in the run
        assert depth <= 1.8 * run.penetration().max() + 1e-9


@pytest.mark.parametrize("kind", ["box", "hull", "capsule", "cylinder", "wheel"])
def test_nothing_falls_through_at_fifty_metres_per_second(kind):
    """Fifty metres per second are five times the box in a step of 10 ms."""
    mesh = rough_field(np.random.default_rng(3))
    for k, scheme in enumerate(SCHEMES):
        scene = scene_of(kind, (0.01, 0.02, 1.0), about("x", 0.4 * k), (1.0, 0, -50.0), mesh, friction=0.5)
        run = mbvi.simulate(scene.build(), scheme, step=1e-2, duration=0.04, progress=False)
        assert run.q[-1][2] > -0.05
        assert len(run.impacts) > 0


@pytest.mark.parametrize("scheme", SCHEMES, ids=lambda s: type(s).__name__)
def test_a_box_balances_on_a_ridge_and_tips_beside_it(scheme):
    run = mbvi.simulate(
        scene_of("box", (0, 0, 0.05), mesh=ROOF).build(), scheme, step=1e-3, duration=0.2, progress=False
    )
    assert np.abs(run.v).max() < 1e-12
    scene = scene_of("box", (0.01, 0, 0.05), mesh=ROOF)
    run = mbvi.simulate(scene.build(), scheme, step=1e-3, duration=0.2, progress=False)
    assert run.v[-1][4] > 0.5


@pytest.mark.parametrize("scheme", SCHEMES, ids=lambda s: type(s).__name__)
def test_a_box_falls_into_a_valley_and_rests_on_both_sides(scheme):
    scene = scene_of("box", (0, 0, 0.15), about("y", np.pi / 4), mesh=VALLEY, size=(0.2, 0.2, 0.2))
    run = mbvi.simulate(scene.build(), scheme, step=1e-3, duration=0.2, progress=False)
    assert np.abs(run.v[-1]).max() < 1e-12
    assert run.penetration().max() < 5e-4


# rows


def test_a_box_on_a_ridge_has_the_crossings_of_its_edges():
    rows = rows_of(scene_of("box", (0.02, 0, 0.05), mesh=ROOF).build())
    same_points(rows.point, [[0, -0.075, 0], [0, 0.075, 0]])
    np.testing.assert_allclose(rows.normal, [[0, 0, 1]] * 2, rtol=0, atol=1e-12)


def test_a_box_in_a_valley_touches_both_sides():
    scene = scene_of("box", (0, 0, 0.1 * np.sqrt(2)), about("y", np.pi / 4), mesh=VALLEY, size=(0.2, 0.2, 0.2))
    rows = rows_of(scene.build())
    assert len(rows.gap) == 8
    for side in (-1.0, 1.0):
        normal = np.array([side, 0.0, 1.0]) / np.sqrt(2)
        assert (rows.normal @ normal > 1.0 - 1e-12).sum() == 4


def test_a_box_over_a_step_touches_the_rim():
    rows = rows_of(scene_of("box", (0.02, 0, 0.05), mesh=STEP).build())
    same_points(rows.point, [[x, y, 0] for x in (-0.08, 0.0) for y in (-0.075, 0.075)])
    np.testing.assert_allclose(rows.normal, [[0, 0, 1]] * 4, rtol=0, atol=1e-12)


def test_a_face_rests_on_a_peak_that_is_smaller():
    rows = rows_of(scene_of("box", (0.03, 0.02, 0.05), mesh=PYRAMID).build())
    np.testing.assert_allclose(rows.point, [[0, 0, 0]], rtol=0, atol=1e-12)
    np.testing.assert_allclose(rows.normal, [[0, 0, 1]], rtol=0, atol=1e-12)


def test_crossed_edges_have_the_normal_across_both():
    turn = about("z", 1.0) @ about("x", np.pi / 4)
    scene = scene_of("box", (0, 0, 0.1 * np.sqrt(2) + 1e-3), turn, mesh=ROOF, size=(0.5, 0.2, 0.2))
    rows = rows_of(scene.build(), 0.01)
    np.testing.assert_allclose(rows.gap, [1e-3], rtol=0, atol=1e-12)
    np.testing.assert_allclose(rows.normal, [[0, 0, 1]], rtol=0, atol=1e-12)


def test_many_peaks_below_a_face_have_few_rows():
    spikes = [(0.02 * i, 0.02 * (i % 2) - 0.02) for i in range(-20, 21)]
    mesh = extruded(spikes, cuts=2)
    rows = rows_of(scene_of("box", (0, 0, 0.05), mesh=mesh, size=(0.5, 0.3, 0.1)).build())
    assert 4 <= len(rows.gap) <= 8
    assert np.ptp(rows.point[:, 0]) > 0.4


def test_a_thin_plate_is_touched_from_above_only():
    """The lower side of a plate is near too, but the box is not on its free side."""
    n, bottom = 0.5, -0.004
    top = np.array([[-n, -n, 0], [n, -n, 0], [n, n, 0], [-n, n, 0]])
    vertices = np.concatenate([top, top + np.array([0, 0, bottom])])
    sides = [[k, 4 + k, (k + 1) % 4] for k in range(4)] + [[(k + 1) % 4, 4 + k, 4 + (k + 1) % 4] for k in range(4)]
    mesh = vertices, np.array([[0, 1, 2], [0, 2, 3], [4, 6, 5], [4, 7, 6], *sides])
    scene = scene_of("box", (0, 0, 0.05), mesh=mesh)
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=0.1, progress=False)
    assert abs(run.q[-1][2] - 0.05) < 1e-6


@pytest.mark.parametrize("kind", ["box", "hull", "capsule", "cylinder", "wheel"])
def test_a_mesh_is_solid_behind_its_triangles_only(kind):
    vertices, corner = tiled_plane(1)
    for some, rests in ((corner, True), (corner[:, ::-1], False)):
        run = mbvi.simulate(scene_of(kind, (0, 0, 0.06), mesh=(vertices, some)).build(), step=5e-3, duration=0.2)
        assert (abs(run.q[-1][2] - 0.05) < 1e-3) == rests


def test_a_scene_with_a_mesh_is_saved_and_shown(tmp_path):
    scene = scene_of("box", (0.02, 0, 0.05), mesh=STEP, velocity=(-0.5, 0, 0), friction=0.3)
    problem = scene.build()
    assert "1 shape at a mesh" in problem.report()
    run = mbvi.simulate(problem, mbvi.Paoli(), step=1e-3, duration=0.05, record="contacts", progress=False)
    assert len(run.contacts(0.03)) >= 2
    run.save(tmp_path / "run.npz")
    again = mbvi.load(tmp_path / "run.npz")
    other = mbvi.simulate(again.problem, mbvi.Paoli(), step=1e-3, duration=0.05, progress=False)
    np.testing.assert_array_equal(other.q, run.q)
    run.save(tmp_path / "run.html")
    assert (tmp_path / "run.html").stat().st_size > 10_000


def test_schemes_with_their_own_steps_land_boxes_on_meshes():
    run = mbvi.simulate(scene_of("box", (0, 0, 0.07), mesh=tiled_plane(1)).build(), mbvi.Adaptive(), duration=0.2)
    assert abs(run.q[-1][2] - 0.05) < 1e-9
    run = mbvi.simulate(scene_of("box", (0, 0, 0.07), mesh=tiled_plane(1)).build(), mbvi.EventDriven(), duration=0.1)
    assert "where gradients jump" in " ".join(run.notes)


def matching(rows, others, i):
    """The row of others next to row i."""
    apart = np.linalg.norm(rows.point[i] - others.point, axis=1) + np.linalg.norm(
        rows.normal[i] - others.normal, axis=1
    )
    k = int(apart.argmin())
    return k if apart[k] < 1e-3 else -1


@pytest.mark.parametrize("kind", ["box", "hull", "capsule", "cylinder"])
def test_gradients_are_differences_of_gaps(kind):
    rng, checked, kinds = np.random.default_rng(5), 0, set()
    for _ in range(25):
        mesh = rough_field(rng)
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        place = (*rng.uniform(-0.3, 0.3, 2), 0.4)
        problem = scene_of(kind, place, turn * np.linalg.det(turn), mesh=mesh).build()
        family = surface_of(problem)
        q = problem.q0.copy()
        q[2] -= family.gap(0.0, q)[0] + 0.005
        rows, h, system = family.contacts(0.0, q, 0.02), 1e-6, problem.system
        if rows is None:
            continue
        for k in range(system.nv):
            step = h * np.eye(system.nv)[k]
            plus, minus = (family.contacts(0.0, system.integrate(q, s * step), 0.02 + 1e-5) for s in (1, -1))
            for i in range(len(rows.gap)):
                a, b = matching(rows, plus, i), matching(rows, minus, i)
                if a >= 0 and b >= 0:
                    slope = (plus.gap[a] - minus.gap[b]) / (2 * h)
                    assert slope == pytest.approx(rows.jacobian[i][k], abs=2e-6)
                    checked += 1
        kinds |= set(np.round(rows.normal[:, 2], 6).tolist())
    assert checked > 150
    assert len(kinds) > 25


@pytest.mark.parametrize(("kind", "exact"), [("box", 1e-5), ("hull", 1e-5), ("capsule", 1e-5), ("cylinder", 2e-4)])
def test_distances_far_away_are_those_of_coal(kind, exact):
    """A cylinder is the prism of 48 sides inside it, 0.2 % of its radius smaller."""
    rng = np.random.default_rng(8)
    for _ in range(10):
        vertices, corner = rough_field(rng)
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        problem = scene_of(kind, (*rng.uniform(-0.5, 0.5, 2), 0.5), turn * np.linalg.det(turn), mesh=(vertices, corner))
        problem = problem.build()
        expected = by_coal(problem, problem.q0, vertices, corner)
        assert surface_of(problem).gap(0.0, problem.q0)[0] == pytest.approx(expected, abs=exact)


@pytest.mark.parametrize("kind", ["box", "hull", "capsule", "cylinder"])
def test_the_free_way_is_no_longer_than_the_distance_by_coal(kind):
    rng, known, share = np.random.default_rng(9), 0, 0.0
    for _ in range(80):
        vertices, corner = rough_field(rng)
        problem = scene_of(kind, (0, 0, 1), mesh=(vertices, corner), size=(0.3, 0.2, 0.1)).build()
        q = np.array(problem.q0)
        q[:3] = *rng.uniform(-0.3, 0.3, 2), rng.uniform(0.1, 0.3)
        q = problem.system.integrate(q, np.concatenate([np.zeros(3), 0.7 * rng.normal(size=3)]))
        family = surface_of(problem)
        family.measure(q, np.arange(1), 1e-9)
        free, far = free_way(family.at_mesh, family._places(q), 0), by_coal(problem, q, vertices, corner)
        # a cylinder is the prism of 48 sides inside it; one-sided surfaces have no distance from behind
        if far > 1e-3:
            assert free <= far + (1e-3 if kind == "cylinder" else 1e-9)
            known, share = known + (free > 0.0), max(share, free / far)
    assert known > 10 and share > 0.3


def by_coal(problem, q, vertices, corner):
    """Return the distance of the one body and the triangles [m], 0 where they intersect."""
    mesh = coal.BVHModelOBBRSS()
    mesh.beginModel(len(corner), len(vertices))
    mesh.addVertices(vertices)
    mesh.addTriangles(corner)
    mesh.endModel()
    shape = next(s for s in problem.scene.shapes if s.body)
    place = problem.system.placements(q, np.array([shape.body]))[0]
    pose = coal.Transform3s(place[:3].T @ shape.rotation, shape.position @ place[:3] + place[3])
    request, result = coal.DistanceRequest(), coal.DistanceResult()
    return coal.distance(mesh, coal.Transform3s(), shape.shape.coal(), pose, request, result)


@pytest.mark.parametrize("name", ["funnel", "drum", "hourglass", "chute", "terrain"])
def test_made_surfaces_hold_boxes_within(name):
    rows = np.linspace(-1.0, 1.0, 3)
    surfaces = mbvi.surfaces
    mesh, start = {
        "funnel": (surfaces.funnel(1.0, 0.02, 1.0), (0.1, 0, 0.6)),
        "drum": (surfaces.drum(1.0, 1.0), (0.1, 0, -0.7)),
        "hourglass": (surfaces.hourglass(1.0, 0.02, 1.0), (0.1, 0, 0.6)),
        "chute": (surfaces.chute(4.0, 1.0, 0.2, 0.3), (-2.0, 0, 0.6)),
        "terrain": (surfaces.terrain(rows, rows, np.zeros((3, 3))), (0.1, 0, 0.2)),
    }[name]
    run = mbvi.simulate(
        scene_of("box", start, mesh=mesh).build(), mbvi.Paoli(), step=2e-3, duration=0.4, progress=False
    )
    # it has stayed much longer than a free fall takes, 0.78 m
    assert run.q[-1][2] > start[2] - 0.55
    assert len(run.impacts) > 0
