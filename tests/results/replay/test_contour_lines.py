"""Height fields in the replay: contour lines lie at their heights, and a large field makes no large page."""

import numpy as np

import mbvi
from mbvi.results.replay.terrain import contour_lines, field_meshes


def item_of(heights, **pose):
    scene = mbvi.Scene()
    scene.add_heightfield(heights, (2.0, 1.0), **pose)
    return scene._items.surfaces[0]


def test_contour_lines_lie_at_multiples_and_are_closed_but_at_the_rim():
    item = item_of(np.random.default_rng(0).uniform(-1.0, 1.0, (9, 12)))
    place, triangles = item.surface.vertices, item.surface.triangles
    ends = contour_lines(place, place[:, 2], triangles, 0.25)
    np.testing.assert_allclose(ends[:, 2], 0.25 * np.round(ends[:, 2] / 0.25), atol=1e-12)
    assert len(np.unique(np.round(ends[:, 2], 9))) >= 7
    _, count = np.unique(np.round(ends, 9), axis=0, return_counts=True)
    inside = (np.abs(ends[:, 0]) < 1 - 1e-9) & (np.abs(ends[:, 1]) < 0.5 - 1e-9)
    where, count = np.unique(np.round(ends[inside], 9), axis=0, return_counts=True)
    assert (count == 2).all() and len(where) > 50


def test_a_turned_field_has_the_lines_of_its_own_heights_and_a_level_one_has_none():
    heights = np.add.outer(np.zeros(3), np.arange(4.0))
    turned = item_of(heights, rotation=(0.0, 0.0, 0.5), position=(0.0, 0.0, 7.0))
    surface, lines = field_meshes(turned)
    z = np.asarray(lines.geometry.position)[2] - 7.0
    # rounded down to 1, 2, 5 times a power of ten: a line each 0.2
    np.testing.assert_allclose(np.unique(np.round(z, 9)), 0.2 * np.arange(15))
    assert surface.geometry.vertices.shape == (12, 3)
    assert field_meshes(item_of(np.ones((2, 2))))[1] is None
    # of gravel lines would hide the surface
    assert field_meshes(item_of(np.random.default_rng(0).uniform(size=(64, 64))))[1] is None


def test_of_a_large_field_200_rows_and_columns_are_drawn_to_its_rim():
    x = np.linspace(0.0, 1.0, 300)
    surface, _ = field_meshes(item_of(np.add.outer(x, x**2)))
    vertices = np.asarray(surface.geometry.vertices)
    assert len(vertices) == 200**2 and np.ptp(vertices, axis=0).tolist() == [2.0, 1.0, 2.0]
