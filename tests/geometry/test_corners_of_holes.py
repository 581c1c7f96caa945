"""An edge of a box that reaches into the corner of a hole of a mesh is held by the rims there, and does not sink in."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mbvi

SIZE, STEP = np.array([0.22, 0.22, 0.3]), 2e-3


def sheet_with_hole(half=0.15, rise=0.0):
    """A sheet of squares about the origin, without the one in the middle; the corners of the others lie higher."""
    x = np.array([-3.0, -1.0, 1.0, 3.0]) * half
    vertices = np.array([(a, b, rise * (a * a + b * b)) for b in x for a in x])
    squares = [4 * i + j for i in range(3) for j in range(3) if (i, j) != (1, 1)]
    return vertices, np.array([[[p, p + 1, p + 5], [p, p + 5, p + 4]] for p in squares]).reshape(-1, 3)


def depth_in_box(points, pose, size):
    """How deep the deepest of some points is within a box [m]."""
    own = (points - pose[:3]) @ Rotation.from_quat(pose[3:7]).as_matrix()
    return (0.5 * size - np.abs(own)).min(axis=1).max()


@pytest.mark.parametrize("deep", [(1e-5, 2e-5), (1e-4, 1e-3), (1e-3, 1e-4), (2e-3, 2e-3)])
def test_an_edge_beyond_the_corner_of_a_hole_has_rows(deep):
    """Its place in the plane of the sheet is beyond both rims, by known depths: rows of the rims say so."""
    vertices, triangles = sheet_with_hole()
    scene = mbvi.Scene(gravity=(0, 0, 0))
    scene.add_surface(vertices, triangles, one_sided=True, name="sheet")
    # its edge between two faces leans outwards, and its lower part is narrower in the plane of the sheet
    turn = Rotation.from_rotvec(0.35 * np.array([-1.0, 1.0, 0.0]) / np.sqrt(2))
    scene.add_box(SIZE, position=(0, 0, 5), rotation=turn.as_matrix(), name="box")
    problem = scene.build()
    ends = turn.apply(0.5 * SIZE * np.array([[1, 1, -1], [1, 1, 1]]))
    q = problem.q0.copy()
    # the edge passes the plane of the sheet a third of its length above its lower end
    q[:3] = np.array([0.15 + deep[0], 0.15 + deep[1], 0.0]) - (2.0 * ends[0] + ends[1]) / 3.0
    rows = problem.constraints.active(0.0, q, 0.0)
    assert len(rows.gap)
    # each row is that of a rim, and leads back over it
    depths = np.array(deep)
    for gap, normal in zip(rows.gap, rows.normal, strict=True):
        np.testing.assert_allclose(gap, normal[:2] @ depths, rtol=1e-6)


# heights of the corners of a bent sheet [mm]
BENT = 1e-3 * np.array([11, 13, 81, 99, 27, 86, 85, 68, 57, 23, 78, 19, 9, 94, 5, 59])


@pytest.mark.parametrize(
    ("rim", "share", "axis", "corner", "turn"),
    [
        ((5, 6), 0.659, 0, (1, 1, -1), (-0.583, 0.191, -1.202)),
        ((6, 10), 0.851, 1, (-1, 1, -1), (-0.565, -1.507, -0.686)),
    ],
)
@pytest.mark.parametrize(("far", "deep"), [(5e-5, 1e-5), (5e-5, 5e-5), (1e-5, 1e-4), (1e-3, 1e-5), (1e-3, 2e-3)])
def test_an_edge_that_goes_down_from_a_vertex_over_the_hole_has_the_row_of_the_rim(
    rim, share, axis, corner, turn, far, deep
):
    """The edge passes below the rim, by a known depth and not far from its upper end, which is over the hole."""
    vertices, triangles = sheet_with_hole(1 / 7)
    vertices[:, 2] = BENT
    scene = mbvi.Scene(gravity=(0, 0, 0))
    scene.add_surface(vertices, triangles, one_sided=True, name="sheet")
    size, turn = np.array([0.3, 0.25, 0.35]), Rotation.from_rotvec(turn)
    scene.add_box(size, position=(0, 0, 5), rotation=turn.as_matrix(), name="box")
    problem = scene.build()
    place = 0.5 * size * corner
    along = -np.sign(place[axis]) * np.eye(3)[axis]
    on_rim = vertices[rim[0]] + share * (vertices[rim[1]] - vertices[rim[0]])
    normal = np.cross(turn.apply(along), vertices[rim[1]] - vertices[rim[0]])
    normal *= np.sign(normal[2]) / np.linalg.norm(normal)
    q = problem.q0.copy()
    q[:3] = on_rim - deep * normal - turn.apply(place + far * along)
    rows = problem.constraints.active(0.0, q, 0.0)
    found = np.flatnonzero((rows.normal @ normal > 1.0 - 1e-9) & (abs(rows.gap + deep) < 1e-9))
    assert len(found)


@pytest.mark.parametrize("seed", [31, 37])
def test_a_box_that_falls_into_a_hole_does_not_sink_into_its_sheet(seed):
    rng = np.random.default_rng(seed)
    vertices, triangles = sheet_with_hole(1 / 7, rng.choice([0.0, 0.3, 0.6]))
    scene = mbvi.Scene()
    scene.add_surface(vertices, triangles, one_sided=True, name="sheet")
    size, turn = 2.0 * rng.uniform(0.1, 0.2, 3), Rotation.random(random_state=seed)
    scene.add_box(size, mass=3.0, position=(*rng.uniform(-0.05, 0.05, 2), 0.55), rotation=turn.as_matrix(), name="box")
    run = mbvi.simulate(scene.build(), mbvi.StewartTrinkle(), step=STEP, duration=0.8)
    along = np.linspace(0, 1, 30)
    share = np.array([(a, b) for a in along for b in along if a + b <= 1.0])
    a, b, c = vertices[triangles].transpose(1, 0, 2)
    points = (a[:, None] + share[:, :1] * (b - a)[:, None] + share[:, 1:] * (c - a)[:, None]).reshape(-1, 3)
    depths = [depth_in_box(points, q, size) for q in run.q[::10]]
    # less than a hundredth of the size of the box
    assert max(depths) < 2e-3
