"""Bodies that turn many times: their orientation keeps the tolerance, however smooth the motion is."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbvi
from mbvi.schemes.event_driven.turning import turning_columns
from support.paths import ROBOTS

LINK = """<robot name="link"><link name="link"><inertial><origin xyz="0.1 -0.05 0.02"/><mass value="2"/>
  <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial></link></robot>"""
SPIN = np.array([-14.0, 25.0, 28.0])


def cube(folder):
    scene = mbvi.Scene(gravity=(0, 0, 0))
    scene.add_box((0.1, 0.1, 0.1), angular_velocity=SPIN)
    return scene.build()


def link(folder):
    """A robot of one link, its centre of mass aside of its origin, which goes round it."""
    (folder / "link.urdf").write_text(LINK)
    scene = mbvi.Scene(gravity=(0, 0, 0))
    scene.add_urdf(folder / "link.urdf", base="free", base_velocity=[*np.cross([0.1, -0.05, 0.02], SPIN), *SPIN])
    return scene.build()


@pytest.mark.parametrize("tolerance", [1e-3, 1e-6])
@pytest.mark.parametrize("make", [cube, link], ids=["cube", "link"])
def test_a_body_of_equal_moments_keeps_its_axis_of_rotation(make, tolerance, tmp_path):
    """Thirty turns: a step of more than one turn would pass where the chart of its rotations ends."""
    problem = make(tmp_path)
    run = mbvi.simulate(problem, mbvi.EventDriven(tolerance), duration=5.0, progress=False)
    for t in np.linspace(0.0, 5.0, 101):
        q, v = run.at(t)
        turned = Rotation.from_quat(q[3:7].copy()) * Rotation.from_rotvec(t * SPIN).inv()
        assert turned.magnitude() < 1e-10
        np.testing.assert_allclose(v[3:6], SPIN, rtol=0.0, atol=1e-10)


def test_which_velocities_turn_about_axes_that_change():
    scene = mbvi.Scene()
    scene.add_urdf(ROBOTS / "hopper/hopper.urdf", position=(0, 0, 1), name="hopper")
    scene.add_box((0.1, 0.1, 0.1), position=(1, 0, 1))
    scene.add_box((0.1, 0.1, 0.1), position=(2, 0, 1))
    scene.add_sphere(0.1, position=(3, 0, 1))
    system, names = scene.build().system, []
    for part in system.located_parts():
        names += [(type(part.system).__name__, k) for k in range(part.system.nv)]
    found = {tuple(names[i] for i in row) for row in turning_columns(system).tolist()}
    body = [("FreeBodies", 6 * k + 3) for k in range(2)]
    expected = {tuple((name, first + c) for c in range(3)) for name, first in (*body, ("ArticulatedSystem", 3))}
    assert found == expected
