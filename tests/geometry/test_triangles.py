"""Triangle meshes as they are: exact distances, one row a feature, nothing to catch on between coplanar triangles."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mbvi
from mbvi import surfaces
from mbvi.geometry.at_meshes.near_triangles import near_triangles, still_near
from mbvi.geometry.meshes.triangles import FEW, Surface
from support.plain.triangles import mesh_contacts_plain, mesh_distances_plain, nearest_on_triangles

coordinates = st.floats(-1, 1).map(lambda x: round(x, 3))
triples = st.tuples(coordinates, coordinates, coordinates).map(np.array)


def distance_to_segment(x, a, b):
    along = np.clip((x - a) @ (b - a) / max((b - a) @ (b - a), 1e-300), 0, 1)
    return np.linalg.norm(x - a - along * (b - a))


def distance_to_triangle(x, a, b, c):
    """By another way: the plane where the foot is inside, else the nearest side."""
    sides = min(distance_to_segment(x, *side) for side in ((a, b), (b, c), (c, a)))
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal)
    foot = x - (x - a) @ normal * normal
    inside = all(np.cross(q - p, foot - p) @ normal >= 0 for p, q in ((a, b), (b, c), (c, a)))
    return min(abs((x - a) @ normal), sides) if inside else sides


@given(triples, triples, triples, triples)
@settings(max_examples=300)
def test_the_nearest_point_of_a_triangle_is_nearest(a, b, c, x):
    if np.linalg.norm(np.cross(b - a, c - a)) < 1e-4:
        return
    foot, feature = nearest_on_triangles(a[None], b[None], c[None], x[None])
    assert np.linalg.norm(foot[0] - x) == pytest.approx(distance_to_triangle(x, a, b, c), abs=1e-12)
    if feature[0] < 3:
        np.testing.assert_allclose(foot[0], (a, b, c)[feature[0]], atol=1e-15)


@pytest.mark.parametrize("one_sided", [True, None, False])
def test_triangles_that_are_listed_again_are_left_out(one_sided, rng):
    """In any turn of their corners; the other way round they are another side, but of a sheet without thickness."""
    points, triangles = (np.asarray(part) for part in bumps(3))
    again = np.array([np.roll(one, int(rng.integers(3))) for one in triangles[rng.permutation(len(triangles))]])
    plain = Surface(points, triangles, one_sided)
    np.testing.assert_array_equal(plain.triangles, triangles)
    np.testing.assert_array_equal(Surface(points, np.concatenate([triangles, again]), one_sided).triangles, triangles)
    back = np.concatenate([triangles, again[:, ::-1]])
    count = len(triangles) if one_sided is False else 2 * len(triangles)
    assert len(Surface(points, back, one_sided).triangles) == count


def test_a_body_slides_over_a_floor_of_triangles_that_are_listed_twice():
    points = np.array([[x, y, 0.0] for x in (-2, 0, 2) for y in (-2, 0, 2)])
    cells = [(0, 3, 4), (0, 4, 1), (1, 4, 5), (1, 5, 2), (3, 6, 7), (3, 7, 4), (4, 7, 8), (4, 8, 5)]
    scene = mbvi.Scene()
    scene.add_surface(points, cells + cells, one_sided=True)
    scene.add_box((0.2, 0.3, 0.1), position=(-0.9, 0.1, 0.1), velocity=(2, 0.3, 0))
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=2e-3, duration=0.8)
    np.testing.assert_allclose(run.v[-1], [2, 0.3, 0, 0, 0, 0], atol=1e-9)


def above(mesh, positions, radius=0.1, **options):
    scene = mbvi.Scene(**options)
    scene.add_surface(*mesh, name="sheet")
    scene.add_spheres(np.atleast_2d(positions), radius, mass=1.0)
    return scene.build()


def bumps(seed):
    rng = np.random.default_rng(seed)
    return surfaces.terrain(np.linspace(-1, 1, 9), np.linspace(-1, 1, 8), rng.uniform(-0.3, 0.1, (9, 8)))


@given(seed=st.integers(0, 1000), tolerance=st.floats(0.0, 0.5))
@settings(max_examples=20)
def test_the_tree_finds_what_a_look_at_all_triangles_finds(seed, tolerance):
    positions, radii = mbvi.packing.random_loose(
        (-1.3, -1.3, 0.2), (1.3, 1.3, 0.6), mbvi.packing.uniform(0.01, 0.12), count=20, seed=seed
    )
    problem = above(bumps(seed), positions, radii)
    constraint, q = problem.constraints.constraints[0], problem.q0
    everything = constraint.contacts(0.0, q, np.inf)
    near = everything.gap <= tolerance
    found = constraint.contacts(0.0, q, tolerance)
    count = 0 if found is None else len(found.gap)
    assert count == near.sum()
    if count:
        np.testing.assert_allclose(found.gap, everything.gap[near], atol=0)
        np.testing.assert_allclose(found.normal, everything.normal[near], atol=0)
    gaps = constraint.gap(0.0, q)
    v, t = bumps(seed)
    exact = [min(distance_to_triangle(x, *v[f]) for f in t) for x in positions[:3]]
    np.testing.assert_allclose(gaps[:3], np.array(exact) - radii[:3], atol=1e-12)


@given(seed=st.integers(0, 1000))
@settings(max_examples=15)
def test_gradients_are_those_of_the_gaps(seed):
    positions, radii = mbvi.packing.random_loose((-1, -1, 0.2), (1, 1, 0.5), 0.1, count=5, seed=seed)
    problem = above(bumps(seed), positions, radii)
    constraint, q, h = problem.constraints.constraints[0], problem.q0, 1e-6
    J = constraint.gradient(0.0, q)
    for k in range(problem.system.nv):
        step = np.eye(problem.system.nv)[k] * h
        slope = (constraint.gap(0.0, q + step) - constraint.gap(0.0, q - step)) / (2 * h)
        np.testing.assert_allclose(J[:, k], slope, atol=1e-5)


@given(x=st.floats(-0.9, 0.9), y=st.floats(-0.9, 0.9), depth=st.floats(0.0, 0.05))
def test_a_sphere_sunk_into_a_plane_of_many_triangles_feels_the_plane_alone(x, y, depth):
    flat = surfaces.terrain(np.linspace(-1, 1, 21), np.linspace(-1, 1, 14), np.zeros((21, 14)))
    problem = above(flat, (x, y, 0.1))
    q = np.array([x, y, 0.1 - depth])
    rows = problem.constraints.active(0.0, q, 1e-9)
    np.testing.assert_allclose(rows.normal, np.tile([0, 0, 1.0], (len(rows.gap), 1)), atol=1e-9)
    np.testing.assert_allclose(rows.gap, -depth, atol=1e-15)
    # rounding may see both sides of an edge
    assert 1 <= len(rows.gap) <= 2


def soup(rng, count):
    """Triangles of very different sizes, some of them in one place, some sharing corners and edges."""
    corners = rng.uniform(-1, 1, (count, 1, 3)) + rng.uniform(-1, 1, (count, 3, 3)) * 10 ** rng.uniform(
        -3, 0, (count, 1, 1)
    )
    strip = np.stack([np.linspace(-1, 1, 40), np.tile([0.0, 0.1], 20), rng.uniform(-0.1, 0.1, 40)], axis=1)
    joined = np.stack([strip[:-2], strip[1:-1], strip[2:]], axis=1)
    corners = np.concatenate([corners, joined, corners[:3]])
    return Surface(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))


@pytest.mark.parametrize("seed", range(6))
def test_contacts_are_those_of_a_look_at_every_triangle(seed):
    """Spheres inside, outside, at vertices, just beside edges and faces, and larger than the mesh."""
    rng = np.random.default_rng(seed)
    surface = soup(rng, [1, 3, 4, 60, 200, 400][seed])
    a, b, c = surface.vertices[surface.triangles[:8]].transpose(1, 0, 2)
    centres = np.concatenate([rng.uniform(-1.5, 1.5, (30, 3)), a, 0.5 * (b + c), (a + b + c) / 3])
    # a centre on a face leaves to the side that rounding says
    centres[30 + len(a) :] += rng.normal(size=(2 * len(a), 3)) * 1e-4
    radii = 10 ** rng.uniform(-2, 0, len(centres))
    scene = mbvi.Scene()
    scene.add_surface(surface.vertices, surface.triangles)
    scene.add_spheres(np.array([[0, 0, 1e3 + 10 * k] for k in range(len(centres))]), radii, mass=1.0)
    family, q = scene.build().constraints.constraints[0], centres.ravel()
    sheet, both = (surface.vertices, surface.triangles, *surface.tree), np.ones(len(surface.sharers), bool)
    expected = np.zeros(len(centres))
    mesh_distances_plain(*sheet, centres, expected)
    np.testing.assert_allclose(family.gap(0.0, q), expected - radii, atol=1e-12)
    for tolerance in (0.0, 1e-2, 0.3):
        out = np.zeros(99999, int), np.zeros(99999), np.zeros((99999, 3)), np.zeros((99999, 3))
        reach = radii + tolerance + 1e-12
        count, _ = mesh_contacts_plain(
            *sheet, surface.features, surface.sharers, both, centres, radii, reach, tolerance, 0.5, *[None] * 7, *out
        )
        found = family.contacts(0.0, q, tolerance)
        for part, name in zip(out, ("constraint", "gap", "point", "normal"), strict=True):
            np.testing.assert_allclose(getattr(found, name), part[:count], atol=1e-12)


@pytest.mark.parametrize("count", [1, 4, 5, 100, 1000])
def test_each_box_holds_its_halves_and_its_triangles_and_each_triangle_is_in_one(count):
    surface = soup(np.random.default_rng(count), count)
    order, boxes = surface.tree
    corners, leaves = surface.vertices[surface.triangles], len(boxes) // 2
    np.testing.assert_array_equal(np.sort(order), np.arange(len(corners)))
    for k in range(1, leaves):
        assert (boxes[k, :3] == boxes[2 * k : 2 * k + 2, :3].min(axis=0)).all()
        assert (boxes[k, 3:] == boxes[2 * k : 2 * k + 2, 3:].max(axis=0)).all()
    for k in range(leaves):
        within = corners[order[k * FEW : (k + 1) * FEW]].reshape(-1, 3)
        if len(within):
            assert (boxes[leaves + k] == [*within.min(axis=0), *within.max(axis=0)]).all()


def looked_at(surface, monkeypatch):
    """How many triangles a search near one point of a mesh looks at."""
    centres, count = np.array([[0.3, 0.2, 0.05]]), 0
    measure = near_triangles.loops.__globals__["add_near"]

    def counting(*arguments):
        nonlocal count
        count += 1
        return measure(*arguments)

    monkeypatch.setitem(near_triangles.loops.__globals__, "add_near", counting)
    outs = np.zeros(99, int), np.zeros(99, int), np.zeros(99), np.zeros((99, 3)), np.zeros(99, int)
    tree = surface.vertices, surface.triangles, *surface.tree
    found = near_triangles.loops(*tree, surface.features, centres, 0, 0.051, *outs)
    monkeypatch.setitem(near_triangles.loops.__globals__, "add_near", measure)
    assert found >= 1
    return count


@pytest.mark.parametrize(("count", "swift"), [(30, 0.01), (30, 0.3), (3000, 0.01), (3000, 0.1)])
def test_listed_triangles_are_those_of_the_tree(count, swift):
    """Along random walks with changing reaches, also where more are near than are listed, and beyond the room."""
    rng = np.random.default_rng(count)
    surface = soup(rng, count)
    tree = *(surface.vertices, surface.triangles, *surface.tree), surface.features
    listed, about, centres = np.zeros((3, 33), int), np.zeros((3, 4)), rng.uniform(-1, 1, (3, 3))
    used = 0
    for _ in range(400):
        centres += rng.uniform(-swift, swift, centres.shape) * 0.3
        for i in range(len(centres)):
            reach, known = float(rng.choice([0.1, 0.12, 0.3])), about[i].copy()
            ours, theirs = (
                (np.zeros(900, int), np.zeros(900, int), np.zeros(900), np.zeros((900, 3)), np.zeros(900, int))
                for _ in range(2)
            )
            found = still_near(*tree, centres, i, reach, listed, about, *ours)
            assert near_triangles(*tree, centres, i, reach, *theirs) == found
            one, other = np.argsort(ours[0][:found]), np.argsort(theirs[0][:found])
            for mine, their in zip(ours[:4], theirs[:4], strict=True):
                np.testing.assert_array_equal(mine[one], their[other])
            np.testing.assert_array_equal(ours[4][:found], np.arange(found))
            used += (about[i] == known).all() and listed[i, 0] < 33
    # slow walks among few triangles look at the tree seldom
    if swift == 0.01 and count == 30:
        assert used > 600


def test_a_search_measures_few_triangles_however_many_there_are(monkeypatch):
    looked = []
    for k in (30, 100, 300):
        x = np.linspace(-k / 30, k / 30, k)
        looked.append(looked_at(Surface(*surfaces.terrain(x, x, np.zeros((k, k)))), monkeypatch))
    # at the same size of triangles: 1800, 20,000 and 180,000 of them
    assert max(looked) <= 60


@pytest.mark.parametrize("width", [1.0, 1e3, 1e6, 1e12, 1e30])
def test_a_wide_flat_mesh_is_found_from_near(width):
    """At any ratio of its width to the spheres' size."""
    corners = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]]) * [width, width, 0.0]
    problem = above((corners, np.array([[0, 1, 2]])), (0.0, 0.0, 0.1))
    np.testing.assert_allclose(problem.constraints.gap(0.0, problem.q0), [0.0], atol=1e-15)


def test_a_mesh_may_be_turned_and_moved():
    rng = np.random.default_rng(5)
    v, t = bumps(5)
    turn, place = np.linalg.qr(rng.normal(size=(3, 3)))[0], np.array([1.0, -2.0, 0.5])
    turn *= np.linalg.det(turn)
    centres = np.concatenate([rng.uniform(-1, 1, (5, 2)), rng.uniform(0.6, 0.7, (5, 1))], axis=1) + np.arange(5)[
        :, None
    ] * [0, 0, 0.3]
    scene = mbvi.Scene()
    scene.add_surface(v, t, position=place, rotation=turn)
    scene.add_spheres(centres @ turn.T + place, 0.1, mass=1.0)
    moved = scene.build()
    straight = above((v, t), centres)
    np.testing.assert_allclose(
        moved.constraints.gap(0.0, moved.q0), straight.constraints.gap(0.0, straight.q0), atol=1e-14
    )


def test_corner_ridge_and_tip_have_the_rows_they_should():
    # a corner of three walls, seen from inside
    corner = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]]), np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1]])
    rows = above(corner, (0.1, 0.1, 0.1)).constraints.active(0.0, np.full(3, 0.1), 1e-9)
    assert {tuple(n) for n in np.round(rows.normal, 12).tolist()} == {(1, 0, 0), (0, 1, 0), (0, 0, 1)}
    # a roof: over the ridge one row, straight up, and over its end too
    roof = np.array([[-1, -1, -1], [1, -1, -1], [-1, 0, 0], [1, 0, 0], [-1, 1, -1], [1, 1, -1.0]])
    mesh = roof, np.array([[0, 1, 3], [0, 3, 2], [2, 3, 5], [2, 5, 4]])
    for x in (0.3, 1.0):
        q = np.array([x, 0, 0.1])
        rows = above(mesh, q).constraints.active(0.0, q, 1e-9)
        np.testing.assert_allclose(rows.normal, [[0, 0, 1]], atol=1e-12)


def test_a_mesh_file_with_a_vertex_for_each_corner_is_welded(tmp_path):
    v, t = surfaces.terrain([0, 1, 2], [0, 1, 2], np.zeros((3, 3)))
    soup = Surface(v[t].reshape(-1, 3), np.arange(3 * len(t)).reshape(-1, 3))
    assert len(soup.vertices) == 9 and (np.sort(soup.sharers) == np.sort(Surface(v, t).sharers)).all()
    path = tmp_path / "sheet.obj"
    lines = [f"v {x} {y} {z}" for x, y, z in v.tolist()] + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in t.tolist()]
    path.write_text("\n".join(lines) + "\n")
    scene = mbvi.Scene()
    assert scene.add_surface(path, scale=0.5, position=(0, 0, 1)) == "sheet"
    scene.add_sphere(0.1, position=(0.5, 0.5, 1.3))
    problem = scene.build()
    np.testing.assert_allclose(problem.constraints.gap(0.0, problem.q0), [0.2], atol=1e-12)
    assert "1 sphere at a mesh" in problem.report()


def test_a_ball_larger_than_the_neck_plugs_the_funnel_at_the_exact_height():
    top, neck, height, segments, r = 0.5, 0.1, 0.4, 32, 0.25
    scene = mbvi.Scene()
    scene.add_surface(*surfaces.funnel(top, neck, height, pipe=0.2, segments=segments), name="funnel")
    scene.add_sphere(r, position=(0.05, 0.02, 0.7), name="ball")
    run = mbvi.simulate(scene.build(), mbvi.SchatzmanPaoli(), step=2e-3, duration=1.0)
    # the faces of the cone are planes whose nearest points to the axis are at cos(pi / n) of the radius
    apothem, slope = np.cos(np.pi / segments), np.arctan2(height, (top - neck) * np.cos(np.pi / segments))
    exact = (r / np.cos(slope)) - neck * apothem * np.tan(slope)
    np.testing.assert_allclose(run.q[-1], [0, 0, exact], atol=1e-6)


def test_error_control_meets_a_mesh_as_fine_steps_do():
    scene = mbvi.Scene(restitution=0.5)
    scene.add_surface(*surfaces.funnel(0.5, 0.1, 0.4, segments=24), name="funnel")
    scene.add_sphere(0.25, position=(0.1, 0.02, 0.5))
    problem = scene.build()
    run = mbvi.simulate(problem, mbvi.EventDriven(1e-8), duration=0.25)
    fine = mbvi.simulate(problem, mbvi.Paoli(), step=1e-4, duration=0.25)
    assert run.impacts[0].constraints == ("sphere | funnel",)
    assert run.impacts[0].time == pytest.approx(fine.impacts[0].time, abs=2e-4)
    assert np.abs(run.q[-1] - fine.q[-1]).max() < 1e-3


def test_a_mesh_is_run_by_fixed_steps_unless_another_scheme_is_named():
    scene = mbvi.Scene()
    scene.add_surface(*surfaces.funnel(0.5, 0.1, 0.4), name="funnel")
    scene.add_sphere(0.05, position=(0.02, 0.03, 0.5))
    run = mbvi.simulate(scene.build(), duration=0.05)
    assert run.scheme == "Centered" and "the contact normal of sphere | funnel can jump" in run.notes[0]


def test_a_small_ball_falls_through():
    scene = mbvi.Scene(restitution=0.3)
    scene.add_surface(*surfaces.funnel(0.5, 0.1, 0.4, pipe=0.2), name="funnel")
    scene.add_sphere(0.05, position=(0.02, 0.03, 0.5))
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=1.0)
    assert run.q[-1, 2] < -0.3 and run.penetration().max() < 5e-3


def test_a_sphere_on_a_body_meets_a_mesh_as_a_free_one_does():
    scene = mbvi.Scene(restitution=0.5)
    scene.add_surface(*surfaces.terrain([-1, 1], [-1, 1], np.zeros((2, 2))), name="sheet")
    scene.add_sphere(0.1, position=(0, 0, 0.5))
    free = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=0.6)
    plane = mbvi.Scene(restitution=0.5)
    plane.add_halfspace((0, 0, 1))
    plane.add_sphere(0.1, position=(0, 0, 0.5))
    np.testing.assert_allclose(
        free.q, mbvi.simulate(plane.build(), mbvi.Paoli(), step=1e-3, duration=0.6).q, atol=1e-12
    )


def test_funnel_drum_chute_hourglass_have_the_shapes_they_say():
    v, t = surfaces.hourglass(0.2, 0.02, 0.3, 24)
    assert np.ptp(v[:, 2]) == pytest.approx(0.6) and Surface(v, t).sharers.min() >= 1
    # closed: every edge has two faces
    surface = Surface(v, t)
    edges = surface.features[:, 3:6].ravel()
    assert (surface.sharers[np.unique(edges)] == 2).all()
    v, t = surfaces.drum(0.3, 0.2, vanes=4, depth=0.1, segments=24)
    assert np.hypot(v[:, 0], v[:, 2]).max() == pytest.approx(0.3) and np.abs(v[:, 1]).max() == pytest.approx(0.1)
    inner = v[-16:]
    assert np.hypot(inner[:, 0], inner[:, 2]).min() == pytest.approx(0.2)
    v, t = surfaces.chute(2.0, 0.5, np.radians(30), 0.1)
    floor = Surface(v, t[[0, 3]])
    assert v[:, 2].max() == pytest.approx(1.0 + 0.1 * np.cos(np.radians(30))) and len(floor.triangles) == 2


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda s: s.add_surface(np.zeros((3, 2)), [[0, 1, 2]]), r"\(v, 3\)"),
        (lambda s: s.add_surface(np.eye(3), [[0.0, 1, 2]]), "integers of shape"),
        (lambda s: s.add_surface(np.eye(3), [[0, 1, 3]]), "not there"),
        (lambda s: s.add_surface(np.eye(3), [[0, 1, 1]]), "no triangle with an area"),
        (lambda s: s.add_surface(np.eye(3)), "give triangles"),
        (lambda s: s.add_surface("nowhere.stl"), "no such file"),
        (lambda s: s.add_surface("nowhere.stl", [[0, 1, 2]]), "brings its triangles"),
        (lambda s: surfaces.revolved([(1, 0)]), "two or more corners"),
        (lambda s: surfaces.revolved([(1, 0), (1, 1)], 2), "3 or more"),
        (lambda s: surfaces.funnel(0.1, 0.2, 1.0), "top - neck must be positive"),
        (lambda s: surfaces.hourglass(0.1, 0.0, 1.0), "neck must be positive"),
        (lambda s: surfaces.drum(0.1, 0.2, vanes=2, depth=0.3), "between 0 and the radius"),
        (lambda s: surfaces.chute(1, 1, 2.0, 0.1), "angle"),
        (lambda s: surfaces.terrain([0, 1], [0, 1], np.zeros((2, 3))), "must have"),
    ],
)
def test_wrong_meshes_say_what_is_wrong(call, message):
    with pytest.raises(mbvi.InputError, match=message):
        call(mbvi.Scene())


def test_ellipsoids_are_refused_at_a_mesh():
    scene = mbvi.Scene()
    scene.add_surface(*bumps(0))
    scene.add_ellipsoid((0.1, 0.2, 0.3), position=(0, 0, 1))
    with pytest.raises(mbvi.InputError, match="ellipsoid would meet surface, but a mesh as it is meets no ellipsoids"):
        scene.build()
