"""Heaps of grains on a rough plate: the angle of repose grows with friction, and differs from heap to heap.

`python examples/heap.py heap.html` writes the replay of the last heap too.
"""

import sys

import numpy as np

import mbvi

RADIUS, COUNT, PLATE = 0.01, 60, 13
FRICTIONS, SEEDS = (0.1, 0.3, 0.9), (0, 1, 2)


def heap(mu: float, seed: int) -> mbvi.Trajectory:
    """Return the fall of a block of grains in a plane onto a row of fixed ones; what is too much rolls off."""
    scene = mbvi.Scene(plane="xz", friction=mu)
    for x in 2.0 * RADIUS * (np.arange(PLATE) - PLATE // 2):
        scene.add_sphere(RADIUS, position=(x, 0, 0), fixed=True)
    row, column = np.divmod(np.arange(COUNT), 6)
    x = 2.1 * RADIUS * (column - 2.5 + 0.5 * (row % 2))
    centres = np.column_stack([x, np.zeros(COUNT), RADIUS * (2.1 + 2.0 * row)])
    radii = np.random.default_rng(seed).uniform(0.8, 1.0, COUNT) * RADIUS
    scene.add_spheres(centres, radii, density=2500.0)
    return mbvi.simulate(scene.build(), mbvi.StewartTrinkle(), step=1e-3, duration=1.0, every=10, progress=False)


def angle(run: mbvi.Trajectory) -> float:
    """Return the angle of the wedge with the mean height and mean distance of what is on the plate [degrees]."""
    # of each grain the centre and the quaternion
    x, _, z = run.q[-1].reshape(COUNT, 7)[:, :3].T
    on = z > 0.0
    return float(np.degrees(np.arctan2(z[on].mean() - RADIUS, np.abs(x[on] - x[on].mean()).mean())))


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
