"""Distances of pairs of shapes as `EventDriven` measures them, against exact ones."""

import numpy as np
import pytest

import mbvi
from mbvi.schemes.event_driven.rows.contact_rows import SmoothRows


def roof(slope):
    """The corners of a hull whose top is a ridge along x between two faces of a slope."""
    corners = [[x, y, z] for x in (-0.1, 0.1) for y in (-0.1, 0.1) for z in (-0.05, -0.1 * slope)]
    return np.array([*corners, [-0.1, 0.0, 0.0], [0.1, 0.0, 0.0]])


@pytest.mark.parametrize("slope", [1e-7, 1e-6, 1e-5, 1e-3])
def test_the_distance_of_crossing_edges_is_that_of_the_edges_not_of_corners_beside_them(slope):
    rng, (one, other) = np.random.default_rng(4), (roof(slope), roof(2 * slope) * [1.0, 1.0, -1.0])
    scene = mbvi.Scene()
    scene.add_convex(one, [np.zeros(3)], 1.0)
    scene.add_convex(other, [np.array([0.0, 0.0, 1.0])], 1.0)
    problem = scene.build()
    rows = SmoothRows(problem.constraints, 0.0, problem.q0, problem.length)
    pair = np.flatnonzero(rows.featured)
    assert len(pair) == 1 and rows.searched_pair[pair[0]] >= 0
    for _ in range(40):
        gap, q, yaw = rng.choice([0.0, 1e-10, -1e-10]), problem.q0.copy(), rng.uniform(0.5, 2.5)
        q[7:9], q[9] = rng.uniform(-0.03, 0.03, 2), problem.q0[9] - 1.0 + gap
        q[12:] = np.sin(yaw / 2), np.cos(yaw / 2)
        assert abs(rows.gaps(0.0, q, pair)[0] - gap) < 1e-15
