"""Rows of shapes on terrain: few for each patch of it, in an order that lasts while they slide."""

import numpy as np
import pytest
from scipy.spatial import Delaunay
from scipy.spatial.transform import Rotation

import mbvi

# the angle of the normals of one patch is 0.1 rad
PATCH, MOST = np.cos(0.1), 8
SCHEMES = [mbvi.Paoli(), mbvi.Centered(project_positions=True), mbvi.MoreauJean(), mbvi.StewartTrinkle()]
KINDS = ["box", "capsule", "cylinder", "ball", "foot"]


def add_ground(scene, rng, noise, grid):
    """A field, or a mesh in triangles of all shapes, whose heights are drawn."""
    line = np.linspace(-1.5, 1.5, 61)
    heights = noise * rng.standard_normal((61, 61))
    if grid:
        scene.add_heightfield(heights, size=(3.0, 3.0), name="ground")
        return
    x, y = np.meshgrid(line, line)
    place = np.column_stack([x.ravel(), y.ravel()])
    place += 0.02 * rng.uniform(-1, 1, place.shape)
    corner = Delaunay(place).simplices
    a, b, c = place[corner].transpose(1, 0, 2)
    turned = np.linalg.det(np.stack([b - a, c - a], axis=1)) < 0.0
    corner = np.where(turned[:, None], corner[:, ::-1], corner)
    scene.add_surface(np.column_stack([place, heights.ravel()]), corner, one_sided=True, name="ground")


def add_body(scene, kind, rng, turned, velocity):
    """Large shapes, lying level or turned at random; of a ball the lower half is round, so it has few rows anyhow."""
    turn = Rotation.random(rng=rng).as_matrix() if turned else np.eye(3)
    given = {"mass": 1.0, "velocity": velocity, "name": "body"}
    match kind:
        case "box":
            scene.add_box((0.9, 0.6, 0.3), position=(0, 0, 0.6 if turned else 0.16), rotation=turn, **given)
        case "capsule":
            lying = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
            scene.add_capsule(0.15, 0.9, position=(0, 0, 0.16), rotation=lying, **given)
        case "cylinder":
            scene.add_cylinder(0.3, 0.3, position=(0, 0, 0.4 if turned else 0.16), rotation=turn, **given)
        case "ball":
            scene.add_sphere(0.2, position=(0, 0, 0.21), **given)
        case "foot":
            # a sole of many corners, wider above
            angle = 2 * np.pi * np.arange(24) / 24
            ring = np.column_stack([0.3 * np.cos(angle), 0.15 * np.sin(angle)])
            points = np.vstack([np.column_stack([s * ring, np.full(24, z)]) for s, z in ((1.0, 0.0), (1.1, 0.05))])
            given["velocities"] = [given.pop("velocity")]
            scene.add_convex(points, [(0, 0, 0.5 if turned else 0.01)], rotations=[turn], **given)


def largest_patch(normals, gaps):
    """The most rows about the deepest one that belongs to no patch yet."""
    left, most = list(np.argsort(gaps, kind="stable")), 0
    while left:
        near = [i for i in left if normals[i] @ normals[left[0]] > PATCH]
        left, most = [i for i in left if i not in near], max(most, len(near))
    return most


def most_near_rows(problem, scheme, noise):
    """Run, and look at what is pressed, what touches, and what is near; return the most rows of one state."""
    run, most = mbvi.simulate(problem, scheme, step=2e-3, duration=0.1, record="contacts", progress=False), 0
    for t, q in list(zip(run.t, run.q, strict=True))[1::5]:
        pressed = run.contacts(t)
        if pressed:
            assert largest_patch(np.array([c.normal for c in pressed]), np.zeros(len(pressed))) <= MOST
        for reach in (1e-9, 2e-3):
            rows = problem.constraints.active(t, q, reach)
            if rows is not None and len(rows.gap):
                assert largest_patch(rows.normal, rows.gap) <= MOST
                most = max(most, len(rows.gap))
                # on nearly level ground all of it is one patch
                assert noise > 1e-4 or len(rows.gap) <= MOST
    return most


@pytest.mark.parametrize("kind", KINDS)
def test_no_patch_of_terrain_has_more_than_eight_rows(kind):
    seen = np.zeros(len(SCHEMES))
    for noise in (0.0, 1e-9, 1e-6, 1e-4, 1e-3, 5e-3):
        for case in range(4):
            rng = np.random.default_rng([KINDS.index(kind), case])
            scene = mbvi.Scene(friction=0.5 * (case // 2))
            add_ground(scene, rng, noise, grid=bool(case % 2))
            add_body(scene, kind, rng, case == 1, (0.8, 0.3, -0.5))
            problem = scene.build(resolve=True)
            seen = np.maximum(seen, [most_near_rows(problem, scheme, noise) for scheme in SCHEMES])
    assert seen.min() >= (1 if kind == "ball" else 3)


@pytest.mark.parametrize("grid", [True, False])
@pytest.mark.parametrize("kind", ["box", "capsule", "cylinder", "foot"])
def test_rows_keep_their_order_while_a_shape_slides(kind, grid):
    """The same place of the rows is the same point of the shape, whatever triangles this is on."""
    rng = np.random.default_rng(1)
    scene = mbvi.Scene()
    add_ground(scene, rng, 0.0, grid)
    add_body(scene, kind, rng, False, (0.0, 0.0, 0.0))
    problem = scene.build()
    rows = problem.constraints.active(0.0, problem.q0, 0.02)
    first = rows.point - problem.q0[:3]
    assert len(first) == {"box": 4, "capsule": 2, "cylinder": 8, "foot": 8}[kind]
    for way in np.linspace(0.0, 0.4, 60):
        q = problem.q0.copy()
        q[:2] += way * np.array([0.9, 0.4])
        found = problem.constraints.active(0.0, q, 0.02)
        np.testing.assert_allclose(found.point - q[:3], first, atol=1e-9)


def test_a_field_that_is_nearly_flat_bears_a_body_as_the_flat_one():
    """With 8 rows of some 70; a percussion of each would be the same in sum."""
    ends = []
    for noise in (0.0, 1e-7):
        rng = np.random.default_rng(2)
        scene = mbvi.Scene(friction=0.3)
        add_ground(scene, rng, noise, True)
        add_body(scene, "cylinder", rng, False, (0.8, 0.3, 0.0))
        run = mbvi.simulate(scene.build(resolve=True), mbvi.Paoli(), step=2e-3, duration=0.3, progress=False)
        ends.append(run.v[-1])
    np.testing.assert_allclose(*ends, atol=1e-3)
