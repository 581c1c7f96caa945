"""One-sided meshes for spheres: height fields and closed meshes push back what is behind them, and nothing passes."""

import numpy as np
import pytest

import mbvi
from mbvi import surfaces
from mbvi.geometry.meshes.height_field import height_field
from mbvi.geometry.meshes.triangles import Surface, tree_of

G = 9.81


def plane_of(n, seed=0, slope=(0.0, 0.0)):
    """Heights of a plane over n x n points of a square of 4 m."""
    x = np.linspace(-2, 2, n)
    return slope[0] * x + slope[1] * x[:, None]


def field_with_balls(heights, positions, radius=0.1, size=(4.0, 4.0), velocity=(0.0, 0.0, 0.0), **options):
    scene = mbvi.Scene(**options)
    scene.add_heightfield(heights, size, name="field")
    for k, position in enumerate(np.atleast_2d(positions)):
        scene.add_sphere(radius, mass=1.0, position=position, velocity=velocity, name=f"ball{k}")
    return scene.build()


def random_flat(seed, n=12, half=2.0):
    """A flat square in triangles of all shapes: a grid of moved corners, its diagonals drawn."""
    rng = np.random.default_rng(seed)
    x = np.linspace(-half, half, n)
    grid = np.stack([*np.meshgrid(x, x, indexing="ij"), np.zeros((n, n))], axis=-1)
    grid[1:-1, 1:-1, :2] += rng.uniform(-0.3, 0.3, (n - 2, n - 2, 2)) * (x[1] - x[0])
    number, triangles = np.arange(n * n).reshape(n, n), []
    for i in range(n - 1):
        for j in range(n - 1):
            a, b, c, d = number[i, j], number[i + 1, j], number[i + 1, j + 1], number[i, j + 1]
            triangles += [[a, b, c], [a, c, d]] if rng.integers(2) else [[a, b, d], [b, c, d]]
    return grid.reshape(-1, 3), np.array(triangles)


# laws


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("slope", [0.0, 0.4])
def test_on_a_flat_field_of_any_triangles_a_ball_moves_as_on_a_plane(seed, slope):
    """Without friction it keeps its speed to 1e-9; on a slope it is as fast as on the half-space."""
    vertices, triangles = random_flat(seed)
    turn = np.array([[np.cos(slope), 0, np.sin(slope)], [0, 1, 0], [-np.sin(slope), 0, np.cos(slope)]])
    ends = []
    for add in (
        lambda scene: scene.add_surface(vertices, triangles, rotation=turn, one_sided=True),
        lambda scene: scene.add_halfspace(turn[:, 2]),
    ):
        scene = mbvi.Scene()
        add(scene)
        start = turn @ np.array([-1.2, 0.1 * seed, 0.1])
        scene.add_sphere(0.1, mass=1.0, position=start, velocity=turn @ np.array([1.0, 0.37, 0.0]))
        ends.append(mbvi.simulate(scene.build(), mbvi.Centered(), step=5e-3, duration=0.8))
    np.testing.assert_allclose(ends[0].v, ends[1].v, atol=1e-9)
    np.testing.assert_allclose(ends[0].q, ends[1].q, atol=1e-9)
    if not slope:
        np.testing.assert_allclose(np.linalg.norm(ends[0].v, axis=1), np.hypot(1.0, 0.37), rtol=1e-9)


@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_a_centre_behind_a_field_is_pushed_back_and_that_behind_a_sheet_is_not(friction):
    problem = field_with_balls(plane_of(9), [0.3, 0.1, 0.1], friction=friction)
    family, q = problem.constraints.constraints[0], problem.q0.copy()
    for depth in (0.0, 0.02, 0.1, 0.12, 0.1499):
        q[2] = 0.1 - depth
        rows = family.contacts(0.0, q, 0.0)
        np.testing.assert_allclose(rows.gap, -depth, atol=1e-14)
        np.testing.assert_allclose(rows.normal, np.tile([0, 0, 1.0], (len(rows.gap), 1)), atol=1e-12)
    # farther down the ball is below the field, which is a ceiling for it
    q[2] = -0.0501
    rows = family.contacts(0.0, q, 0.0)
    np.testing.assert_allclose(rows.normal[0], [0, 0, -1.0], atol=1e-12)
    np.testing.assert_allclose(rows.gap, 0.0501 - 0.1, atol=1e-14)
    scene = mbvi.Scene(friction=friction)
    scene.add_surface(*surfaces.terrain([-1, 1], [-1, 1], np.zeros((2, 2))))
    scene.add_sphere(0.1, position=(0.3, 0.1, 0.1))
    family, q[2] = scene.build().constraints.constraints[0], -0.02
    np.testing.assert_allclose(family.contacts(0.0, q, 0.0).normal[0], [0, 0, -1.0], atol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_the_distance_from_a_closed_mesh_has_its_sign_everywhere(seed):
    """Against the faces of a convex mesh, on which corners and edges have signs of their own."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(12, 3))
    hull = mbvi.geometry.shapes.shapes.Hull(points / np.linalg.norm(points, axis=1)[:, None])
    normals, offsets = hull.faces
    scene = mbvi.Scene()
    surface = Surface(hull.vertices, hull.triangles, None)
    assert surface.one_sided and surface.closed
    scene.add_surface(hull.vertices, hull.triangles, one_sided=True)
    centres = rng.uniform(-1.4, 1.4, (200, 3))
    scene.add_spheres(np.arange(200)[:, None] * [0, 0, 3.0] + [0, 0, 9.0], 0.01, mass=1.0)
    gap = scene.build().constraints.constraints[0].gap(0.0, centres.ravel()) + 0.01
    inside = (centres @ normals.T - offsets).max(axis=1)
    assert (np.sign(gap) == np.sign(inside)).all() and (inside < 0).sum() > 5
    np.testing.assert_allclose(gap[inside < 0], inside[inside < 0], atol=1e-12)


@pytest.mark.parametrize("h", [1e-3, 1e-2])
@pytest.mark.parametrize("seed", range(4))
def test_nothing_falls_through_at_50_metres_a_second(h, seed):
    """Onto rough fields, upright and aslant, from far and near, and again after each bounce."""
    rng = np.random.default_rng(seed)
    heights = rng.uniform(0.0, 0.3, (17, 17))
    start = np.concatenate([rng.uniform(-0.5, 0.5, (4, 2)), rng.uniform(0.9, 3.0, (4, 1))], axis=1)
    start += np.arange(4)[:, None] * [0, 0, 0.3]
    problem = field_with_balls(heights, start, radius=0.05, velocity=(6.0, -4.0, -50.0), restitution=0.2)
    run = mbvi.simulate(problem, mbvi.Paoli(), step=h, duration=0.1)
    x, y, z = run.q.reshape(len(run.t), -1, 3).transpose(2, 0, 1)
    within = (np.abs(x) < 1.95) & (np.abs(y) < 1.95)
    assert within.mean() > 0.9 and z[within].min() > 0.0 and len(run.impacts) >= 4


@pytest.mark.parametrize("h", [1e-3, 1e-2])
def test_a_swift_ball_does_not_pass_a_sheet_either(h):
    scene = mbvi.Scene(restitution=0.5)
    scene.add_surface(*surfaces.terrain([-1, 0, 1], [-1, 1], np.zeros((3, 2))))
    scene.add_sphere(0.02, position=(0.1, 0.1, 1.0), velocity=(0, 0, -50.0))
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=h, duration=0.05)
    # 1 - r - v t at the impact, then half of the speed up
    exact = 0.02 + 25.0 * (0.05 - 0.98 / 50.0)
    assert run.q[-1, 2] == pytest.approx(exact, abs=0.04)


def test_what_rolls_over_the_rim_falls_off_beside_the_field():
    problem = field_with_balls(np.zeros((3, 3)), [1.9, 0.0, 0.1], velocity=(0.5, 0.0, 0.0))
    run = mbvi.simulate(problem, mbvi.Centered(), step=2e-3, duration=1.0)
    x, _, z = run.q.T
    assert x[-1] > 2.0 and z[-1] < -0.5
    assert np.linalg.norm(run.v, axis=1).max() < np.sqrt(0.25 + 2 * G * (0.1 - z[-1])) + 1e-2


@pytest.mark.parametrize("angle", [0.02, 0.3])
@pytest.mark.parametrize("across", [0.0, 0.4])
def test_at_an_inner_edge_a_ball_loses_the_speed_into_the_next_face_and_no_more(angle, across):
    """Without gravity: from a flat face onto one that rises by an angle, at e = 0."""
    scene = mbvi.Scene(gravity=(0, 0, 0))
    heights = np.array([0.0, 0.0, np.tan(angle)])
    scene.add_heightfield(np.tile(heights, (5, 1)), (2.0, 2.0))
    scene.add_sphere(0.1, mass=1.0, position=(-0.5, -0.3, 0.1), velocity=(1.0, across, 0.0))
    run = mbvi.simulate(scene.build(), mbvi.Centered(), step=1e-3, duration=1.0)
    up = np.array([np.cos(angle), 0.0, np.sin(angle)])
    np.testing.assert_allclose(run.v[-1], np.cos(angle) * up + [0, across, 0], atol=1e-9)
    assert [impact.constraints for impact in run.impacts] == [("sphere | field",)]


def test_over_an_outer_edge_a_slow_ball_loses_nothing():
    """It turns about the edge while gravity holds it there, and keeps its energy."""
    angle, r, speed = 0.3, 0.2, 0.3
    problem = field_with_balls(
        np.tile([0.0, 0.0, -np.tan(angle)], (5, 1)), [-0.05, 0.0, r], r, (2.0, 2.0), (speed, 0, 0)
    )
    run = mbvi.simulate(problem, mbvi.Centered(), step=2e-4, duration=0.5)
    energy = 0.5 * (run.v**2).sum(axis=1) + G * run.q[:, 2]
    # the scheme's own error of second order
    assert run.q[-1, 0] > 0.1 and np.abs(energy - energy[0]).max() < 1e-3 * 0.5 * speed**2


def bowl(points):
    x = np.linspace(-0.7, 0.7, points)
    return 1.0 - np.sqrt(1.0 - np.add.outer(x**2, x**2))


def test_a_bowl_of_triangles_is_that_of_the_sphere_at_order_2_of_its_mesh():
    """The gaps along the exact path of a pendulum."""
    angle, worst = np.linspace(-0.5, 0.5, 101), []
    path = np.stack([0.9 * np.sin(angle) * np.cos(0.3), 0.9 * np.sin(angle) * np.sin(0.3), 1 - 0.9 * np.cos(angle)], 1)
    for points in (15, 29, 57, 113):
        family = field_with_balls(bowl(points), [0, 0, 0.8], size=(1.4, 1.4)).constraints.constraints[0]
        worst.append(max(abs(family.gap(0.0, q)[0]) for q in path))
    ratios = np.array(worst[:-1]) / worst[1:]
    assert (ratios > 3.9).all() and worst[-1] < 5e-5


@pytest.mark.slow(seconds=10)
def test_the_energy_lost_in_a_bowl_falls_at_order_1_of_its_mesh():
    """A mesh of half the width has twice the inner edges, each of half the angle and a quarter of the loss."""
    start, lost = np.array([0.9 * np.sin(0.5), 0.0, 1 - 0.9 * np.cos(0.5)]), []
    turn = np.array([[np.cos(0.3), -np.sin(0.3), 0], [np.sin(0.3), np.cos(0.3), 0], [0, 0, 1]])
    for points in (15, 29, 57):
        scene = mbvi.Scene()
        scene.add_heightfield(bowl(points), (1.4, 1.4))
        scene.add_sphere(0.1, mass=1.0, position=turn @ start)
        run = mbvi.simulate(scene.build(resolve=True), mbvi.Centered(), step=5e-4, duration=0.8)
        energy = 0.5 * (run.v**2).sum(axis=1) + G * run.q[:, 2]
        lost.append(energy[0] - energy[-1])
    ratios = np.array(lost[:-1]) / lost[1:]
    assert ((ratios > 1.6) & (ratios < 2.4)).all() and 0.0 < lost[-1] < 0.025


# exact values


def test_a_field_has_its_corners_where_they_are_said_to_be_and_its_diagonal():
    z = np.arange(12.0).reshape(3, 4) ** 2 / 100
    surface = height_field(z, (3.0, 1.0))
    for i in range(3):
        for j in range(4):
            place = [-1.5 + j, -0.5 + 0.5 * i, z[i, j]]
            assert np.abs(surface.vertices - place).max(axis=1).min() < 1e-15
    a, b, c = surface.vertices[surface.triangles].transpose(1, 0, 2)
    assert (np.cross(b - a, c - a)[:, 2] > 0.0).all()
    # over the middle of the first cell
    scene = mbvi.Scene()
    scene.add_heightfield(z, (3.0, 1.0), position=(1.0, 2.0, 3.0))
    scene.add_sphere(0.01, position=(0.0, 1.75, 3.5))
    problem = scene.build()
    # the middle of a cell is on its diagonal
    middle = 0.5 * (z[0, 0] + z[1, 1])
    for above, sign in ((1e-9, 1), (-1e-9, -1)):
        gap = problem.constraints.gap(0.0, np.array([0.0, 1.75, 3.0 + middle + above]))[0] + 0.01
        assert np.sign(gap) == sign and abs(gap) < 2e-9


@pytest.mark.parametrize("shape", [(2, 2), (2, 5), (4, 3), (7, 9)])
def test_what_is_known_of_a_grid_is_what_is_found_in_any_mesh(shape):
    z = np.random.default_rng(1).uniform(0, 1, shape)
    field = height_field(z, (2.0, 1.0))
    found = Surface(field.vertices, field.triangles, None)
    assert not found.one_sided and field.one_sided and not field.closed
    np.testing.assert_array_equal(np.bincount(field.features.ravel()), field.sharers)
    np.testing.assert_array_equal(np.sort(field.sharers), np.sort(found.sharers))
    known = field.rim
    del field.__dict__["rim"]
    np.testing.assert_array_equal(field.rim, known)
    assert np.array_equal(np.sort(field.tree.order), np.arange(len(field.triangles)))
    np.testing.assert_array_equal(field.tree.boxes[1], tree_of(field.vertices, field.triangles).boxes[1])
    # each triangle is within its box
    leaves = len(field.tree.boxes) // 2
    corners = field.vertices[field.triangles[field.tree.order]]
    box = field.tree.boxes[leaves + np.arange(len(corners)) // 4]
    assert (corners.min(axis=1) >= box[:, :3]).all() and (corners.max(axis=1) <= box[:, 3:]).all()


@pytest.mark.parametrize("shape", ["box", "hull", "capsule", "cylinder"])
def test_a_start_with_a_hill_inside_a_body_is_refused_however_deep(shape):
    """A pointed hill 0.5 m high comes from below into a body of 0.3 m, whose other points are above the ground."""
    heights = np.zeros((5, 5))
    heights[2, 2] = 0.5
    for depth in (-0.01, 0.01, 0.05, 0.1, 0.15, 0.2, 0.25):
        scene, place = mbvi.Scene(), (0.01, 0.02, 0.65 - depth)
        scene.add_heightfield(heights, size=(4.0, 4.0), name="hill")
        if shape == "box":
            scene.add_box((0.5, 0.5, 0.3), 1.0, position=place)
        elif shape == "hull":
            corners = np.array([(x, y, z) for x in (-0.25, 0.25) for y in (-0.25, 0.25) for z in (-0.15, 0.15)])
            scene.add_convex(corners, [place], 1.0)
        elif shape == "capsule":
            turn = (np.sqrt(0.5), 0, 0, np.sqrt(0.5))
            scene.add_capsule(0.15, 0.4, 1.0, position=place, rotation=turn)
        else:
            scene.add_cylinder(0.3, 0.3, 1.0, position=place)
        if depth < 0.0:
            scene.build()
            continue
        with pytest.raises(mbvi.InadmissibleStartError, match=r"hill (reaches deep into|penetrates)"):
            scene.build()
