"""A linear-quadratic regulator along a hop with impacts keeps a hopper hopping, which falls without it.

Derivatives through the landing give the linear model between control times. Newton's method finds with them a hop that
repeats itself, and the Riccati recursion the gains.
"""

import numpy as np

import mbvi

# each hop has so many intervals with constant targets of the drives; their length [s], and hops of a run
INTERVALS, LENGTH, HOPS = 4, 0.1, 3
STIFFNESS, DAMPING = 100.0, 2.0
SCHEME = mbvi.EventDriven(1e-7)
WRT = ["state", "control target of hopper/hip", "control target of hopper/knee"]
# a rough hop: place of the trunk, cosine and sine of its pitch, hip and knee; their velocities; targets of both drives
PITCH = -0.135
START = np.array([0, 0.518, np.cos(PITCH), np.sin(PITCH), -0.698, 0.911]), np.array([0.07, -0.49, -0.05, -0.08, 0.15])
TARGETS = np.array([[-0.594, 0.915], [-0.624, 1.022], [-0.306, 0.446], [-0.699, 0.913]])
# what deviations of the state cost, and those of targets
COSTS = np.repeat([1.0, 0.01], 5), np.array([0.1, 0.1])
# a blow turns the trunk at the start [N m s]; one along x would leave a drift, because no force acts there
BLOW = np.array([0.0, 0.0, 0.01, 0.0, 0.0])


class Hopper:
    """The hopper over a floor without friction, with a drive in its hip and in its knee; states are pairs (q, v)."""

    def __init__(self) -> None:
        self.drive = mbvi.PDControl(np.zeros(2), STIFFNESS, DAMPING)
        scene = mbvi.Scene(plane="xz")
        scene.add_halfspace((0, 0, 1), name="floor")
        scene.add_urdf(mbvi.robot("hopper"), position=(0, 0, 1), name="hopper", control=self.drive)
        self.problem = scene.build()

    def moved(self, state, change):
        """Return a state that is moved by a variation, shape (10,)."""
        return self.problem.system.integrate(state[0], change[:5]), state[1] + change[5:]

    def apart(self, state, other):
        """Return the variation that leads from a state to another one, shape (10,)."""
        return np.concatenate([self.problem.system.difference(state[0], other[0]), other[1] - state[1]])

    def after(self, state, target):
        """Return the state after an interval."""
        self.drive.q[:] = target
        run = mbvi.simulate(self.problem.at(*state), SCHEME, duration=LENGTH, progress=False)
        return run.q[-1], run.v[-1]

    def hop(self, state, targets):
        """Return the states of a hop, and the derivatives of each by the one before (A) and by the targets (B)."""
        states, A, B = [state], [], []
        for target in targets:
            self.drive.q[:] = target
            found = mbvi.sensitivity(self.problem.at(*states[-1]), SCHEME, duration=LENGTH, wrt=WRT)
            states.append((found.run.q[-1], found.run.v[-1]))
            A.append(found.matrix[:, :10])
            B.append(found.matrix[:, 10:])
        return states, A, B


def periodic(hopper):
    """Return states, targets and derivatives A, B of a hop that ends as it began, by Newton's method."""
    state, targets = START, TARGETS
    while True:
        states, A, B = hopper.hop(state, targets)
        left = hopper.apart(state, states[-1])
        if np.abs(left).max() < 1e-6:
            return states, targets, A, B
        by_state, by_targets = np.eye(10), np.zeros((10, 0))
        for a, b in zip(A, B, strict=True):
            by_state, by_targets = a @ by_state, np.hstack([a @ by_targets, b])
        # the least change: where along x the hopper starts makes no difference
        change = -np.linalg.lstsq(np.hstack([by_state - np.eye(10), by_targets]), left, rcond=1e-8)[0]
        state, targets = hopper.moved(state, change[:10]), targets + change[10:].reshape(-1, 2)


def regulator(A, B):
    """Return the gains K of all intervals of a run: targets are changed by -K x where the state is off by x."""
    Q, R = map(np.diag, COSTS)
    P, gains = Q, []
    for a, b in zip(A[::-1] * HOPS, B[::-1] * HOPS, strict=True):
        K = np.linalg.solve(R + b.T @ P @ b, b.T @ P @ a)
        P = Q + a.T @ P @ (a - b @ K)
        gains.insert(0, K)
    return gains


def hop_on(hopper, states, targets, gains, blow=BLOW):
    """Return by how much the state is off, shape (k, 10), at the start and after each hop, until the hopper falls."""
    q, v = states[0]
    state = q, v + np.linalg.solve(hopper.problem.system.metric(q).dense(), blow)
    off = [hopper.apart(states[0], state)]
    for k, K in enumerate(gains):
        now = k % INTERVALS
        state = hopper.after(state, targets[now] - K @ hopper.apart(states[now], state))
        if now == INTERVALS - 1:
            off.append(hopper.apart(states[0], state))
            if abs(off[-1][2]) > 1.0:
                break
    return np.array(off)


def main() -> float:
    """Return the part of the disturbance that feedback leaves after all hops."""
    hopper = Hopper()
    states, targets, A, B = periodic(hopper)
    gains = regulator(A, B)
    off = hop_on(hopper, states, targets, gains)
    without = hop_on(hopper, states, targets, np.zeros_like(gains))
    print("off after each hop, with feedback:", *(f"{one:.1e}" for one in np.abs(off[1:]).max(axis=1)))
    print(f"without it the hopper falls in hop {len(without) - 1}, tilted by {abs(without[-1, 2]):.2f} rad")
    return float(np.abs(off[-1]).max() / np.abs(off[0]).max())


if __name__ == "__main__":
    print(f"{100 * main():.3f} % of the disturbance is left")
