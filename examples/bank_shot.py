"""A ball is thrown so that it is at a mark in time, after the floor, a wall and the floor again.

Least squares with the derivative of the run need a few runs, each of which has its derivative with it.
`python examples/bank_shot.py shot.html` writes the replay too.
"""

import sys

import numpy as np
from scipy.optimize import least_squares

import mbvi

E, WALL, RADIUS, HEIGHT = 0.8, 3.0, 0.1, 1.2
# where the ball shall be [m], and when [s]
MARK, END = np.array([1.8, 0.5, 0.35]), 1.8
# the velocity at which the search starts [m/s]
START = np.array([2.2, 0.0, 2.4])
SCHEME = mbvi.EventDriven(1e-10)


def make(velocity: np.ndarray) -> mbvi.Problem:
    """Return a ball that is thrown towards a wall."""
    scene = mbvi.Scene(restitution=E)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_halfspace((-1, 0, 0), offset=-WALL - RADIUS, name="wall")
    scene.add_sphere(RADIUS, position=(0, 0, HEIGHT), velocity=velocity, name="ball")
    return scene.build()


def aim(derivatives: bool = True) -> tuple[np.ndarray, int]:
    """Return the velocity [m/s], and how many runs it took to find it, with derivatives or differences of runs."""
    slopes: dict[bytes, np.ndarray] = {}
    runs = 0

    def miss(velocity: np.ndarray) -> np.ndarray:
        """Return by how much the ball misses the mark [m]."""
        nonlocal runs
        runs += 1
        if not derivatives:
            return mbvi.simulate(make(velocity), SCHEME, duration=END, progress=False).q[-1] - MARK
        found = mbvi.sensitivity(make(velocity), SCHEME, duration=END)
        # rows are the place at the end, columns the velocity at the start
        slopes[velocity.tobytes()] = found.matrix[:3, 3:]
        return found.run.q[-1] - MARK

    jac = (lambda velocity: slopes[velocity.tobytes()]) if derivatives else "2-point"
    return least_squares(miss, START, jac, xtol=1e-10, ftol=None, gtol=None).x, runs


def main(page: str | None = None) -> float:
    """Return the speed towards the wall [m/s]."""
    velocity, runs = aim()
    run = mbvi.simulate(make(velocity), SCHEME, duration=END, progress=False)
    print(f"{runs} runs: {velocity.round(5)} m/s; it misses by {np.linalg.norm(run.q[-1] - MARK):.0e} m")
    print(", ".join(f"{impact.constraints[0]} at {impact.time:.3f} s" for impact in run.impacts))
    if page:
        run.replay(page)
    return float(velocity[0])


if __name__ == "__main__":
    # x is 3 m to the wall and 1.2 m back at 0.8 of the speed
    print(f"{main(*sys.argv[1:2]):.6f} m/s; by hand {(WALL + (WALL - MARK[0]) / E) / END:.6f}")
