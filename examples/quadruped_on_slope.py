"""The quadruped stands on a slope, then walks in place: springs in its joints hold it, friction holds its feet.

`python examples/quadruped_on_slope.py walk.html` writes the replay too.
"""

import sys

import numpy as np

import mbvi

QUADRUPED = mbvi.robot("quadruped")
ANGLE, FRICTION = np.radians(15), 0.6
# the feet are below the hips, the trunk is parallel to the slope
CROUCH = np.tile([0.0, 0.7 + ANGLE, -1.4], 4)
# the legs are FL, FR, RL, RR: those of a diagonal lift together
DIAGONAL = np.repeat([0, 1, 1, 0], 3)
LIFT = np.tile([0.0, 0.2, -0.4], 4)
WALK, PERIOD = 2.5, 0.4
STIFFNESS, DAMPING = 200.0, 6.0


def legs(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return the torques of springs and dampers; the first six entries belong to the free base and are zero."""
    rise = max(0.0, np.sin(2 * np.pi * (t - WALK) / PERIOD)), max(0.0, -np.sin(2 * np.pi * (t - WALK) / PERIOD))
    target = CROUCH + LIFT * np.array(rise)[DIAGONAL] * (t > WALK)
    return np.concatenate([np.zeros(6), STIFFNESS * (target - q[7:]) - DAMPING * v[6:]])


def main(page: str | None = None) -> float:
    """Return how far the standing robot creeps in half a second, when it has settled [m]."""
    uphill, normal = np.array([np.cos(ANGLE), 0, np.sin(ANGLE)]), np.array([-np.sin(ANGLE), 0, np.cos(ANGLE)])
    scene = mbvi.Scene(friction=FRICTION)
    scene.add_halfspace(normal, name="slope")
    joints = {f"{leg}_{joint}_joint": 0.0 for leg in ("FL", "FR", "RL", "RR") for joint in ("hip", "thigh", "calf")}
    joints = dict(zip(joints, CROUCH.tolist(), strict=True))
    turn = np.column_stack([uphill, [0, 1, 0], normal])
    # the feet, balls of 0.023 m, are below two links of 0.2 m
    height = 0.4 * np.cos(0.7) * np.cos(ANGLE) + 0.023
    scene.add_urdf(QUADRUPED, position=height * normal, rotation=turn, joints=joints, control=legs)
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=5e-4, duration=WALK + 4 * PERIOD, every=10)
    settled, stood = run.q[np.searchsorted(run.t, WALK - 0.5), :3], run.q[np.searchsorted(run.t, WALK), :3]
    walked = (stood - run.q[-1, :3]) @ uphill
    print(f"each of eight steps in place takes it {1e3 * walked / 8:.1f} mm down the slope, as far as it sways")
    if page:
        run.replay_html(page)
    return float(abs((stood - settled) @ uphill))


if __name__ == "__main__":
    print(f"it stood for half a second and crept {main(*sys.argv[1:]):.1e} m")
