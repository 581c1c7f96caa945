"""Columns of grains collapse to heaps: the angle of repose grows with friction, and differs from heap to heap.

`python examples/heap.py heap.html` writes the replay of the last heap too.
"""

import sys

import numpy as np

import mbvi

RADIUS, COUNT = 0.01, 40
FRICTIONS, SEEDS = (0.1, 0.3, 0.9), (0, 1, 2)


def heap(mu: float, seed: int) -> mbvi.Trajectory:
    """Return the collapse of a column of grains, four wide, in a plane."""
    scene = mbvi.Scene(plane="xz", friction=mu)
    scene.add_halfspace((0, 0, 1))
    row, column = np.divmod(np.arange(COUNT), 4)
    x = 2.2 * RADIUS * (column - 1.5 + 0.5 * (row % 2))
    centres = np.column_stack([x, np.zeros(COUNT), RADIUS * (1.1 + 2.0 * row)])
    radii = np.random.default_rng(seed).uniform(0.8, 1.0, COUNT) * RADIUS
    scene.add_spheres(centres, radii, density=2500.0)
    return mbvi.simulate(scene.build(), mbvi.StewartTrinkle(), step=1e-3, duration=1.2, every=10, progress=False)


def angle(run: mbvi.Trajectory) -> float:
    """Return the angle of the wedge with the same mean height and mean distance from its middle [degrees]."""
    centres = run.q[-1].reshape(COUNT, -1)[:, :2]
    height = centres[:, 1].mean() - RADIUS
    away = np.abs(centres[:, 0] - np.median(centres[:, 0])).mean()
    return float(np.degrees(np.arctan2(height, away)))


def main(page: str | None = None) -> float:
    """Return the mean angle of repose at the largest mu [degrees]."""
    for mu in FRICTIONS:
        runs = [heap(mu, seed) for seed in SEEDS]
        angles = np.array([angle(run) for run in runs])
        print(f"mu = {mu:g}: {angles.mean():.1f} degrees, from {angles.min():.1f} to {angles.max():.1f}")
    if page:
        runs[-1].replay_html(page)
    return float(angles.mean())


if __name__ == "__main__":
    print(f"the angle at mu = {FRICTIONS[-1]:g} is {main(*sys.argv[1:]):.1f} degrees")
