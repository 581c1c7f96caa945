"""Cylinders on terrain of ridges and peaks: what of it is inside a cylinder has a row, and none falls through."""

import numpy as np
from scipy.spatial.transform import Rotation

import mbvi


def heights_between(heights, i, j):
    """The heights at rows and columns that need not be whole; each cell is two triangles, as in the docs."""
    row, column = (np.clip(x.astype(int), 0, n - 2) for x, n in zip((i, j), heights.shape, strict=True))
    v, u = i - row, j - column
    a, b, c, d = (heights[row + k, column + m] for k, m in ((0, 0), (0, 1), (1, 0), (1, 1)))
    return np.where(u >= v, a + u * (b - a) + v * (d - b), a + v * (c - a) + u * (d - c))


def points_of(heights, size, parts=12):
    """Points of a field, so many along each side of a cell."""
    rows, columns = heights.shape
    j, i = np.meshgrid(*(np.linspace(0, n - 1, parts * (n - 1) + 1) for n in (columns, rows)))
    place = np.stack([size[0] * (j / (columns - 1) - 0.5), size[1] * (i / (rows - 1) - 0.5)], axis=-1).reshape(-1, 2)
    return np.column_stack([place, heights_between(heights, i.ravel(), j.ravel())])


def test_a_cylinder_that_has_sunk_into_a_rough_field_has_a_row():
    rng, size, tried, without = np.random.default_rng(0), (2.0, 2.0), 0, 0
    for _ in range(6):
        heights, radius, length = 0.5 * rng.random((9, 9)), rng.uniform(0.1, 0.2), rng.uniform(0.1, 0.4)
        scene = mbvi.Scene()
        scene.add_heightfield(heights, size=size)
        scene.add_cylinder(radius, length, 1.0, position=(0, 0, 5))
        family, points = scene.build().constraints.families[0], points_of(heights, size)
        for _ in range(30):
            turn, place = Rotation.random(rng=rng), rng.uniform(-0.5, 0.5, 2)
            wanted = (0.01 + 0.19 * rng.random()) * min(radius, 0.5 * length)
            near = points[np.abs(points[:, :2] - place).max(axis=1) < 0.5]
            for z in np.arange(1.0, -0.2, -0.002):
                local = turn.inv().apply(near - [*place, z])
                inside = np.minimum(radius - np.hypot(local[:, 0], local[:, 1]), 0.5 * length - np.abs(local[:, 2]))
                if inside.max() >= wanted:
                    break
            tried += 1
            found = family.measure(np.array([*place, z, *turn.as_quat()]), np.arange(1), 0.0)
            without += len(found.gap) == 0
    # in rare poses the rims and the prism inside them still leave the contact to each other
    assert without <= 0.01 * tried


def test_a_cylinder_that_spins_over_ridges_does_not_fall_through():
    rng, size = np.random.default_rng(3), (6.0, 5.0)
    for turn in range(8):
        heights = 0.5 * rng.random((20, 16))
        scene = mbvi.Scene(friction=0.3)
        scene.add_heightfield(heights, size=size)
        scene.add_cylinder(
            0.09, 0.21, 1.0, position=(*rng.uniform(-1, 1, 2), 1.0), rotation=Rotation.random(rng=rng),
            velocity=(0.3, 0.4, -4.0), angular_velocity=20 * rng.normal(size=3), name="B",
        )  # fmt: skip
        run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=0.4)
        j, i = ((run.q[:, k] / size[k] + 0.5) * (heights.shape[1 - k] - 1) for k in (0, 1))
        above = run.q[:, 2] - heights_between(heights, i, j)
        assert above.min() > 0.0, turn
