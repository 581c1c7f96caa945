"""A suction cup whose force and switch are of one object with a memory."""

import mbvi


class Gripper:
    """It comes down, holds the load when it touches it, and lifts it."""

    def __init__(self):
        self.holds = False

    def force(self, t, q, v):
        goal = 0.3 if self.holds else 0.1
        return [0, 0, 9.81 * (0.2 + 0.1 * self.holds) + 20.0 * (goal - q[2]) - 4.0 * v[2], 0, 0, 0]

    def grasp(self, state):
        names = {contact.name for contact in state.contacts}
        self.holds = self.holds or any({"cup", "load"} <= set(name.split(" | ")) for name in names)
        return {"suction": self.holds}


def suction_cup():
    """The cup above a load on a floor, and its gripper."""
    scene, gripper = mbvi.Scene(), Gripper()
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_box((0.1, 0.1, 0.1), 0.1, position=(0, 0, 0.05), name="load")
    scene.add_box((0.05, 0.05, 0.02), 0.2, position=(0, 0, 0.2), name="cup")
    scene.add_force("cup", gripper.force)
    scene.weld("cup", "load", name="suction", active=False)
    return scene.build(), gripper
