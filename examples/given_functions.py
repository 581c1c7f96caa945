"""The setting of the paper, with M(q), g(t, q, v) and f(q) as functions: a double pendulum beside a wall."""

import numpy as np

import mbvi

GRAVITY = 9.81


def mass(q):
    """Return M(q) of two unit masses on unit rods, angles from the vertical."""
    c = np.cos(q[0] - q[1])
    return np.array([[2.0, c], [c, 1.0]])


def force(t, q, v):
    """Return g(t, q, v), the terms quadratic in v included."""
    s = np.sin(q[0] - q[1])
    return np.array([-s * v[1] ** 2 - 2 * GRAVITY * np.sin(q[0]), s * v[0] ** 2 - GRAVITY * np.sin(q[1])])


def distance(q):
    """Return the distance of the tip from the wall."""
    return np.sin(q[0]) + np.sin(q[1]) + 0.5


wall = mbvi.GapFunction(distance, np.cos, name="tip | wall")


def main() -> float:
    """Return the time of the first impact [s]."""
    system = mbvi.LagrangianSystem(mass=mass, force=force, dim=2)
    problem = mbvi.Problem(system, [wall], q0=[0.9, 0.7], v0=[0.0, 0.0], restitution=0.8)
    run = mbvi.simulate(problem, mbvi.Paoli(), step=1e-4, duration=3.0)
    print(run.impact_table())
    return run.impacts[0].time


if __name__ == "__main__":
    print(f"first impact at {main():.4f} s")
