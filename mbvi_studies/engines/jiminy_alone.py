"""Server of jiminy, run as a script without mbvi, because the two Pinocchio libraries conflict."""

from __future__ import annotations

import os
import pickle
import sys
import tempfile
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

# otherwise jiminy looks for another pinocchio, and warns
os.environ["JIMINY_FORCE_STANDALONE"] = "1"
import jiminy_py.core as jiminy

Array = np.ndarray

# limits of joints, out of reach [rad]
_FAR = 1e9
# least step [s]
_INSTANT = 1e-6


class Simulation:
    """A simulation of one robot with contact points above the plane z = 0."""

    def __init__(self, urdf: str, free: bool, points: list[tuple[str, Array]], options: dict[str, Any]) -> None:
        self._robot = jiminy.Robot("rig")
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "rig.urdf"
            file.write_text(urdf)
            self._robot.initialize(str(file), free)
        names = [f"point {k}" for k in range(len(points))]
        for name, (link, place) in zip(names, points, strict=True):
            self._robot.add_frame(name, link, jiminy.pinocchio.SE3(np.eye(3), np.asarray(place)))
        self._robot.add_contact_points(names)
        self._unlimited()
        self._engine = jiminy.Engine()
        self._engine.add_robot(self._robot)
        self._set(options)

    def joints(self) -> list[str]:
        """Return the joints' names in the order of coordinates."""
        return [str(name) for name in self._robot.mechanical_joint_names]

    def start(self, q: Array, v: Array, kp: float, kd: float) -> None:
        """Set the state; contacts respond to a gap and its rate with -kp gap - kd rate [m/s^2]."""
        if self._engine.is_simulation_running:
            self._engine.stop()
        self._engine.start(q, v)
        # jiminy sets its own gains at the start
        for contact in self._robot.constraints.contact_frames.values():
            contact.kp, contact.kd = kp, kd

    def go(self, duration: float) -> None:
        """Advance by a time [s]."""
        self._engine.step(duration)

    def until(self, time: float) -> None:
        """Advance to a time after the start, unless the rest is below the least step [s]."""
        left = time - self._engine.stepper_state.t
        if left > _INSTANT:
            self._engine.step(left)

    def clock(self) -> float:
        """Return the CPU time so far [s]."""
        return process_time()

    def read(self) -> tuple[Array, Array]:
        """Return coordinates and velocities."""
        state = self._engine.robot_states[0]
        return np.array(state.q), np.array(state.v)

    def _unlimited(self) -> None:
        options = self._robot.get_model_options()
        count = len(self._robot.mechanical_joint_position_indices)
        options["joints"] = {
            "positionLimitFromUrdf": False, "positionLimitLower": np.full(count, -_FAR),
            "positionLimitUpper": np.full(count, _FAR),
        }  # fmt: skip
        self._robot.set_model_options(options)

    def _set(self, options: dict[str, Any]) -> None:
        known = self._engine.get_options()
        for group, values in options.items():
            known[group].update(values)
        known["telemetry"] = {name: False for name in known["telemetry"]}
        self._engine.set_options(known)


def main() -> None:
    """Answer the requests on standard input until it ends."""
    requests, answers = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    # output of jiminy must not mix with answers
    os.dup2(2, 1)
    simulation: Any = None
    while True:
        try:
            name, arguments = pickle.load(requests)
        except EOFError:
            return
        answer: Any = None
        try:
            if name == "make":
                simulation = Simulation(*arguments)
                answer = simulation.joints()
            else:
                answer = getattr(simulation, name)(*arguments)
            found = (True, answer)
        except Exception as error:
            found = (False, f"{type(error).__name__}: {error}")
        pickle.dump(found, answers)
        answers.flush()


if __name__ == "__main__":
    main()
