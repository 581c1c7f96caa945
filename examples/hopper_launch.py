"""A hopper is launched so that it is at a mark, turned as it should be, after three impacts.

Its leg is held, so that it tumbles from the foot onto the trunk. Least squares with the derivative of the run need few
runs. `python examples/hopper_launch.py launch.html` writes the replay too.
"""

import sys

import numpy as np
from scipy.optimize import least_squares

import mbvi

E, END = 0.5, 0.75
# the launch that is to be found: speeds along x and z [m/s], and about y [rad/s]; and that at which the search starts
LAUNCH, START = np.array([0.46, 0.2, -0.6]), np.array([0.4, 0.25, -0.57])
SCHEME = mbvi.EventDriven(1e-10)


def make() -> mbvi.Problem:
    """Return a hopper in its plane above a floor, with its leg held."""
    scene = mbvi.Scene(restitution=E, plane="xz")
    scene.add_halfspace((0, 0, 1), name="floor")
    pose = {"hip": -0.35, "knee": 0.7}
    scene.add_urdf(mbvi.robot("hopper"), position=(0, 0, 0.65), joints=pose, locked=["hip", "knee"], name="hopper")
    return scene.build()


def aim(problem: mbvi.Problem, mark: np.ndarray, derivatives: bool = True) -> tuple[np.ndarray, int]:
    """Return the launch that ends at a mark, and how many runs it took to find it, with derivatives or differences."""
    slopes: dict[bytes, np.ndarray] = {}
    runs = 0

    def miss(launch: np.ndarray) -> np.ndarray:
        """Return by how much the hopper misses the mark [m, rad], in the world's axes for its place."""
        nonlocal runs
        runs += 1
        start = problem.at(problem.q0, launch)
        if derivatives:
            found = mbvi.sensitivity(start, SCHEME, duration=END)
            q, rows = found.run.q[-1], found.matrix[:3, 3:]
            # rows are the place in the axes of the trunk, and its angle; columns the launch
            slopes[launch.tobytes()] = np.vstack([turned(q) @ rows[:2], rows[2]])
        else:
            q = mbvi.simulate(start, SCHEME, duration=END, progress=False).q[-1]
        return np.append(q[:2] - mark[:2], angle(q) - angle(mark))

    jac = (lambda launch: slopes[launch.tobytes()]) if derivatives else "2-point"
    return least_squares(miss, START, jac, xtol=1e-10, ftol=None, gtol=None).x, runs


def angle(q: np.ndarray) -> float:
    """Return the angle of the trunk [rad]."""
    return float(np.arctan2(q[3], q[2]))


def turned(q: np.ndarray) -> np.ndarray:
    """Return the axes of the trunk in the world."""
    return np.array([[q[2], -q[3]], [q[3], q[2]]])


def main(page: str | None = None) -> float:
    """Return the speed along x at which the hopper is launched [m/s]."""
    problem = make()
    mark = mbvi.simulate(problem.at(problem.q0, LAUNCH), SCHEME, duration=END, progress=False).q[-1]
    launch, runs = aim(problem, mark)
    run = mbvi.simulate(problem.at(problem.q0, launch), SCHEME, duration=END, progress=False)
    print(f"{runs} runs: {launch.round(6)} m/s, rad/s; it misses by {np.abs(run.q[-1] - mark).max():.0e} m")
    print(", ".join(f"{impact.constraints[0]} at {impact.time:.3f} s" for impact in run.impacts))
    if page:
        run.replay_html(page)
    return float(launch[0])


if __name__ == "__main__":
    print(f"{main(*sys.argv[1:2]):.6f} m/s; the mark is that of {LAUNCH[0]} m/s")
