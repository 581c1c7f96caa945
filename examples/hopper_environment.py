"""A hopper as an environment for reinforcement learning: gymnasium's interface, whether it is installed or not."""

from typing import NamedTuple

import numpy as np

import mbvi

try:
    from gymnasium import Env
    from gymnasium.spaces import Box
except ImportError:
    Env = object

    class Box(NamedTuple):
        """Bounds of actions or observations."""

        low: np.ndarray
        high: np.ndarray
        dtype: type


HOPPER = mbvi.robot("hopper")
BENT = np.array([-0.45, 0.9])


class HopperEnv(Env):
    """Hop on the spot: actions are torques of hip and knee in units of 20 N m, held for ten steps of a millisecond."""

    TORQUE, HOLD = 20.0, 10

    def __init__(self) -> None:
        scene = mbvi.Scene(plane="xz")
        scene.add_halfspace(normal=(0, 0, 1))
        self._motors = mbvi.ConstantTorque(np.zeros(2))
        joints = {"hip": BENT[0], "knee": BENT[1]}
        scene.add_urdf(HOPPER, position=(0, 0, 0.5), joints=joints, name="hopper", control=self._motors)
        self._problem = scene.build()
        self.simulator = mbvi.Simulator(self._problem, step=1e-3)
        size = self._problem.system.nq + self._problem.system.nv
        self.action_space = Box(-np.ones(2), np.ones(2), dtype=np.float64)
        self.observation_space = Box(np.full(size, -np.inf), np.full(size, np.inf), dtype=np.float64)

    def reset(self, *, seed=None, options=None):
        """Return the first observation: the initial state, with small random speeds."""
        v = self._problem.v0 + 0.01 * np.random.default_rng(seed).normal(size=self._problem.system.nv)
        self.simulator.reset(self._problem.q0, v)
        return self._observed(), {}

    def step(self, action):
        """Return observation, reward, whether the trunk has fallen, whether the episode is over, and the contacts."""
        self._motors.torque[:] = self.TORQUE * np.clip(action, -1.0, 1.0)
        q, _ = self.simulator.step(self.HOLD)
        height, upright = q[1], q[2]
        contacts = {"contacts": [contact.name for contact in self.simulator.contacts]}
        return self._observed(), float(height), bool(height < 0.2 or upright < 0.5), self.simulator.t >= 1.0, contacts

    def _observed(self) -> np.ndarray:
        return np.concatenate([self.simulator.q, self.simulator.v])


def main() -> float:
    """Return by how much an episode differs from `simulate` with the same torques."""
    env = HopperEnv()
    observation, _ = env.reset(seed=0)
    start, actions, rewards = observation, [], []
    while True:
        q, v = observation[:6], observation[6:]
        actions.append((8.0 * (BENT - q[-2:]) - 0.4 * v[-2:]) / HopperEnv.TORQUE)
        observation, reward, fallen, over, info = env.step(actions[-1])
        rewards.append(reward)
        if fallen or over:
            break
    torques = np.zeros((len(actions), 5))
    torques[:, 3:] = HopperEnv.TORQUE * np.clip(actions, -1.0, 1.0)
    torques = np.repeat(torques, HopperEnv.HOLD, axis=0)
    again = mbvi.rollout(env._problem, start[None, :6], start[None, 6:], steps=len(torques), control=torques)
    print(f"{len(actions)} actions, mean height {np.mean(rewards):.3f} m, at the end {info['contacts']}")
    return float(np.abs(again.q[0, -1] - observation[:6]).max())


if __name__ == "__main__":
    main()
