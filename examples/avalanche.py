"""Grains slide down a chute; their centre of mass has the acceleration g sin(angle), whatever their contacts.

`python examples/avalanche.py avalanche.html` writes the replay too.
"""

import sys

import numpy as np

import mbvi
from mbvi import packing, surfaces

ANGLE, DURATION = np.radians(25), 0.8


def main(page: str | None = None) -> float:
    """Return how far the grains' centre of mass has slid [m]; g sin(angle) T^2 / 2 without friction."""
    scene = mbvi.Scene()
    scene.add_surface(*surfaces.chute(length=3.0, width=0.3, angle=ANGLE, sides=0.2), name="chute")
    # a heap at the top, in the chute's own axes: along, across, up from its floor
    heap = packing.random_loose((0.05, -0.14, 0.0), (0.55, 0.14, 0.15), packing.uniform(0.012, 0.02), fraction=0.2)
    along, up = np.array([np.cos(ANGLE), 0, -np.sin(ANGLE)]), np.array([np.sin(ANGLE), 0, np.cos(ANGLE)])
    top = -3.0 * along
    positions = top + heap.positions @ np.array([along, [0, 1, 0], up])
    scene.add_spheres(positions, heap.radii, density=2500.0, name="grains")
    run = mbvi.simulate(scene.build(), mbvi.StewartTrinkle(), step=1e-3, duration=DURATION, every=10)
    mass = heap.radii**3
    centre = mass @ (run.q.reshape(len(run.t), -1, 3) @ along).T / mass.sum()
    front = (run.q[-1].reshape(-1, 3) @ along).max() - (run.q[0].reshape(-1, 3) @ along).max()
    print(f"{len(mass)} grains, the foremost grain is {front:.3f} m ahead of the first start")
    if page:
        run.replay_html(page)
    return float(centre[-1] - centre[0])


if __name__ == "__main__":
    slid = main(*sys.argv[1:])
    print(
        f"the centre of mass slid {slid:.4f} m; g sin(angle) T^2 / 2 is {0.5 * 9.81 * np.sin(ANGLE) * DURATION**2:.4f}"
    )
