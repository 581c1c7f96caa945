"""The restitution of a ball from a recording of its bounces: runs at many e find the valley, scipy.optimize its bottom.

`python examples/find_restitution.py 41 misfit.png` draws the misfit over e and the height of the drop.
"""

import sys
from functools import partial

import numpy as np
from scipy.optimize import least_squares

import mbvi

RADIUS, E, DROP, NOISE = 0.02, 0.83, 0.5, 5e-4
# a camera of 100 pictures a second [s]
TIMES = np.arange(0.0, 1.5, 0.01)


def make(e: float, drop: float) -> mbvi.Scene:
    """Return a ball that falls from a height."""
    scene = mbvi.Scene(restitution=e)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_sphere(RADIUS, position=(0, 0, RADIUS + drop), name="ball")
    return scene


def heights(run: mbvi.Trajectory) -> np.ndarray:
    """Return the height of the ball in each picture [m]."""
    return run.at(TIMES)[0][:, 2]


def recording() -> np.ndarray:
    """Return what a camera saw of a ball whose restitution is to be found: here the exact solution, with noise."""
    exact = mbvi.reference.bouncing_ball(E, duration=2.0, height=DROP)
    seen = np.array([RADIUS + exact.at(float(t))[0][0] for t in TIMES])
    return seen + NOISE * np.random.default_rng(3).standard_normal(len(TIMES))


def misfit(run: mbvi.Trajectory, recorded: np.ndarray) -> dict[str, float]:
    """Return the root of the mean square of the distance from a recording [m]."""
    return {"misfit": float(np.sqrt(np.mean((heights(run) - recorded) ** 2)))}


def main(count: int = 6, picture: str | None = None) -> float:
    """Return the restitution that fits best."""
    recorded = recording()
    grid = {"e": np.linspace(0.6, 0.95, count), "drop": np.linspace(0.45, 0.55, count)}
    options = {"scheme": mbvi.EventDriven(1e-8), "duration": float(TIMES[-1])}
    ds = mbvi.sweep(
        make, grid, measure=partial(misfit, recorded=recorded), out=f"find_restitution_{count}", **options
    )  # fmt: skip
    best = ds.isel(ds["misfit"].argmin(...))
    print(f"best of {count**2} runs: e = {best['e']:.3f}, drop from {best['drop']:.3f} m")

    def distances(x: np.ndarray) -> np.ndarray:
        return heights(mbvi.simulate(make(*x).build(), progress=False, **options)) - recorded

    fit = least_squares(distances, [best["e"], best["drop"]], bounds=([0.0, 0.1], [1.0, 2.0]), diff_step=1e-4)
    # what the noise leaves unknown
    sigma = np.sqrt(2 * fit.cost / (len(TIMES) - 2) * np.linalg.inv(fit.jac.T @ fit.jac).diagonal())
    print(f"fitted: e = {fit.x[0]:.5f} +- {sigma[0]:.5f}, drop from {fit.x[1]:.4f} +- {sigma[1]:.4f} m")
    if picture:
        ds["e"].attrs["long_name"], ds["drop"].attrs["units"], ds["misfit"].attrs["units"] = "restitution e", "m", "m"
        mbvi.plot_sweep(ds).savefig(picture, dpi=110)
    return float(fit.x[0])


if __name__ == "__main__":
    print(f"restitution {main(*map(int, sys.argv[1:2]), *sys.argv[2:]):.5f}, recorded with {E}")
