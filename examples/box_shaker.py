"""A crate of boxes on a shaker: they fill it from wall to wall, leave its floor together, and land together.

`python examples/box_shaker.py shaker.html 10` runs ten layers of them and writes the replay too.
"""

import sys

import numpy as np
from scipy.optimize import brentq

import mbvi

AMPLITUDE, FREQUENCY, G = 0.02, 6.0, 9.81
SPIN = 2 * np.pi * FREQUENCY
EDGE = 0.04


def landing() -> float:
    """Return the time at which a bed without bounce lands; it leaves when the floor's acceleration is -g [s]."""
    left = np.arccos(-G / (AMPLITUDE * SPIN**2)) / SPIN
    height, speed = -AMPLITUDE * np.cos(SPIN * left), AMPLITUDE * SPIN * np.sin(SPIN * left)

    def above(t: float) -> float:
        return height + speed * (t - left) - 0.5 * G * (t - left) ** 2 + AMPLITUDE * np.cos(SPIN * t)

    return float(brentq(above, left + 0.02, left + 0.3))


def main(page: str | None = None, layers: int = 3) -> float:
    """Return the time at which a bed of four by four boxes in so many layers lands for the first time [s]."""
    shaking = mbvi.motion.Oscillation((0, 0, AMPLITUDE), FREQUENCY, phase=-0.5 * np.pi)
    scene = mbvi.Scene()
    scene.add_container((0, 0, 0), (4 * EDGE, 4 * EDGE), motion=shaking)
    places = EDGE * (np.indices((4, 4, layers)).reshape(3, -1).T + 0.5)
    scene.add_boxes(places - [0, 0, AMPLITUDE], (EDGE, EDGE, EDGE), density=800.0)
    run = mbvi.simulate(scene.build(), mbvi.StewartTrinkle(), step=1e-3, duration=0.3)
    strikes = [i for i in run.impacts if any("floor" in name for name in i.constraints) and i.time > 0.1]
    down = strikes[0]
    hit = [k for k, name in enumerate(down.constraints) if "floor" in name]
    struck = len({down.constraints[k] for k in hit})
    print(f"{struck} boxes strike the floor at {-down.before[hit].mean():.3f} m/s")
    print(f"deepest penetration {run.penetration().max() / EDGE:.1e} edges")
    if page:
        run.replay_html(page)
    return down.time


if __name__ == "__main__":
    down = main(*sys.argv[1:2], *map(int, sys.argv[2:3]))
    print(f"the bed lands at {down:.4f} s; a free flight ends at {landing():.4f} s")
