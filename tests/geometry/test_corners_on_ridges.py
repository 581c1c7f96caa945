"""A corner of a box that meets two faces of a mesh at once: its percussion acts there, not at another corner."""

import itertools

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbvi

EDGES, STEP, SPEED = np.array([0.1, 0.075, 0.05]), 2e-3, 2.0
CORNERS = 0.5 * EDGES * np.array(list(itertools.product((-1, 1), repeat=3)))
ROOF = np.array([[-1, -1, -0.05], [0, -1, 0], [1, -1, -0.05], [-1, 1, -0.05], [0, 1, 0], [1, 1, -0.05]])
TRIANGLES = [[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4]]


def box_above_ridge(turn, x, height, metre):
    """A box that falls towards a ridge, its lowest corner at x and `height` [m]; `metre` is the unit of length."""
    scene = mbvi.Scene(gravity=(0, 0, 0), restitution=1.0)
    scene.add_surface(ROOF * metre, TRIANGLES, one_sided=True, name="roof")
    rotation = Rotation.from_euler("xyz", turn).as_matrix()
    corners = CORNERS @ rotation.T
    lowest = corners[np.argmin(corners[:, 2])]
    place, velocity = (np.array([x, 0.0, height]) - lowest) * metre, (0, 0, -SPEED * metre)
    scene.add_box(EDGES * metre, mass=1.0, position=place, rotation=rotation, velocity=velocity, name="box")
    return scene.build(), np.array([x, 0.0, 0.0])


@pytest.mark.parametrize("metre", [1.0, 1000.0])
@pytest.mark.parametrize("by_python", [False, True])
@pytest.mark.parametrize("projects", [False, True])
@pytest.mark.parametrize(
    ("turn", "x", "height"),
    [
        ((0.00377191, -0.00396315, 0.64042265), 5.245e-5, 3.2531e-3),
        ((0.0119511, -0.0168847, 0.588835), 2.1059e-5, 2.3551e-3),
    ],
)
def test_the_corner_at_a_ridge_bears_the_percussion(turn, x, height, projects, by_python, metre):
    problem, at = box_above_ridge(turn, x, height, metre)
    scheme, found = mbvi.Centered(project_positions=projects), []
    if by_python:
        step = next(iter(mbvi.steps(problem, scheme, step=STEP)))
        found = [point for point, p in zip(step.active.point, step.percussion, strict=True) if p > 0.0]
    else:
        run = mbvi.simulate(problem, scheme, step=STEP, duration=STEP, record="contacts")
        found = [contact.point for contact in run.contacts(STEP)]
    assert found
    for point in found:
        # half of what the box travels in the step, and the sinking into the ridge
        assert np.linalg.norm(point / metre - at) <= STEP * SPEED
