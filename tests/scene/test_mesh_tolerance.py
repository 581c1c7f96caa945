"""What `add_urdf(tolerance=...)` makes of a robot's meshes, and that a file keeps it."""

import json
from itertools import pairwise

import numpy as np
import pytest

import mbvi
from mbvi.geometry.shapes.shapes import Box, Hull
from mbvi.scene.saved.description import describe, restore

LINK = """<link name="{name}">
<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry><mesh filename="{mesh}"/></geometry></collision></link>"""
JOINT = """<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{name}"/><origin xyz="1 0 0"/>
<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>"""
BOX = np.array([[x, y, z] for x in (-0.1, 0.1) for y in (-0.15, 0.15) for z in (-0.05, 0.05)])


def write(path, points):
    hull = Hull(points)
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in hull.vertices.tolist()]
    lines += ["f " + " ".join(str(k + 1) for k in t) for t in hull.triangles.tolist()]
    path.write_text("\n".join(lines) + "\n")
    return hull


@pytest.fixture
def robot(tmp_path, rng):
    """A robot of four links: a rough stone, a bevelled box, and these again."""
    points = rng.normal(size=(40, 3))
    stone = 0.1 * np.repeat(points / np.linalg.norm(points, axis=1)[:, None], 4, axis=0)
    write(tmp_path / "stone.obj", stone + 2e-6 * rng.normal(size=(160, 3)))
    write(tmp_path / "block.obj", np.concatenate([BOX * (1 - 5e-5 * np.eye(3)[k]) for k in range(3)]))
    parts = [("root", "stone"), ("block", "block"), ("twin", "stone"), ("end", "block")]
    text = "".join(LINK.format(name=name, mesh=tmp_path / f"{mesh}.obj") for name, mesh in parts)
    names = [name for name, _ in parts]
    text += "".join(JOINT.format(name=b, parent=a) for a, b in pairwise(names))
    (tmp_path / "robot.urdf").write_text(f'<robot name="robot">{text}</robot>')
    return tmp_path / "robot.urdf"


def built(path, **options):
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1), -1.0)
    scene.add_urdf(path, **options)
    return scene.build()


def hulls(path):
    """Return the hulls of the file, by link."""
    return {s.name: s.shape for s in built(path).scene.items.robots[0].robot.shapes}


def shapes(problem):
    return {s.name: s.shape for s in problem.scene.shapes}


def test_zero_is_exact(robot):
    problem = built(robot, tolerance=0)
    for name, shape in shapes(problem).items():
        np.testing.assert_array_equal(shape.vertices, hulls(robot)[name].vertices)
    assert "replaced by its convex hull of" in problem.report() and "replaced by a " not in problem.report()


def test_the_default_is_a_ten_thousandth_of_each_size(robot):
    problem = built(robot)
    kinds = {name: type(shape) for name, shape in shapes(problem).items()}
    assert kinds == {"robot/root": Hull, "robot/block": Box, "robot/twin": Hull, "robot/end": Box}
    stone = hulls(robot)["robot/root"]
    size = np.linalg.norm(stone.vertices - stone.mass_properties(1.0)[0], axis=1).max()
    same = shapes(built(robot, tolerance=1e-4 * size))
    np.testing.assert_array_equal(shapes(problem)["robot/root"].vertices, same["robot/root"].vertices)
    # less in metres than what the box takes
    assert isinstance(shapes(built(robot, tolerance=1e-7))["robot/block"], Hull)


def test_the_report_states_what_was_reduced(robot):
    problem = built(robot)
    before, after = (len(s["robot/root"].vertices) for s in (hulls(robot), shapes(problem)))
    lines = [line.strip() for line in problem.report().splitlines()]
    # one line for each mesh, whatever replaces it
    meshes = [line for line in lines if line.startswith("mesh robot/")]
    assert len(meshes) == 4 and not any(line.startswith("hull ") for line in lines)
    for line in meshes[::2]:
        assert f": replaced by a hull of {after} vertices, " in line
        assert line.endswith(f" m from its convex hull of {before} vertices at most; saves {before - after} vertices")
    assert all(": replaced by a box, " in line for line in meshes[1::2])
    # without the reduction touch the hulls of the file
    scene = mbvi.Scene()
    scene.add_urdf(robot)
    np.testing.assert_array_equal(shapes(scene.build(()))["robot/root"].vertices, hulls(robot)["robot/root"].vertices)


@pytest.mark.parametrize("tolerance", [None, 0.0, 2e-3])
def test_a_file_keeps_the_tolerance(robot, tolerance):
    problem = built(robot, tolerance=tolerance)
    again = restore(describe(problem))
    assert again.scene.items.robots[0].tolerance == tolerance
    assert again.report() == problem.report()
    for name, shape in shapes(problem).items():
        np.testing.assert_array_equal(shapes(again)[name].vertices, shape.vertices)
        np.testing.assert_array_equal(shapes(again)[name].faces[0], shape.faces[0])


@pytest.mark.parametrize(("written", "meant"), [(None, 0.0), (2e-3, 2e-3)])
def test_a_file_of_an_earlier_version_was_exact_by_default(robot, written, meant):
    data = json.loads(describe(built(robot, tolerance=meant)))
    del data["robots"][0]["hulls_within"]
    data["robots"][0]["tolerance"] = written
    assert restore(json.dumps(data)).scene.items.robots[0].tolerance == meant


def test_a_negative_tolerance_is_refused(robot):
    with pytest.raises(mbvi.InputError, match="tolerance must be zero or a positive"):
        mbvi.Scene().add_urdf(robot, tolerance=-1e-9)
