"""The quadruped stands on rubble, a height field of random stones, and is pushed: friction holds its feet.

`python examples/quadruped_on_rubble.py rubble.html` writes the replay too.
"""

import sys

import numpy as np
import pinocchio as pin

import mbvi

QUADRUPED = mbvi.robot("quadruped")
CROUCH = np.tile([0.0, 0.7, -1.4], 4)
STIFFNESS, DAMPING = 200.0, 6.0
# stones of 5 cm, up to 4 cm high; the push [N] acts sideways on the trunk, from one time to the other [s]
CELL, STONE, FRICTION = 0.05, 0.04, 0.8
PUSH, PUSHED, STEP, DURATION = 60.0, (1.0, 1.2), 5e-4, 2.0


def control(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return the push on the free base, in its own axes, and the torques of springs and dampers."""
    push = np.zeros(6)
    if PUSHED[0] <= t < PUSHED[1]:
        x, y, z, w = q[3:7]
        # the second row of the rotation is the world's y as the trunk sees it
        push[:3] = PUSH * np.array([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)])
    return np.concatenate([push, STIFFNESS * (CROUCH - q[7:]) - DAMPING * v[6:]])


def main(page: str | None = None) -> float:
    """Return the impulse of the rubble over weight times duration plus gain of momentum."""
    points = 41
    heights = STONE * np.random.default_rng(3).random((points, points))
    scene = mbvi.Scene(friction=FRICTION)
    scene.add_heightfield(heights, size=(CELL * (points - 1),) * 2, name="rubble")
    names = [f"{leg}_{joint}_joint" for leg in ("FL", "FR", "RL", "RR") for joint in ("hip", "thigh", "calf")]
    joints = dict(zip(names, CROUCH.tolist(), strict=True))
    scene.add_urdf(QUADRUPED, position=(0, 0, 0.4), joints=joints, control=control, name="quadruped")
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=STEP, duration=DURATION, record="contacts")
    moved = run.q[-1, :2] - run.q[np.searchsorted(run.t, PUSHED[0]), :2]
    lean = 2 * np.degrees(np.arccos(abs(run.q[-1, 6])))
    print(f"the push moved it by {100 * np.hypot(*moved):.1f} cm; at the end it leans by {lean:.0f} degrees")
    print(f"its feet are never deeper than {1e3 * run.penetration().max():.2f} mm")
    if page:
        run.replay_html(page)
    model = run.problem.system.model
    data, weight = model.createData(), 9.81 * pin.computeTotalMass(model)
    first, last = (pin.computeCentroidalMomentum(model, data, run.q[k], run.v[k]).linear[2] for k in (0, -1))
    return float(np.diff(run.t) @ run.contact_forces("quadruped")[1:, 2] / (weight * DURATION + last - first))


if __name__ == "__main__":
    print(f"the rubble gave {main(*sys.argv[1:]):.6f} of the momentum that the quadruped gained against gravity")
