"""A ball slides and rolls through a bowl made as a height field, and nears pendulums as the mesh gets finer.

A ball that slides without friction is a pendulum of length R - r. One that rolls without slip has 7/5 of its inertia.
`python examples/bowl.py bowl.html` writes the replay too.
"""

import sys

import numpy as np
from scipy.special import ellipk

import mbvi

RADIUS, BALL, ANGLE = 1.0, 0.1, 0.5
LENGTH = RADIUS - BALL
# to the lowest point
SLIDING = np.sqrt(LENGTH / 9.81) * ellipk(np.sin(0.5 * ANGLE) ** 2)
ROLLING = np.sqrt(1.4) * SLIDING


def quarter(points: int, friction: float, page: str | None = None) -> tuple[float, float]:
    """Return the time to the lowest point of a bowl of points x points heights, and the part of the energy lost."""
    x = np.linspace(-0.7, 0.7, points)
    scene = mbvi.Scene(friction=friction)
    scene.add_heightfield(RADIUS - np.sqrt(RADIUS**2 - np.add.outer(x**2, x**2)), size=(1.4, 1.4), name="bowl")
    along = np.array([np.cos(0.3), np.sin(0.3), 0.0])
    start = LENGTH * (np.sin(ANGLE) * along - [0, 0, np.cos(ANGLE)]) + [0, 0, RADIUS]
    scene.add_sphere(BALL, mass=1.0, position=start, name="ball")
    # faces cut into the round bowl
    problem = scene.build(resolve=True)
    run = mbvi.simulate(problem, mbvi.Centered(), step=1e-4, duration=0.8, every=5, progress=False)
    if page:
        run.replay_html(page)
    way = run.q[:, :3] @ along
    k = int(np.argmax(way < 0.0))
    time = run.t[k - 1] + way[k - 1] / (way[k - 1] - way[k]) * (run.t[k] - run.t[k - 1])
    energy = 0.5 * run.v[k, :3] @ run.v[k, :3] + 0.5 * 0.4 * BALL**2 * run.v[k, 3:] @ run.v[k, 3:]
    return float(time), 1.0 - float(energy) / (9.81 * LENGTH * (1.0 - np.cos(ANGLE)))


def main(page: str | None = None) -> float:
    """Return the time in which the ball rolls to the lowest point on the finest mesh [s]."""
    time = 0.0
    for word, friction, exact in (("slides", 0.0, SLIDING), ("rolls", 0.5, ROLLING)):
        for points in (29, 57, 113):
            time, lost = quarter(points, friction, page if friction and points == 57 else None)
            cells = f"over cells of {1400 / (points - 1):4.1f} mm"
            print(
                f"{word} {cells}: {time:.4f} s, pendulum {exact:.4f} s; {lost:4.1%} of the energy lost at inner edges"
            )
    return time


if __name__ == "__main__":
    print(f"{main(*sys.argv[1:]):.4f} s; a pendulum with 7/5 of the inertia takes {ROLLING:.4f} s")
