"""Go2 is pushed off the top of a flight of stairs and tumbles down: its hulls strike the edges of the steps.

Needs the package example-robot-data. `python examples/robot_on_stairs.py stairs.html` writes the replay too.
"""

import sys
import sysconfig
from pathlib import Path

import numpy as np
import pinocchio as pin

import mbvi

GO2 = Path(sysconfig.get_path("purelib"), "cmeel.prefix/share/example-robot-data/robots/go2_description/urdf/go2.urdf")
# a landing, and six steps down [m]
STEPS, RISE, GOING, WIDTH, LANDING = 6, 0.17, 0.29, 3.0, 1.2
LEGS = np.tile([0.0, 0.9, -1.8], 4)
STIFFNESS, DAMPING, SPEED, STEP, DURATION = 40.0, 2.0, 2.5, 1e-3, 2.5


def hold(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return torques that hold the legs; the free base has none."""
    return np.concatenate([np.zeros(6), STIFFNESS * (LEGS - q[7:]) - DAMPING * v[6:]])


def stairs(scene: mbvi.Scene) -> None:
    """Add boxes side by side: robots slide over the borders between them as over one surface."""
    scene.add_halfspace((0, 0, 1), name="floor")
    for k in range(STEPS + 1):
        top, length = (STEPS + 1 - k) * RISE, GOING if k else LANDING
        x = (k - 0.5) * GOING if k else -0.5 * LANDING
        scene.add_box((length, WIDTH, top), position=(x, 0, 0.5 * top), fixed=True, name=f"step_{k}")


def main(page: str | None = None, step: float = STEP) -> float:
    """Return the impulse of stairs and floor over weight times duration plus gain of momentum."""
    scene = mbvi.Scene(friction=0.4)
    stairs(scene)
    names = [f"{leg}_{joint}_joint" for leg in ("FL", "FR", "RL", "RR") for joint in ("hip", "thigh", "calf")]
    joints = dict(zip(names, LEGS.tolist(), strict=True))
    start = {"position": (-0.5, 0, (STEPS + 1) * RISE + 0.32), "base_velocity": (SPEED, 0, 0, 0, 0, 0)}
    scene.add_urdf(GO2, **start, joints=joints, control=hold, name="go2")
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=step, duration=DURATION, record="contacts")
    steps = {name for pair in run.contact_forces() for name in pair if name.startswith("step")}
    print(f"it came down {run.q[0, 2] - run.q[-1, 2]:.2f} m and touched {len(steps)} of {STEPS + 1} steps")
    print(f"no contact is deeper than {1e3 * run.penetration().max():.1f} mm")
    if page:
        run.replay_html(page)
    model = run.problem.system.model
    data, weight = model.createData(), 9.81 * pin.computeTotalMass(model)
    first, last = (pin.computeCentroidalMomentum(model, data, run.q[k], run.v[k]).linear[2] for k in (0, -1))
    return float(np.diff(run.t) @ run.contact_forces("go2")[1:, 2] / (weight * DURATION + last - first))


if __name__ == "__main__":
    print(f"stairs and floor gave {main(*sys.argv[1:]):.6f} of the momentum that the robot gained against gravity")
