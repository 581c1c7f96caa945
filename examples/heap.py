"""Grains at one side of a box slump: their angle of repose grows with friction, and differs from heap to heap.

`python examples/heap.py heap.html` writes the replay of the last heap too.
"""

import sys

import numpy as np

import mbvi

RADIUS, COUNT, WIDTH = 0.01, 60, 0.24
FRICTIONS, SEEDS = (0.0, 0.1, 0.5), (0, 1, 2)


def heap(mu: float, seed: int) -> mbvi.Trajectory:
    """Return the slump of a block of discs that fills the left half of a box, in a plane."""
    scene, random = mbvi.Scene(plane="xz", friction=mu), np.random.default_rng(seed)
    scene.add_container((0, -2 * RADIUS, 0), (WIDTH, 2 * RADIUS))
    row, column = np.divmod(np.arange(COUNT), 5)
    x = RADIUS * (1.3 + 2.4 * column + random.uniform(-0.2, 0.2, COUNT))
    z = RADIUS * (1.1 + 2.1 * row)
    radii = random.uniform(0.7, 1.0, COUNT) * RADIUS
    scene.add_spheres(np.column_stack([x, np.zeros(COUNT), z]), radii, density=2500.0)
    return mbvi.simulate(scene.build(), mbvi.StewartTrinkle(), step=2e-3, duration=1.0, every=10, progress=False)


def angle(run: mbvi.Trajectory) -> float:
    """Return the angle of a straight surface with the same centre of mass [degrees]."""
    # the centre of each grain; friction adds a quaternion
    centres = run.q[-1].reshape(COUNT, -1)
    x, z = centres[:, 0].mean(), centres[:, 2 if centres.shape[1] == 7 else 1].mean()
    return float(np.degrees(np.arctan(24.0 * z * (0.5 * WIDTH - x) / WIDTH**2)))


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
