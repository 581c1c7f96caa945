"""Restitution and friction of a ball from its recorded bounces: runs find the valley, derivatives its bottom.

`python examples/find_restitution.py 41 misfit.png` draws the misfit over e and the height of the drop.
"""

import sys
from functools import partial

import numpy as np

import mbvi

RADIUS, E, MU, DROP, NOISE = 0.1, 0.83, 0.12, 0.5, 5e-4
# thrown along x with backspin, so that it slides in every bounce [m/s, rad/s]
SPEED, SPIN = 3.0, -40.0
# a camera of 100 pictures a second [s]
TIMES = np.arange(0.0, 1.5, 0.01)
SCHEME = mbvi.EventDriven(1e-8)


def make(e: float, drop: float, mu: float = 0.2) -> mbvi.Scene:
    """Return a ball that is thrown from a height."""
    scene = mbvi.Scene(restitution=e, friction=mu)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_sphere(RADIUS, position=(0, 0, RADIUS + drop), velocity=(SPEED, 0, 0), name="ball")
    return scene


def thrown(e: float, drop: float, mu: float) -> mbvi.Problem:
    """Return its problem, with the spin."""
    problem = make(e, drop, mu).build()
    return problem.at(problem.q0, problem.v0 + SPIN * np.eye(6)[4])


def places(run: mbvi.Trajectory) -> np.ndarray:
    """Return how far and how high the ball is in each picture, shape (n, 2) [m]."""
    return run.at(TIMES)[0][:, [0, 2]]


def recording(seed: int = 3) -> np.ndarray:
    """Return what a camera saw of a ball whose e and mu are to be found: here the exact solution, with noise."""
    exact = mbvi.reference.bouncing_ball(E, duration=2.0, height=DROP)
    heights = [RADIUS + exact.at(float(t))[0][0] for t in TIMES]
    # each bounce takes mu times its percussion from the speed along the floor
    fall = np.sqrt(2 * DROP / 9.81)
    bounces = E ** np.arange(6)
    landings = fall * (2 * np.cumsum(bounces) - 1)
    losses = MU * (1 + E) * 9.81 * fall * bounces
    ways = SPEED * TIMES - np.maximum(TIMES[:, None] - landings, 0.0) @ losses
    seen = np.stack([ways, heights], axis=1)
    return seen + NOISE * np.random.default_rng(seed).standard_normal(seen.shape)


def misfit(run: mbvi.Trajectory, recorded: np.ndarray) -> dict[str, float]:
    """Return the root of the mean square of the distance of heights from a recording [m]."""
    return {"misfit": float(np.sqrt(np.mean((places(run) - recorded)[:, 1] ** 2)))}


def fit(recorded: np.ndarray, e: float, drop: float, mu: float = 0.2) -> tuple[np.ndarray, np.ndarray]:
    """Return the e, drop [m] and mu that fit best, by Gauss and Newton's method, and their standard deviations."""
    x = np.array([e, drop, mu])
    for _ in range(4):
        wrt = ["restitution", "state", "friction"]
        found = mbvi.sensitivity(thrown(*x), SCHEME, duration=TIMES[-1], wrt=wrt)
        # from a recorded state on the ball flies, so that its place varies by the speed's variation times the time
        last = np.searchsorted(found.run.t, TIMES, side="right") - 1
        columns = [
            found.columns["restitution"].start,
            found.columns["state"].start + 2,
            found.columns["friction"].start,
        ]
        place, speed = (found.matrices[last][:, rows][:, :, columns] for rows in ([0, 2], [6, 8]))
        slopes = (place + (TIMES - found.run.t[last])[:, None, None] * speed).reshape(-1, 3)
        left = (recorded - places(found.run)).ravel()
        x = x + np.linalg.lstsq(slopes, left)[0]
    # what the noise, of which the distances that are left tell the size, leaves unknown
    noise = left @ left / (len(left) - 3)
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
    print(f"        mu = {x[2]:.5f} +- {sigma[2]:.5f}")
    if picture:
        ds["e"].attrs["long_name"], ds["drop"].attrs["units"], ds["misfit"].attrs["units"] = "restitution e", "m", "m"
        mbvi.plot_sweep(ds).savefig(picture, dpi=110)
    return float(x[0])


if __name__ == "__main__":
    print(f"restitution {main(*map(int, sys.argv[1:2]), *sys.argv[2:]):.5f}, recorded with {E}")
