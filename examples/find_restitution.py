"""The restitution of a ball from a recording of its bounces: runs at many e find the valley, derivatives its bottom.

`python examples/find_restitution.py 41 misfit.png` draws the misfit over e and the height of the drop.
"""

import sys
from functools import partial

import numpy as np

import mbvi

RADIUS, E, DROP, NOISE = 0.02, 0.83, 0.5, 5e-4
# a camera of 100 pictures a second [s]
TIMES = np.arange(0.0, 1.5, 0.01)
SCHEME = mbvi.EventDriven(1e-8)


def make(e: float, drop: float) -> mbvi.Scene:
    """Return a ball that falls from a height."""
    scene = mbvi.Scene(restitution=e)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_sphere(RADIUS, position=(0, 0, RADIUS + drop), name="ball")
    return scene


def heights(run: mbvi.Trajectory) -> np.ndarray:
    """Return the height of the ball in each picture [m]."""
    return run.at(TIMES)[0][:, 2]


def recording(seed: int = 3) -> np.ndarray:
    """Return what a camera saw of a ball whose restitution is to be found: here the exact solution, with noise."""
    exact = mbvi.reference.bouncing_ball(E, duration=2.0, height=DROP)
    seen = np.array([RADIUS + exact.at(float(t))[0][0] for t in TIMES])
    return seen + NOISE * np.random.default_rng(seed).standard_normal(len(TIMES))


def misfit(run: mbvi.Trajectory, recorded: np.ndarray) -> dict[str, float]:
    """Return the root of the mean square of the distance from a recording [m]."""
    return {"misfit": float(np.sqrt(np.mean((heights(run) - recorded) ** 2)))}


def fit(recorded: np.ndarray, e: float, drop: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the e and drop [m] that fit best, by Gauss and Newton's method, and their standard deviations."""
    x = np.array([e, drop])
    for _ in range(4):
        found = mbvi.sensitivity(make(*x).build(), SCHEME, duration=TIMES[-1], wrt=["restitution", "state"])
        # from a recorded state on the ball flies, so that its height varies by the speed's variation times the time
        last = np.searchsorted(found.run.t, TIMES, side="right") - 1
        height, speed = (found.matrices[last, row][:, [0, 1 + 2]] for row in (2, 3 + 2))
        slopes = height + (TIMES - found.run.t[last])[:, None] * speed
        left = recorded - heights(found.run)
        x = x + np.linalg.lstsq(slopes, left)[0]
    # what the noise, of which the distances that are left tell the size, leaves unknown
    noise = left @ left / (len(TIMES) - 2)
    return x, np.sqrt(noise * np.linalg.inv(slopes.T @ slopes).diagonal())


def main(count: int = 6, picture: str | None = None) -> float:
    """Return the restitution that fits best."""
    recorded = recording()
    grid = {"e": np.linspace(0.6, 0.95, count), "drop": np.linspace(0.45, 0.55, count)}
    measure, out = partial(misfit, recorded=recorded), f"find_restitution_{count}"
    ds = mbvi.sweep(make, grid, measure=measure, out=out, scheme=SCHEME, duration=float(TIMES[-1]))
    best = ds.isel(ds["misfit"].argmin(...))
    print(f"best of {count**2} runs: e = {best['e']:.3f}, drop from {best['drop']:.3f} m")
    x, sigma = fit(recorded, float(best["e"]), float(best["drop"]))
    print(f"fitted: e = {x[0]:.5f} +- {sigma[0]:.5f}, drop from {x[1]:.4f} +- {sigma[1]:.4f} m")
    if picture:
        ds["e"].attrs["long_name"], ds["drop"].attrs["units"], ds["misfit"].attrs["units"] = "restitution e", "m", "m"
        mbvi.plot_sweep(ds).savefig(picture, dpi=110)
    return float(x[0])


if __name__ == "__main__":
    print(f"restitution {main(*map(int, sys.argv[1:2]), *sys.argv[2:]):.5f}, recorded with {E}")
