"""The gains of a drive from a recording of its joint, which strikes a wall: BFGS with a gradient by one pass back.

The number that is least is a sum over the times of the recording.
"""

import numpy as np
from scipy.optimize import minimize

import mbvi

# stiffness [N m/rad] and damping [N m s/rad] that are to be found, and where the search starts
TRUE, START = np.array([60.0, 4.0]), np.array([45.0, 6.0])
TIMES, NOISE = np.arange(0.03, 1.5, 0.03), 1e-3
WRT = ["control stiffness of arm/shoulder", "control damping of arm/shoulder"]
SCHEME = mbvi.EventDriven(1e-8)


def make(gains: np.ndarray) -> mbvi.Problem:
    """Return a long link beside a wall, with a drive in its joint."""
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((-1, 0, 0), offset=-0.3, name="wall")
    drive = mbvi.PDControl({"shoulder": -0.25}, *gains, limit="effort")
    robot, start = mbvi.robot("double_pendulum"), {"shoulder": 0.9}
    scene.add_urdf(robot, base="fixed", name="arm", joints=start, control=drive, locked=["elbow"])
    return scene.build()


def recording() -> np.ndarray:
    """Return the angles that a sensor saw: here those of a run, with noise [rad]."""
    run = mbvi.simulate(make(TRUE), SCHEME, duration=TIMES[-1], progress=False)
    return run.at(TIMES)[0][:, 0] + NOISE * np.random.default_rng(3).standard_normal(len(TIMES))


def fit(recorded: np.ndarray) -> tuple[np.ndarray, int]:
    """Return the gains that fit best, and how many runs that took."""

    def misfit(scaled: np.ndarray) -> tuple[float, np.ndarray]:
        """Return the sum of squares of what is left, in units of the noise, and its gradient."""

        def of(q: np.ndarray, v: np.ndarray) -> tuple[float, np.ndarray]:
            left = (q[:, 0] - recorded) / NOISE
            return float(left @ left), np.column_stack([2.0 * left / NOISE, np.zeros(len(left))])

        found = mbvi.gradient(make(scaled * START), of, SCHEME, duration=TIMES[-1], wrt=WRT, times=TIMES)
        return found.value / len(TIMES), found.gradient * START / len(TIMES)

    best = minimize(misfit, np.ones(2), jac=True, method="BFGS", options={"gtol": 1e-2})
    print(f"{best.nfev} runs: {best.fun:.3f} of the noise is left")
    return best.x * START, best.nfev


def main() -> float:
    """Return the stiffness that fits best [N m/rad]."""
    gains, _ = fit(recording())
    print(f"stiffness {gains[0]:.2f} N m/rad, damping {gains[1]:.3f} N m s/rad")
    return float(gains[0])


if __name__ == "__main__":
    print(f"stiffness {main():.2f} N m/rad, recorded with {TRUE[0]:.0f}")
