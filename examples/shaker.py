"""A crate of grains on a shaker: the bed leaves the floor as a whole, and lands at the end of its free flight.

`python examples/shaker.py shaker.html` writes the replay too.
"""

import sys

import numpy as np
from scipy.optimize import brentq

import mbvi
from mbvi import packing

AMPLITUDE, FREQUENCY, G = 0.02, 6.0, 9.81
SPIN = 2 * np.pi * FREQUENCY


def landing() -> float:
    """Return the time at which a bed without bounce lands; it leaves when the floor's acceleration is -g [s]."""
    left = np.arccos(-G / (AMPLITUDE * SPIN**2)) / SPIN
    height, speed = -AMPLITUDE * np.cos(SPIN * left), AMPLITUDE * SPIN * np.sin(SPIN * left)

    def above(t: float) -> float:
        return height + speed * (t - left) - 0.5 * G * (t - left) ** 2 + AMPLITUDE * np.cos(SPIN * t)

    return float(brentq(above, left + 0.02, left + 0.3))


def main(page: str | None = None) -> float:
    """Return the time at which the bed lands for the first time [s]."""
    shaking = mbvi.motion.Oscillation((0, 0, AMPLITUDE), FREQUENCY, phase=-0.5 * np.pi)
    scene = mbvi.Scene()
    scene.add_container((-0.02, -0.02, -0.02), (0.14, 0.14), motion=shaking)
    # four by four grains fill the crate from wall to wall
    bed = packing.lattice((4, 4, 4), 0.02, spacing=0.04, corner=(0, 0, -AMPLITUDE))
    scene.add_spheres(*bed, density=2500.0)
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=0.4)
    strikes = [i for i in run.impacts if any("floor" in name for name in i.constraints) and i.time > 0.05]
    down = strikes[0]
    hit = [k for k, name in enumerate(down.constraints) if "floor" in name]
    speed, percussion = -down.before[hit].mean(), down.percussion[hit].sum()
    print(f"{len(hit)} grains strike the floor at {speed:.3f} m/s with {percussion:.3f} N s")
    if page:
        run.replay_html(page)
    return down.time


if __name__ == "__main__":
    print(f"the bed lands at {main(*sys.argv[1:]):.4f} s; a free flight ends at {landing():.4f} s")
