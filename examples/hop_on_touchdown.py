"""A control of the whole scene: the hopper stretches its leg when its foot touches down, and hops."""

import numpy as np

import mbvi

HOPPER = mbvi.robot("hopper")
BENT = np.array([-0.45, 0.9])
THRUST, PUSH_TIME = 20.0, 0.1


class Hop:
    """A control that keeps the leg bent until touchdown, and stretches it for a tenth of a second after."""

    def __init__(self, robot: str) -> None:
        self.robot, self.touchdown = robot, np.inf

    def __call__(self, state):
        """Return the torques of the base, which has no motor, of the hip and of the knee."""
        if any(contact.name == f"{self.robot}/foot | floor" for contact in state.contacts):
            self.touchdown = min(self.touchdown, state.t)
        q, v = state.q[self.robot][-2:], state.v[self.robot][-2:]
        torque = 40.0 * (BENT - q) - 1.0 * v
        if self.touchdown <= state.t < self.touchdown + PUSH_TIME:
            torque = np.array([0.0, -THRUST])
        return {self.robot: [0.0, 0.0, 0.0, *torque]}


def main(scheme=None, step=2e-4) -> float:
    """Return the height of the trunk at the top of the hop [m]."""
    scene = mbvi.Scene(plane="xz")
    scene.add_halfspace(normal=(0, 0, 1))
    joints = {"hip": BENT[0], "knee": BENT[1]}
    hop = Hop(scene.add_urdf(HOPPER, position=(0, 0, 0.5), joints=joints, name="hopper"))
    scene.add_control(hop)
    scheme = scheme or mbvi.Centered(project_positions=True)
    run = mbvi.simulate(scene.build(), scheme, step=step, duration=0.5)
    top = float(run.q[run.t > hop.touchdown, 1].max())
    print(f"touchdown at {hop.touchdown:.4f} s, top of the hop at {top:.4f} m")
    return top


if __name__ == "__main__":
    main()
