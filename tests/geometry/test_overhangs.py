"""A corner of a body below the slab that a mesh holds out is outside of the mesh, unless it came through the slab."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbvi

THICK = 5e-3
SIZE = np.array([0.4, 0.2, 0.06])


def slab():
    """A slab with its upper face at height 0, which ends at x = 0."""
    vertices = np.array([(x, y, z) for x in (0.0, 1.0) for y in (-0.5, 0.5) for z in (-THICK, 0.0)])
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return vertices, np.array([part for a, b, c, d in faces for part in ((a, b, c), (a, c, d))])


def plate(tilt):
    """A plate that goes down in the direction of x by an angle."""
    turn = Rotation.from_rotvec((0.0, tilt, 0.0)).as_matrix()
    scene = mbvi.Scene(gravity=(0, 0, 0))
    scene.add_surface(*slab(), one_sided=True, name="slab")
    scene.add_box(SIZE, position=(0, 0, 5), rotation=turn, name="plate")
    return scene.build(), turn


@pytest.mark.parametrize("tilt", [0.25, 0.35, 0.5])
@pytest.mark.parametrize("far", [0.01, 0.02, 0.03])
def test_a_corner_below_a_slab_is_outside_of_it(tilt, far, apart=1e-3):
    """The upper face of the plate passes below the lower edge of the slab, and its corner is under the slab."""
    problem, turn = plate(tilt)
    corner, normal = turn @ (0.5 * SIZE * (1, 0, 1)), turn[:, 2]
    q = problem.q0.copy()
    q[:3] = far - corner[0], 0.0, -THICK - (apart + (far * normal[0])) / normal[2] - corner[2]
    assert q[2] > 0.0 or far > 0.01
    assert not len(problem.constraints.active(0.0, q, 0.0).gap)
    near = problem.constraints.active(0.0, q, 1.5 * apart)
    np.testing.assert_allclose(near.gap, apart, rtol=1e-9)
    np.testing.assert_allclose(near.normal, np.tile(-normal, (len(near.gap), 1)), atol=1e-9)


@pytest.mark.parametrize("tilt", [0.25, 0.35, 0.5])
@pytest.mark.parametrize("deep", [2e-3, 8e-3, 2e-2])
def test_a_corner_that_came_through_a_slab_is_pushed_back(tilt, deep):
    problem, turn = plate(tilt)
    q = problem.q0.copy()
    lowest = turn @ (0.5 * SIZE * (1, 0, -1))
    q[:3] = 0.4 - lowest[0], 0.0, -deep - lowest[2]
    rows = problem.constraints.active(0.0, q, 0.0)
    np.testing.assert_allclose(rows.gap.min(), -deep, rtol=1e-9)
    np.testing.assert_allclose(rows.normal[rows.gap.argmin()], (0.0, 0.0, 1.0), atol=1e-9)
