"""A parallel gripper lifts a box by friction: one finger has a motor, a mimic joint couples the other to it.

The contact force at each pad is half of the motor's force.
`python examples/parallel_gripper.py lift.html` writes the replay too.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

import mbvi

PALM, FINGER, BOX, SIDE, MU, GRIP = 0.8, 0.1, 0.4, 0.06, 0.5, 16.0
# height of the palm above the middle of the box [m], and of the lift; when the gripper closes, lifts and is up [s]
REACH, HEIGHT, CLOSE, LIFT, UP = 0.1, 0.2, 0.05, 0.25, 0.75
# force of the motor that just holds the box where the lift accelerates most [N]
LEAST = BOX * (9.81 + 10.0 / np.sqrt(3.0) * HEIGHT / (UP - LIFT) ** 2) / MU
LINK = """<link name="{name}"><inertial><mass value="{mass}"/><inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0"
iyz="0"/></inertial>{shapes}</link>"""
SHAPE = '<{kind}><origin xyz="0 0 {z}"/><geometry><box size="{size}"/></geometry></{kind}>'
JOINT = """<joint name="{name}" type="prismatic"><parent link="{parent}"/><child link="{child}"/><origin xyz="{place}"/>
<axis xyz="{axis}"/><limit lower="{lower}" upper="{upper}" effort="100" velocity="2"/>{mimic}</joint>"""


def urdf() -> str:
    """Return a palm that slides up and down, with two fingers that open sideways."""
    palm = "".join(SHAPE.format(kind=kind, z=0.01, size="0.04 0.2 0.02") for kind in ("visual", "collision"))
    finger = "".join(SHAPE.format(kind=kind, z=-0.06, size="0.02 0.01 0.12") for kind in ("visual", "collision"))
    sides, mimic = {"left": 1, "right": -1}, '<mimic joint="left"/>'
    parts = ['<link name="rail"/>', LINK.format(name="palm", mass=PALM, shapes=palm)]
    parts += [LINK.format(name=f"{side}_finger", mass=FINGER, shapes=finger) for side in sides]
    parts.append(
        JOINT.format(name="lift", parent="rail", child="palm", place="0 0 0", axis="0 0 1", lower=-1, upper=1, mimic="")
    )
    for side, sign in sides.items():
        # joint positions are the gap between a pad and the box
        parts.append(
            JOINT.format(
                name=side, parent="palm", child=f"{side}_finger", place=f"0 {sign * (0.5 * SIDE + 0.005)} 0",
                axis=f"0 {sign} 0", lower=-0.03, upper=0.03, mimic=mimic if side == "right" else "",
            )
        )  # fmt: skip
    return f'<robot name="gripper">{"".join(parts)}</robot>'


class Hand:
    """Closes the fingers by a force, then moves the palm along a plan."""

    def __init__(self, grip: float) -> None:
        self.grip = grip

    def __call__(self, t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the forces of the lift and of the driven finger; the other one has no motor."""
        x, length = np.clip((t - LIFT) / (UP - LIFT), 0.0, 1.0), UP - LIFT
        place, speed = HEIGHT * x**3 * (10 - 15 * x + 6 * x**2), HEIGHT * 30 * (x * (1 - x)) ** 2 / length
        wanted = HEIGHT * 60 * x * (1 - x) * (1 - 2 * x) / length**2
        own, held = PALM + 2 * FINGER, BOX * (t > LIFT)
        push = own * (wanted + 900.0 * (place - q[0]) + 60.0 * (speed - v[0]) + 9.81) + held * (wanted + 9.81)
        return np.array([push, -self.grip if t > CLOSE else 0.0, 0.0])


def lift(grip: float = GRIP) -> mbvi.Trajectory:
    """Return the run with a force of the driven finger's motor [N]."""
    made = mbvi.Scene(friction=MU)
    made.add_halfspace((0, 0, 1), name="floor")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "gripper.urdf")
        file.write_text(urdf())
        start, position = {"left": 0.02, "right": 0.02}, (0, 0, 0.5 * SIDE + REACH)
        made.add_urdf(file, base="fixed", position=position, joints=start, control=Hand(grip), name="gripper")
    made.add_box((SIDE, SIDE, SIDE), BOX, position=(0, 0, 0.5 * SIDE), name="box")
    return mbvi.simulate(made.build(), step=1e-3, duration=0.85, progress=False)


def creep(run: mbvi.Trajectory) -> float:
    """Return how far the box moves in the grip while it is lifted [m]."""
    return float(np.ptp((run.q[:, 5] - run.q[:, 0])[run.t > LIFT]))


def main(page: str | None = None) -> float:
    """Return the force of the mimic joint on the finger that has no motor, at the end [N]."""
    run = lift()
    print(f"the box rises {run.q[-1, 5] - run.q[0, 5]:.4f} m, and creeps {creep(run):.0e} m in the grip")
    if page:
        run.replay_html(page)
    return -run.loop_forces("gripper_right")[-1]


if __name__ == "__main__":
    print(f"the mimic joint pushes with {main(*sys.argv[1:]):.9f} N, half of the motor's {GRIP:g} N")
