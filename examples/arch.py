"""An hourglass that can arch: with friction grains jam in a narrow neck, and without they all pass.

`python examples/arch.py arch.html` writes the replay of the rough grains too.
"""

import sys

import mbvi
from mbvi import packing, surfaces

COUNT = 60


def passed(mu: float, page: str | None = None) -> int:
    """Return the number of grains that are in the lower glass after one and a half seconds."""
    scene = mbvi.Scene(friction=mu)
    scene.add_surface(*surfaces.hourglass(radius=0.2, neck=0.024, height=0.34, segments=24), name="glass")
    sand = packing.layers((-0.06, -0.06, 0.13), (0.06, 0.06), packing.uniform(0.0095, 0.0105), count=COUNT, seed=0)
    scene.add_spheres(*sand, density=2500.0, name="sand")
    run = mbvi.simulate(scene.build(), mbvi.StewartTrinkle(), step=1e-3, duration=1.5, every=10, progress=False)
    if page:
        run.replay_html(page)
    return int((run.q[-1].reshape(COUNT, -1)[:, 2] < 0.0).sum())


def main(page: str | None = None) -> float:
    """Return the number of grains of 60 that an arch holds at mu = 0.5."""
    smooth, rough = passed(0.0), passed(0.5, page)
    print(f"without friction {smooth} of {COUNT} grains pass the neck, at mu = 0.5 {rough}")
    return float(COUNT - rough)


if __name__ == "__main__":
    print(f"an arch holds {main(*sys.argv[1:]):.0f} grains")
