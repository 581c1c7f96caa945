"""Fixed shapes side by side: bodies touch the surface of their union, and not the sides that face each other."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import mbvi
from mbvi import motion
from mbvi.geometry.shapes.seams import is_covered, seams_of
from mbvi.geometry.shapes.shapes import Box, PlacedShape
from mbvi.run.fixed_steps import taking

SCHEMES = [mbvi.Centered(project_positions=True), mbvi.StewartTrinkle(), mbvi.Paoli()]
TURNED = Rotation.from_rotvec([0.3, 0.2, 0.5]).as_matrix()
LYING = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])


def scene_on_bricks(frame, edge=0.25, friction=0.0, rows=6):
    """A scene with a floor of bricks, each row shifted by half of one, in a turned frame with its gravity."""
    scene = mbvi.Scene(gravity=-9.81 * frame[:, 2], friction=friction)
    for i, j in itertools.product(range(-2, 7), range(-2, rows - 2)):
        at = np.array([edge * (i + 0.5 * (j % 2)), edge * j, -0.05])
        scene.add_box((edge, edge, 0.1), position=frame @ at, rotation=frame, fixed=True)
    return scene


def add_body(scene, kind, frame, velocity):
    moving = {"mass": 1.0, "velocity": frame @ velocity, "name": "body"}
    at, turned = np.array([0.02, 0.01, 0.05]), Rotation.from_euler("z", 0.3).as_matrix()
    match kind:
        case "box":
            scene.add_box((0.2, 0.3, 0.1), position=frame @ at, rotation=frame @ turned, **moving)
        case "capsule":
            scene.add_capsule(0.05, 0.2, position=frame @ at, rotation=frame @ turned @ LYING, **moving)
        case "cylinder":
            scene.add_cylinder(0.07, 0.1, position=frame @ at, rotation=frame, **moving)
        case "ball":
            scene.add_sphere(0.05, position=frame @ at, **moving)


@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
@pytest.mark.parametrize("kind", ["box", "capsule", "cylinder", "ball"])
def test_a_body_slides_over_tiles_without_loss(kind, scheme):
    scene = scene_on_bricks(TURNED)
    add_body(scene, kind, TURNED, np.array([1.0, 0.2, 0.0]))
    run = mbvi.simulate(scene.build(), scheme, step=2e-3, duration=0.6)
    np.testing.assert_allclose(TURNED.T @ run.v[-1, :3], [1.0, 0.2, 0.0], atol=1e-9)
    np.testing.assert_allclose(run.v[-1, 3:], 0.0, atol=1e-8)
    assert not run.impacts


MOTIONS = {
    "translation": lambda: motion.Translation((0.4, -0.3, 0.0)),
    "oscillation": lambda: motion.Oscillation((0.02, 0.01, 0.0), 3.0, 0.1),
    "rotation": lambda: motion.Rotation((0, 0, 2.0), 0.7, (0.3, 0, 0)),
}


@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
@pytest.mark.parametrize("moves", MOTIONS)
def test_tiles_whose_motions_are_equal_are_one_surface(moves, scheme):
    """The same as tiles that share one motion, to the byte, and as one half-space that moves so; beside a field too."""
    made, one, runs = MOTIONS[moves], MOTIONS[moves](), []
    for kind in ("shared", "equal", "half-space"):
        scene = mbvi.Scene()
        if kind == "half-space":
            scene.add_halfspace((0, 0, 1), motion=one)
        else:
            for i, j in itertools.product(range(-2, 8), range(-3, 4)):
                tile = one if kind == "shared" else made()
                scene.add_box((0.25, 0.25, 0.1), position=(0.25 * i, 0.25 * j, -0.05), motion=tile)
            field = one if kind == "shared" else made()
            scene.add_heightfield(np.zeros((3, 3)), size=(1.0, 1.75), position=(-1.125, 0, 0), motion=field)
        add_body(scene, "box", np.eye(3), np.array([-1.5, 0.2, 0.0]))
        runs.append(mbvi.simulate(scene.build(), scheme, step=2e-3, duration=0.4))
    shared, equal, plane = runs
    assert np.array_equal(shared.q, equal.q) and np.array_equal(shared.v, equal.v)
    np.testing.assert_allclose(equal.q, plane.q, rtol=0.0, atol=1e-8)


@pytest.mark.parametrize("speed", [1e-3, 50.0])
def test_neither_a_slow_nor_a_swift_body_meets_the_side_of_a_tile(speed):
    scene = scene_on_bricks(np.eye(3))
    add_body(scene, "box", np.eye(3), np.array([speed, 0.0, 0.0]))
    run = mbvi.simulate(scene.build(), step=1e-3, duration=0.02)
    np.testing.assert_allclose(run.v[-1], [speed, 0, 0, 0, 0, 0], atol=1e-9 * speed)


def floors(friction=0.0, edge=0.25, **counts):
    """A scene on bricks, and one on a half-space."""
    flat = mbvi.Scene(friction=friction)
    flat.add_halfspace((0, 0, 1))
    return scene_on_bricks(np.eye(3), edge, friction, **counts), flat


def test_friction_on_tiles_is_that_of_a_half_space():
    ends = []
    for scene in floors(friction=0.3):
        add_body(scene, "box", np.eye(3), np.array([1.0, 0.2, 0.0]))
        ends.append(mbvi.simulate(scene.build(), step=1e-3, duration=0.2).v[-1])
    np.testing.assert_allclose(ends[0][:3], ends[1][:3], atol=1e-9)


@pytest.mark.parametrize("loop", [True, False])
@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
def test_a_ball_with_friction_passes_from_tile_to_tile(scheme, loop, monkeypatch):
    """Its contact at the end of a step is with the next tile, of which the middle of the step knows nothing."""
    if not loop:
        monkeypatch.setattr(taking, "compiled_loop", lambda *_: None)
    for speed in (3.1, 4.4, 5.2, 7.6):
        ends = []
        for tiled in (True, False):
            scene = mbvi.Scene(friction=0.3, restitution=0.0)
            if tiled:
                scene.add_box((3, 4, 0.2), fixed=True, position=(-1.5, 0, -0.1))
                scene.add_box((3, 4, 0.3), fixed=True, position=(1.5, 0, -0.15))
            else:
                scene.add_halfspace((0, 0, 1))
            scene.add_sphere(0.1, position=(-0.13, 0, 0.1), velocity=(speed, 0, 0))
            run = mbvi.simulate(scene.build(), scheme, step=2e-3, duration=0.1)
            ends.append((run.q[-1, :3], run.v[-1]))
        np.testing.assert_allclose(ends[0][0], ends[1][0], atol=1e-12)
        np.testing.assert_allclose(ends[0][1], ends[1][1], atol=1e-10)


def add_field(scene, frame, along):
    """A flat field that leads to a box, or one that is cut from a mesh with a rim of other triangles."""
    place, turn = frame @ np.array([-1.0, 0.0, 0.0]), frame
    if along == "field":
        scene.add_heightfield(np.zeros((5, 5)), size=(2.0, 2.0), position=place, rotation=turn)
        return
    x, y = (part.ravel() for part in np.meshgrid([-1.0, -0.3, 1.0], [-1.0, 0.07, 1.0]))
    number = np.arange(9).reshape(3, 3)
    a, b, c, d = (part.ravel() for part in (number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]))
    corners = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    vertices = np.column_stack([x, y, np.zeros(9)])
    scene.add_surface(vertices, corners, one_sided=True, position=place, rotation=turn)


@pytest.mark.parametrize("scheme", [*SCHEMES, mbvi.MoreauJean()], ids=repr)
@pytest.mark.parametrize("kind", ["box", "capsule", "cylinder", "ball"])
@pytest.mark.parametrize("along", ["field", "mesh"])
def test_a_body_slides_from_terrain_onto_a_box_beside_it(along, kind, scheme):
    scene = mbvi.Scene(gravity=-9.81 * TURNED[:, 2])
    add_field(scene, TURNED, along)
    scene.add_box((2.0, 2.0, 0.4), position=TURNED @ [1.0, 0.0, -0.2], rotation=TURNED, fixed=True)
    turn = Rotation.from_euler("z", 0.3).as_matrix()
    moving = {"mass": 1.0, "velocity": TURNED @ [1.3, 0.1, 0.0], "name": "body"}
    at = TURNED @ [-0.4, 0.03, 0.1 if kind == "ball" else 0.05]
    match kind:
        case "box":
            scene.add_box((0.2, 0.3, 0.1), position=at, rotation=TURNED @ turn, **moving)
        case "capsule":
            scene.add_capsule(0.05, 0.2, position=at, rotation=TURNED @ turn @ LYING, **moving)
        case "cylinder":
            scene.add_cylinder(0.1, 0.1, position=at, rotation=TURNED, **moving)
        case "ball":
            scene.add_sphere(0.1, position=at, **moving)
    run = mbvi.simulate(scene.build(), scheme, step=2e-3, duration=0.5)
    np.testing.assert_allclose(TURNED.T @ run.v[-1, :3], [1.3, 0.1, 0.0], atol=1e-9)
    np.testing.assert_allclose(run.v[-1, 3:], 0.0, atol=1e-8)
    assert not run.impacts


def test_a_box_that_stands_out_of_a_field_is_in_the_way():
    scene = mbvi.Scene()
    add_field(scene, np.eye(3), "field")
    scene.add_box((2.0, 2.0, 0.4), position=(1.0, 0.0, -0.17), fixed=True)
    scene.add_box((0.2, 0.3, 0.1), position=(-0.4, 0.03, 0.05), mass=1.0, velocity=(1.3, 0.0, 0.0))
    run = mbvi.simulate(scene.build(), mbvi.StewartTrinkle(), step=2e-3, duration=0.5)
    assert run.impacts and run.q[-1, 0] < 0.0


def test_many_spheres_roll_over_tiles_without_loss():
    scene = scene_on_bricks(np.eye(3))
    for i, j in itertools.product(range(6), range(6)):
        scene.add_sphere(0.02, mass=1.0, position=(0.1 * i, 0.1 * j - 0.3, 0.02), velocity=(1.0, 0.1, 0.0))
    problem = scene.build()
    assert "in bulk" in str(problem.report())
    run = mbvi.simulate(problem, step=2e-3, duration=0.4)
    np.testing.assert_allclose(run.v[-1].reshape(-1, 3), np.tile([1.0, 0.1, 0.0], (36, 1)), atol=1e-9)


def test_a_robot_slides_on_tiles_as_on_a_half_space():
    ends = []
    for scene in floors(edge=0.4, rows=5):
        scene.add_urdf("robot:quadruped", position=(0.3, 0.2, 0.45))
        problem = scene.build()
        v = problem.v0.copy()
        v[:2] = 1.0, 0.3
        run = mbvi.simulate(problem.at(problem.q0, v), mbvi.Paoli(), step=1e-3, duration=0.4)
        assert run.impacts
        ends.append(run.v[-1])
    np.testing.assert_allclose(*ends, atol=1e-7)


# `Centered` projects positions in the step of the impact onto other rows than those of a half-space
@pytest.mark.parametrize(("scheme", "tolerance"), list(zip(SCHEMES, [1e-4, 1e-9, 1e-9], strict=True)), ids=repr)
def test_a_tile_that_stands_out_is_in_the_way(scheme, tolerance):
    ends = []
    for scene in floors():
        scene.add_box((0.25, 4.0, 0.1), position=(0.8, 0.0, -0.02), fixed=True)
        scene.add_box((0.2, 0.3, 0.1), mass=1.0, position=(0.3, 0.0, 0.05), velocity=(1.0, 0.0, 0.0), name="body")
        run = mbvi.simulate(scene.build(), scheme, step=1e-3, duration=0.5)
        # it strikes low, and tips
        assert run.impacts and abs(run.q[-1, 0] - (0.8 - 0.125 - 0.1)) < 0.01
        ends.append(np.concatenate([run.q[-1], run.v[-1]]))
    np.testing.assert_allclose(*ends, atol=tolerance)


def test_a_ball_rolls_down_a_ramp_onto_the_floor():
    # energy is lost at the concave edge only: there the velocity keeps its part along the floor
    scene, slope = mbvi.Scene(), 0.4
    scene.add_box((4.0, 1.0, 0.2), position=(0.0, 0.0, -0.1), fixed=True, name="floor")
    turn = Rotation.from_euler("y", slope).as_matrix()
    scene.add_box((2.0, 1.0, 0.2), position=turn @ [-1.0, 0.0, -0.1], rotation=turn, fixed=True, name="ramp")
    scene.add_sphere(0.05, mass=1.0, position=turn @ np.array([-0.5, 0.0, 0.05]))
    run = mbvi.simulate(scene.build(), step=1e-3, duration=1.0)
    # from the height of the contact above the concave edge: the centre stops along the ramp at r tan(slope / 2)
    fall = 0.5 - 0.05 * np.tan(slope / 2)
    assert abs(run.v[-1, 0] - np.cos(slope) * np.sqrt(2 * 9.81 * np.sin(slope) * fall)) < 5e-3
    assert abs(run.v[-1, 2]) < 1e-6


@pytest.mark.parametrize("depth", [1e-7, 1e-5, 1e-3])
def test_a_plate_that_has_sunk_into_a_corner_is_pushed_out_of_both_faces(depth):
    # overlapping walls, as the plates of a drum: the point of contact of each lies within the other
    scene = mbvi.Scene()
    scene.add_box((1.0, 1.0, 0.2), position=(0.0, 0.0, -0.1), fixed=True, name="floor")
    scene.add_box((0.2, 1.0, 1.0), position=(0.4, 0.0, 0.2), fixed=True, name="wall")
    # the narrow end of a thin plate points into the corner
    long, thin = 0.2, 0.2 * depth
    scene.add_box((long, 0.1, thin), mass=1.0, position=(0, 0, 0.3), rotation=(0, np.pi / 4, 0), name="plate")
    problem = scene.build()
    q, reach = problem.q0.copy(), (long + thin) / np.sqrt(8.0)
    q[:3] = 0.3 + depth - reach, 0.0, reach - depth
    rows = problem.constraints.active(0.0, q, 1e-9)
    assert {problem.constraints.name(k) for k in rows.constraint} == {"floor | plate", "wall | plate"}


def unions():
    """Boxes with corners on a grid of whole numbers, of which some touch or overlap."""
    corner = st.tuples(*3 * [st.integers(0, 2)])
    edges = st.tuples(*3 * [st.integers(1, 2)])
    return st.lists(st.tuples(corner, edges), min_size=2, max_size=4)


def inside(boxes, points):
    """Whether points, shape (k, 3), lie in one of the boxes."""
    return np.any([((points > low) & (points < low + size)).all(axis=1) for low, size in boxes], axis=0)


@given(unions(), st.data())
def test_covered_contacts_are_those_without_limiting_normal(boxes, data):
    boxes = [(np.array(low, float), np.array(size, float)) for low, size in boxes]
    placed = [
        PlacedShape(f"{k}", Box(tuple(size)), 0, np.eye(3), low + size / 2) for k, (low, size) in enumerate(boxes)
    ]
    seams = seams_of(placed)
    if not len(seams.neighbour):
        return
    low, size = boxes[0]
    # a point of the first box at quarters of its edges, and a normal of one of its faces, edges or corners there
    share = np.array(data.draw(st.tuples(*3 * [st.sampled_from([0.0, 0.25, 0.75, 1.0])])))
    ends = np.flatnonzero((share == 0.0) | (share == 1.0))
    chosen = [c for c in ends if data.draw(st.booleans())]
    if not chosen:
        return
    normal = np.zeros(3)
    normal[chosen] = 2.0 * share[chosen] - 1.0
    normal /= np.linalg.norm(normal)
    point, rng = low + share * size, np.random.default_rng(0)
    toward = rng.normal(size=(400, 3))
    toward /= np.linalg.norm(toward, axis=1)[:, None]
    ahead = toward[toward @ normal > 0.05]
    # regular at a point: no step along it enters the union; limiting: regular at points of the same face next to it
    beside = np.array(list(itertools.product([-1e-3, 0.0, 1e-3], repeat=3)))
    beside = beside[(np.abs(beside[:, chosen]) == 0.0).all(axis=1)] + point
    beside = beside[((beside >= low) & (beside <= low + size)).all(axis=1)]
    limiting = any(not inside(boxes, p + 1e-5 * ahead).any() for p in beside)
    assert is_covered(seams, 0, 0.0, point, normal, 1.0) == (not limiting)
