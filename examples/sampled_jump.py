"""Sampling-based control: torques with which the hopper jumps highest, found by the cross-entropy method.

Every iteration draws torques about the best ones known, rolls all of them out at once, and keeps the best eighth.
"""

import numpy as np

import mbvi

HOPPER = mbvi.robot("hopper")
STEP, STEPS = 1e-3, 350
# torques are constant for so many steps; they act on the hip and on the knee
HOLD, MOST = 50, 20.0
# the base has no motor: along x, along z, pitch
BASE = 3


def build(control=None) -> mbvi.Problem:
    """Return the hopper in a plane, crouching just above the floor."""
    scene = mbvi.Scene(plane="xz")
    scene.add_halfspace(normal=(0, 0, 1))
    joints = {"hip": -0.6, "knee": 1.2}
    scene.add_urdf(HOPPER, position=(0, 0, 0.42), joints=joints, control=control)
    return scene.build()


def torques(knots) -> np.ndarray:
    """Return the torques of each step, shape (n, STEPS, 5), from those that are held, shape (n, STEPS / HOLD, 2)."""
    held = np.repeat(np.clip(knots, -MOST, MOST), HOLD, axis=1)
    return np.concatenate([np.zeros((*held.shape[:2], BASE)), held], axis=2)


def reward(q) -> np.ndarray:
    """Return the height of the trunk at its highest point, less its drift and its pitch there, shape (n,)."""
    top = q[:, :, 1].argmax(axis=1)
    x, z, _, sine = q[np.arange(len(q)), top, :4].T
    return z - 0.5 * np.abs(x) - 0.5 * np.abs(sine)


def search(problem, samples=32, iterations=6, threads=2, seed=0) -> tuple[np.ndarray, list[float]]:
    """Return the best torques, shape (STEPS, 5), and the reward after each iteration."""
    rng = np.random.default_rng(seed)
    mean, spread = np.zeros((STEPS // HOLD, 2)), np.full((STEPS // HOLD, 2), 0.5 * MOST)
    q0, v0 = np.tile(problem.q0, (samples, 1)), np.tile(problem.v0, (samples, 1))
    best, rewards = mean, []
    for _ in range(iterations):
        knots = mean + spread * rng.normal(size=(samples, *mean.shape))
        # the best so far is among them, so that the reward never falls
        knots[0] = best
        found = mbvi.rollout(problem, q0, v0, steps=STEPS, step=STEP, control=torques(knots), threads=threads)
        value = np.where(found.status == 0, reward(found.q), -np.inf)
        order = np.argsort(-value)[: samples // 8]
        best, mean, spread = knots[order[0]], knots[order].mean(axis=0), knots[order].std(axis=0) + 0.2
        rewards.append(float(value[order[0]]))
    return torques(best[None])[0], rewards


def main(page="jump.html", **options) -> float:
    """Return how much higher the hopper jumps than its trunk is at the start [m]."""
    problem = build()
    torque, rewards = search(problem, **options)
    run = mbvi.simulate(
        build(lambda t, q, v: torque[min(int(t / STEP), STEPS - 1)]), step=STEP, duration=STEPS * STEP, progress=False
    )
    rise = float(run.q[:, 1].max() - run.q[0, 1])
    print(f"rewards {np.round(rewards, 3).tolist()}; the trunk rises by {rise:.3f} m")
    run.replay_html(page)
    return rise


if __name__ == "__main__":
    main()
