"""Boxes with friction are poured into a container and come to rest; smooth boxes would slide on for ever.

`python examples/boxes_at_rest.py rest.html 500 3` pours 500 boxes for 3 s and writes the replay too.
"""

import sys

import numpy as np
from scipy.spatial.transform import Rotation

import mbvi

EDGE, G, MU = 0.04, 9.81, 0.5


def poured(count: int) -> mbvi.Problem:
    """Return boxes of 1 kg in random poses, in layers above a container that is as wide as the heap gets high."""
    along = max(2, round((0.7 * count) ** (1 / 3)))
    pitch = 1.8 * EDGE
    half = 0.5 * pitch * along
    layer, row, column = np.unravel_index(np.arange(count), (-(-count // along**2), along, along))
    places = pitch * np.stack([row - 0.5 * (along - 1), column - 0.5 * (along - 1), layer + 0.6], axis=1)
    scene = mbvi.Scene(friction=MU)
    scene.add_container((-half, -half, 0.0), (half, half))
    turns = Rotation.random(count, random_state=0).as_matrix()
    scene.add_boxes(places, (EDGE, EDGE, EDGE), 1.0, rotations=turns)
    return scene.build()


def main(page: str | None = None, count: int = 40, duration: float = 2.0) -> float:
    """Return the kinetic energy of a box at the end over m g times its edge, the mean of all boxes."""
    run = mbvi.simulate(poured(count), mbvi.StewartTrinkle(), step=2e-3, duration=duration, every=10)
    kinetic = run.energies()[0] / (count * G * EDGE)
    for k in np.linspace(0, len(run.t) - 1, 5)[1:].astype(int):
        print(f"after {run.t[k]:.2f} s the kinetic energy of a box is {kinetic[k]:.1e} m g d")
    print(f"deepest penetration {run.penetration().max() / EDGE:.1e} edges")
    if page:
        run.replay_html(page)
    return float(kinetic[-1])


if __name__ == "__main__":
    left = main(*sys.argv[1:2], *map(int, sys.argv[2:3]), *map(float, sys.argv[3:4]))
    print(f"at the end {left:.1e} m g d")
