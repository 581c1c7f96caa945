"""A hopper empties: without friction boxes slide down its two plates and through the slot until none is left.

`python examples/box_hopper.py hopper.html 200 2.5` runs it for 2.5 s with 200 boxes and writes the replay too.
"""

import sys

import numpy as np
from scipy.spatial.transform import Rotation

import mbvi

# height and half width of the slot, height of the plates' upper edges, their thickness, half depth, edge of a box [m]
SLOT, HALF, TOP, THICK, DEPTH, EDGE = 0.3, 0.045, 0.55, 0.02, 0.15, 0.04


def filled_hopper(count: int) -> mbvi.Problem:
    """Return two plates at 45 degrees between walls, so many boxes above them, and a tray below."""
    scene, slope = mbvi.Scene(), TOP - SLOT
    scene.add_container((-HALF - slope, -DEPTH, 0.0), (HALF + slope, DEPTH), name="tray")
    for side in (1.0, -1.0):
        tilt = Rotation.from_euler("y", -0.25 * np.pi * side)
        # the upper face goes through the edge of the slot
        middle = np.array([side * (HALF + 0.5 * slope), 0.0, SLOT + 0.5 * slope]) - tilt.apply([0.0, 0.0, 0.5 * THICK])
        size = (np.sqrt(2.0) * slope, 2.0 * DEPTH, THICK)
        scene.add_box(size, position=middle, rotation=tilt.as_matrix(), fixed=True)
    layer, row, column = np.unravel_index(np.arange(count), (-(-count // 16), 4, 4))
    places = 0.075 * np.stack([row - 1.5, column - 1.5, layer], axis=1) + [0.0, 0.0, 0.5]
    turns = Rotation.random(count, random_state=3).as_matrix()
    scene.add_boxes(places, (EDGE, EDGE, EDGE), density=800.0, rotations=turns)
    return scene.build()


def main(page: str | None = None, count: int = 32, duration: float = 0.8) -> float:
    """Return the part of the boxes that has passed the slot at the end."""
    run = mbvi.simulate(filled_hopper(count), step=2e-3, duration=duration, every=5)
    heights = run.q.reshape(len(run.t), -1, 7)[:, :, 2]
    below = (heights < SLOT).sum(axis=1)
    half, end = (run.t[np.argmax(below >= part * below[-1])] for part in (0.5, 1.0))
    print(f"half of the boxes have passed after {half:.2f} s, the last of them after {end:.2f} s")
    print(f"deepest penetration {run.penetration().max():.1e} m")
    if page:
        run.replay_html(page)
    return float(below[-1]) / count


if __name__ == "__main__":
    part = main(*sys.argv[1:2], *map(int, sys.argv[2:3]), *map(float, sys.argv[3:4]))
    print(f"{part:.0%} of the boxes passed the slot")
