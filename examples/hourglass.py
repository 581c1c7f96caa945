"""An hourglass: without friction no arch is stable, so every grain passes the neck.

`python examples/hourglass.py hourglass.html` writes the replay too.
"""

import sys

import numpy as np

import mbvi
from mbvi import packing, surfaces


def main(page: str | None = None) -> float:
    """Return the number of grains, of 120, in the lower glass at the end."""
    scene = mbvi.Scene()
    scene.add_surface(*surfaces.hourglass(radius=0.2, neck=0.03, height=0.34, segments=32), name="glass")
    sand = packing.layers((-0.07, -0.07, 0.15), (0.07, 0.07), packing.uniform(0.008, 0.011), count=120, seed=2)
    scene.add_spheres(*sand, density=2500.0, name="sand")
    run = mbvi.simulate(scene.build(), mbvi.StewartTrinkle(), step=1e-3, duration=1.0, every=5)
    heights = run.q.reshape(len(run.t), -1, 3)[:, :, 2]
    below = (heights < 0.0).sum(axis=1)
    half = run.t[np.argmax(below >= 60)]
    print(f"half of the sand has passed after {half:.2f} s, all of it after {run.t[np.argmax(below == 120)]:.2f} s")
    if page:
        run.replay_html(page)
    return float(below[-1])


if __name__ == "__main__":
    print(f"{main(*sys.argv[1:]):.0f} of 120 grains passed the neck")
