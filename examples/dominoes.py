"""Dominoes with friction fall one against the next: how fast the wave of falling ones runs.

`python examples/dominoes.py dominoes.html 50 1.5` runs 50 of them for 1.5 s and writes the replay too.
"""

import sys

import numpy as np

import mbvi

# thickness, width and height of a domino, distance from one to the next, speed of the first one's upper edge [m, m/s]
SIZE, APART, PUSH = (0.0075, 0.024, 0.048), 0.02, 0.3
MU = 0.3


def row(count: int) -> mbvi.Problem:
    """Return dominoes in a row, of which the first one tips."""
    scene = mbvi.Scene(friction=MU, plane="xz")
    scene.add_halfspace((0, 0, 1), name="table")
    for k in range(count):
        # about its lower edge in front
        spin = PUSH / SIZE[2] if k == 0 else 0.0
        speed = spin * np.array([0.5 * SIZE[2], 0.0, 0.5 * SIZE[0]])
        place = (k * APART, 0.0, 0.5 * SIZE[2])
        scene.add_box(SIZE, 0.0115, position=place, velocity=speed, angular_velocity=(0, spin, 0), name=f"domino_{k}")
    return scene.build()


def main(page: str | None = None, count: int = 16, duration: float = 0.6, step: float = 1e-3) -> float:
    """Return the speed of the wave over the second half of the row [m/s]."""
    run = mbvi.simulate(row(count), step=step, duration=duration, progress=False)
    times = dict[str, float]()
    for impact in run.impacts:
        for name in impact.constraints:
            times.setdefault(name, impact.time)
    # the wave is steady in the second half of the row
    first, last = (times[f"domino_{k - 1} | domino_{k}"] for k in (count // 2, count - 1))
    print(f"the last of {count} dominoes is struck at {last:.3f} s")
    if page:
        run.replay_html(page)
    return float((count - 1 - count // 2) * APART / (last - first))


if __name__ == "__main__":
    arguments = *sys.argv[1:2], *map(int, sys.argv[2:3]), *map(float, sys.argv[3:4])
    print(f"the wave runs at {main(*arguments):.3f} m/s")
