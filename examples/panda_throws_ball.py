"""A Panda takes a ball from a stand, swings it and lets go: friction holds it, and it lands in a bucket.

The joints stay below the speeds that the maker allows. Needs the package example-robot-data.
`python examples/panda_throws_ball.py throw.html` writes the replay too.
"""

import sys
import sysconfig
from pathlib import Path

import numpy as np
import pinocchio as pin

import mbvi

PANDA = Path(sysconfig.get_path("purelib"), "cmeel.prefix/share/example-robot-data/robots/panda_description/urdf")
RADIUS, MASS, MU, GRIP = 0.025, 0.05, 0.8, 15.0
# joints 2, 4 and 6 at the stand, before and after the throw [rad]; the others stay
AT_STAND = np.array([0.3, -2.2, 2.5])
BEFORE, AFTER = np.array([-0.35, -1.90, 1.08]), np.array([0.17, -0.95, 2.20])
# when the gripper closes, the arm lifts, the throw begins and ends [s]; the ball is let go at half of the throw
CLOSE, LIFT, THROW, END = 0.05, 0.25, 1.45, 2.365
SWINGING = [1, 3, 5]


def smooth(t: float, begin: float, end: float) -> np.ndarray:
    """Return the fifth-order polynomial from 0 to 1, its rate [1/s] and acceleration [1/s^2]."""
    x, length = np.clip((t - begin) / (end - begin), 0.0, 1.0), end - begin
    values = x**3 * (10 - 15 * x + 6 * x**2), 30 * x**2 * (1 - x) ** 2, 60 * x * (1 - x) * (1 - 2 * x)
    return np.array(values) / length ** np.arange(3)


def planned(t: float) -> np.ndarray:
    """Return positions, speeds and accelerations of the seven joints of the arm, shape (3, 7)."""
    plan = np.zeros((3, 7))
    plan[0, 6] = 0.25 * np.pi
    plan[0, SWINGING] = AT_STAND
    for a, b, begin, end in ((AT_STAND, BEFORE, LIFT, THROW), (BEFORE, AFTER, THROW, END)):
        plan[:, SWINGING] += np.outer(smooth(t, begin, end), b - a)
    return plan


class Thrower:
    """Drives the arm along its plan by inverse dynamics, closes the gripper and opens it."""

    def __init__(self) -> None:
        self.model = pin.buildModelFromUrdf(str(PANDA / "panda.urdf"))
        self.data = self.model.createData()

    def __call__(self, t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the torques and, of the fingers, forces."""
        plan, wanted = planned(t), np.zeros(9)
        wanted[:7] = plan[2] + 900.0 * (plan[0] - q[:7]) + 60.0 * (plan[1] - v[:7])
        tau = pin.rnea(self.model, self.data, q, v, wanted)
        held = CLOSE < t < 0.5 * (THROW + END)
        # one finger follows the other by the file's mimic joint
        tau[7:] = -GRIP if held else 3.0
        return tau

    def hand(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        """Return where the plan has the middle of the fingertips [m], and its velocity [m/s]."""
        plan = np.column_stack([planned(t)[:2], np.zeros((2, 2))])
        frame = self.model.getFrameId("panda_hand_tcp")
        pin.forwardKinematics(self.model, self.data, *plan)
        place = pin.updateFramePlacement(self.model, self.data, frame).translation
        rate = pin.getFrameVelocity(self.model, self.data, frame, pin.LOCAL_WORLD_ALIGNED).linear
        return place.copy(), rate.copy()


def landing(height: float) -> np.ndarray:
    """Return where a ball that leaves the plan's hand falls through a height [m]."""
    place, rate = Thrower().hand(0.5 * (THROW + END))
    flight = (rate[2] + np.sqrt(rate[2] ** 2 + 2 * 9.81 * (place[2] - height))) / 9.81
    return place + rate * flight * [1, 1, 0]


def scene() -> mbvi.Scene:
    """Return the arm with open fingers around a ball on a stand, and the bucket where the ball should land."""
    made, arm = mbvi.Scene(friction=MU), Thrower()
    made.add_halfspace((0, 0, 1), name="floor")
    start = dict(zip(arm.model.names[1:], [*planned(0.0)[0], 0.035, 0.035], strict=True))
    made.add_urdf(PANDA / "panda.urdf", base="fixed", joints=start, control=arm, name="panda")
    place, _ = arm.hand(0.0)
    top = place[2] - RADIUS
    made.add_sphere(RADIUS, MASS, position=place, name="ball")
    made.add_box((0.02, 0.02, top), position=(place[0], 0, 0.5 * top), fixed=True, name="stand")
    middle, rim, half = landing(0.15), 0.15, 0.1
    for k, turn in enumerate((0.0, 0.5, 1.0, 1.5)):
        side = np.array([np.cos(turn * np.pi), np.sin(turn * np.pi), 0.0])
        size = np.where(np.abs(side) > 0.5, 0.01, 2 * half)
        at = [middle[0], 0, 0.5 * rim] + half * side
        made.add_box((size[0], size[1], rim), position=at, fixed=True, name=f"bucket_{k}")
    return made


def main(page: str | None = None, step: float = 2e-3) -> float:
    """Return how far from the middle of the bucket the ball falls through its rim [m]."""
    run = mbvi.simulate(scene().build(), step=step, duration=2.8, progress=False)
    ball = run.q[:, 9:12]
    k = int(np.flatnonzero((ball[:, 2] < 0.15) & (run.t > THROW))[0])
    fastest = np.abs(run.v[:, :7] / Thrower().model.velocityLimit[:7]).max()
    print(f"the joints reach {fastest:.0%} of the speeds that the maker allows")
    print(f"the ball lies {np.linalg.norm(ball[-1, :2] - landing(0.15)[:2]):.3f} m beside the middle of the bucket")
    if page:
        run.replay_html(page)
    return float(np.linalg.norm(ball[k, :2] - landing(0.15)[:2]))


if __name__ == "__main__":
    print(f"the ball falls through the rim {main(*sys.argv[1:]):.4f} m beside the middle")
