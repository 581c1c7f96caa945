"""A robot's own pairs: the search for overlaps answers as one distance for each pair does."""

import coal
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import mbvi
from mbvi.geometry.shapes.shapes import Box, Capsule, Hull, PlacedShape, Sphere, length_unit
from mbvi.scene.urdf.self_pairs import Overlaps

_TOUCHING = 1e-5


def shapes(rng, length):
    made = [Box((0.3, 0.2, 0.5)), Capsule(0.1, 0.4), Sphere(0.2), Hull(rng.normal(size=(30, 3)))]
    made += [Hull(rng.normal(size=(12, 3)) * 0.1 + 0.5)]
    scaled = [Box(tuple(length * x for x in made[0].size)), Capsule(0.1 * length, 0.4 * length), Sphere(0.2 * length)]
    scaled += [Hull(hull.vertices * length) for hull in made[3:]]
    return [PlacedShape(f"link{k}", s, k + 1, np.eye(3), np.zeros(3)) for k, s in enumerate(scaled)]


@pytest.mark.parametrize("length", [1e-3, 1.0, 1e3])
@given(seed=st.integers(0, 2**32 - 1))
def test_overlaps_are_those_of_single_distances(length, seed):
    rng = np.random.default_rng(seed)
    placed = shapes(rng, length)
    poses = [
        [(Rotation.random(random_state=rng).as_matrix(), length * rng.normal(size=3)) for _ in placed] for _ in "ab"
    ]
    found = Overlaps(placed, poses)
    for i, a in enumerate(placed):
        for j in range(i + 1, len(placed)):
            b = placed[j]
            unit, distances = length_unit([min(a.shape.bound, b.shape.bound)]), []
            for pose in poses:
                sides = [
                    (s.shape.coal(unit), coal.Transform3s(pose[k][0], pose[k][1] / unit)) for s, k in ((a, i), (b, j))
                ]
                distances.append(coal.distance(*sides[0], *sides[1], coal.DistanceRequest(), coal.DistanceResult()))
            # both answers are right where the distance is the limit but for Coal's tolerance
            if abs(min(distances) - _TOUCHING) > 1e-5:
                assert found(i, j) == (min(distances) <= _TOUCHING)


def chain(geometry, joint):
    """Three links one after the other; the first has two shapes, and the second has a name as one of them would."""
    text, before = "", "base"
    for link, places in (("finger", ("0 0 0", "0.2 0 0")), ("finger_1", ("0 0 0",)), ("tip", ("0 0 0",))):
        text += f"<link name='{link}'><inertial><mass value='1'/>"
        text += "<inertia ixx='.1' iyy='.1' izz='.1' ixy='0' ixz='0' iyz='0'/></inertial>"
        text += "".join(geometry.format(place) for place in places) + "</link>" + joint.format(link, before)
        before = link
    return f"<robot name='hand'><link name='base'/>{text}</robot>"


URDF = chain(
    "<collision><origin xyz='{}'/><geometry><sphere radius='.05'/></geometry></collision>",
    "<joint name='to_{0}' type='continuous'><parent link='{1}'/><child link='{0}'/><origin xyz='0 .5 0'/>"
    "<axis xyz='0 1 0'/></joint>",
)
MJCF = """<mujoco model="hand"><worldbody><body name="finger"><joint axis="0 1 0"/><geom size=".05"/>
  <geom size=".05" pos=".2 0 0"/><body name="finger_1" pos="0 .5 0"><joint axis="0 1 0"/><geom size=".05"/>
  <body name="tip" pos="0 .5 0"><joint axis="0 1 0"/><geom size=".05"/></body></body></body></worldbody></mujoco>"""
SRDF = "<robot name='hand'><disable_collisions link1='finger' link2='tip' reason='never'/></robot>"


def with_floor(path, **arguments):
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1), -1.0, name="floor")
    if path.suffix == ".xml":
        scene.add_mjcf(path, **arguments)
    else:
        scene.add_urdf(path, base="fixed", **arguments)
    return scene


def names_of(problem):
    return {problem.constraints.name(k) for k in range(len(problem.constraints))}


@pytest.mark.parametrize(("name", "text"), [("hand.urdf", URDF), ("hand.xml", MJCF)])
def test_a_shape_never_has_the_name_of_another_link(tmp_path, name, text):
    pytest.importorskip("mujoco")
    path = tmp_path / name
    path.write_text(text)
    scene = with_floor(path, name="hand")
    shapes = ["hand/finger_0", "hand/finger_2", "hand/finger_1", "hand/tip"]
    floor = {f"{shape} | floor" for shape in shapes}
    assert names_of(scene.build()) == floor | {"hand/finger_0 | hand/tip", "hand/finger_2 | hand/tip"}
    scene.set_friction("hand/finger_1", "floor", 0.7)
    problem = scene.build()
    for k in range(len(problem.constraints)):
        constraint = problem.constraints.name(k)
        if constraint in floor:
            assert problem.constraints.coefficient_of_friction(k) == 0.7 * (constraint == "hand/finger_1 | floor")
    assert scene._items.shapes_of_links()["hand/finger"] == shapes[:2]


def test_a_srdf_names_links(tmp_path):
    path, pairs = tmp_path / "hand.urdf", tmp_path / "hand.srdf"
    path.write_text(URDF.replace("<parent link='finger_1'/>", "<parent link='base'/>"))
    pairs.write_text(SRDF)
    found = names_of(with_floor(path, srdf=pairs).build())
    assert "hand/finger_1 | hand/tip" in found and not {"hand/finger_0 | hand/tip", "hand/finger_2 | hand/tip"} & found
