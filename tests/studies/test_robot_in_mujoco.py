"""A robot in MuJoCo for benchmarks: its contacts have the friction of the problem."""

import numpy as np
import pytest

import mbvi
from mbvi_studies.engines.robot_in_mujoco import MuJoCoRobot
from support.paths import ROBOTS


def standing(mu):
    scene = mbvi.Scene(friction=mu)
    scene.add_halfspace((0, 0, 1), name="floor")
    joints = {
        f"{leg}_{part}_joint": x for leg in ("FL", "FR", "RL", "RR") for part, x in (("thigh", 0.6), ("calf", -1.2))
    }
    scene.add_urdf(ROBOTS / "quadruped/quadruped.urdf", position=(0, 0, 0.354), joints=joints)
    return scene


@pytest.mark.parametrize("mu", [0.0, 0.7])
def test_a_contact_has_three_rows_with_friction_and_one_without(mu):
    problem = standing(mu).build()
    peer = MuJoCoRobot(problem, np.zeros(problem.system.nv), 1e-3)
    # it falls onto its feet
    peer.rows(20)
    assert peer.data.ncon == 4 and peer.data.nefc == (12 if mu else 4)
    np.testing.assert_array_equal(peer.data.contact.friction[:, :2], max(mu, 1e-5))


def test_contacts_of_several_coefficients_are_refused():
    scene = standing(0.7)
    scene.set_friction("floor", "quadruped/trunk_0", 0.3)
    problem = scene.build()
    with pytest.raises(mbvi.InputError, match="one coefficient"):
        MuJoCoRobot(problem, np.zeros(problem.system.nv), 1e-3)


def test_a_height_field_has_the_heights_of_the_scene():
    scene, heights = mbvi.Scene(), 0.1 * np.random.default_rng(3).random((5, 4)) - 0.2
    scene.add_heightfield(heights, size=(3.0, 2.0), position=(0.5, 0, 0.3), name="field")
    scene.add_urdf(ROBOTS / "quadruped/quadruped.urdf", position=(0, 0, 0.6))
    peer = MuJoCoRobot(scene.build(), np.zeros(18), 1e-3)
    geom = peer.model.geom_dataid.tolist().index(0)
    place, size = peer.model.geom_pos[geom], peer.model.hfield_size[0]
    np.testing.assert_allclose(place[2] + size[2] * peer.model.hfield_data.reshape(5, 4), heights + 0.3, atol=1e-7)
    np.testing.assert_allclose([*place[:2], *size[:2]], [0.5, 0, 1.5, 1.0])
    assert 0.0 < peer.deepest(400) < 0.05


def test_a_mesh_that_is_no_height_field_is_refused():
    scene = mbvi.Scene()
    scene.add_surface([(-1, -1, 0), (1, -1, 0), (0, 1, 0)], [[0, 1, 2]], one_sided=True, name="sheet")
    scene.add_urdf(ROBOTS / "quadruped/quadruped.urdf", position=(0, 0, 0.6))
    with pytest.raises(mbvi.InputError, match="sheet must be a height field at rest"):
        MuJoCoRobot(scene.build(), np.zeros(18), 1e-3)
