"""A robot that can meet nothing of a scene is named when the scene is built."""

import warnings

import pytest

import mbvi
from support.paths import DATA, ROBOTS, real_robot

HANGING = """<mujoco model="m"><worldbody><geom name="floor" type="plane" size="1 1 .1" contype="{}"/>
<body name="b" pos="0 0 1"><freejoint/><geom size=".1" contype="{}" conaffinity="{}"/></body></worldbody></mujoco>"""


def said_at_build(scene):
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        problem = scene.build()
    return " ".join(str(one.message) for one in said), problem.report()


@pytest.mark.parametrize(
    "add",
    [
        lambda scene: scene.add_halfspace((0, 0, 1), -9.0),
        lambda scene: scene.add_sphere(0.1, position=(5, 0, 0)),
        lambda scene: scene.add_box((1, 1, 1), fixed=True, position=(5, 0, 0)),
        lambda scene: scene.add_surface([[0, 0, -9], [1, 0, -9], [0, 1, -9]], [[0, 1, 2]]),
        lambda scene: scene.add_urdf(ROBOTS / "hopper/hopper.urdf", position=(9, 0, 0)),
    ],
)
def test_a_robot_without_shapes_is_named(add):
    scene = mbvi.Scene()
    scene.add_urdf(DATA / "fingers.urdf")
    assert said_at_build(scene)[0] == ""
    add(scene)
    for text in said_at_build(scene):
        assert "contacts of fingers: no link that moves has a collision shape: it passes through everything" in text


@pytest.mark.parametrize("path", ["human_description/robots/human.urdf", "asr_twodof_description/urdf/TwoDofs.urdf"])
def test_published_robots_without_shapes_are_named(path):
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1), -9.0)
    name = scene.add_urdf(real_robot(path))
    assert all(f"contacts of {name}: no link" in text for text in said_at_build(scene))


@pytest.mark.parametrize(("floor", "own", "passes"), [(1, 1, False), (2, 1, False), (4, 2, True)])
def test_a_robot_whose_file_leaves_out_all_walls_is_named(tmp_path, floor, own, passes):
    pytest.importorskip("mujoco")
    file = tmp_path / "m.xml"
    file.write_text(HANGING.format(floor, own, own))
    scene = mbvi.Scene()
    scene.add_mjcf(file)
    said, report = said_at_build(scene)
    assert ("contacts of m: its file leaves out all pairs" in said) == passes == ("contacts of m" in report)
    # a wall that the scene adds is met
    scene.add_halfspace((1, 0, 0), -9.0)
    assert said_at_build(scene)[0] == ""
