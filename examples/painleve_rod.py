"""A rod slides on its lower end into Painlevé's configuration: no force lets it slide on, and a percussion stops it."""

import numpy as np

import mbvi

HALF, ANGLE, SPEED, FRICTION = 0.5, 1.0, 1.0, 1.6


def gap(q):
    """Return the height of the lower end; q = (x, z, angle) of the middle."""
    return q[1] - HALF * np.sin(q[2])


def gradient(q):
    """Return its gradient."""
    return np.array([0.0, 1.0, -HALF * np.cos(q[2])])


def tangents(q):
    """Return the row of the velocity of the lower end along the floor."""
    return np.array([[1.0, 0.0, HALF * np.sin(q[2])]])


def mass(q):
    """Return the mass matrix of a rod of 1 kg and 1 m."""
    return np.diag([1.0, 1.0, HALF**2 / 3])


def weight(t, q, v):
    """Return its weight."""
    return np.array([0.0, -9.81, 0.0])


def main() -> float:
    """Return the rate at which the rod turns when its lower end has jammed [rad/s]."""
    needed = (1 + 3 * np.cos(ANGLE) ** 2) / (3 * np.sin(ANGLE) * np.cos(ANGLE))
    print(f"a rod at {np.degrees(ANGLE):.0f} degrees jams where mu is above {needed:.2f}; here mu = {FRICTION}")
    system = mbvi.LagrangianSystem(mass, weight, 3)
    floor = mbvi.GapFunction(gap, gradient, name="end | floor", tangents=tangents)
    start = [0.0, HALF * np.sin(ANGLE), ANGLE]
    problem = mbvi.Problem(system, [floor], start, [-SPEED, 0.0, 0.0], friction=FRICTION)
    run = mbvi.simulate(problem, mbvi.Paoli(), step=1e-4, duration=0.05)
    q, v = run.q[1], run.v[1]
    slip = tangents(q)[0] @ v
    print(f"after one step the end slides at {slip:.1e} m/s, and the middle rises at {v[1]:.3f} m/s")
    return float(v[2])


if __name__ == "__main__":
    print(f"it turns at {main():.4f} rad/s; 3 v sin / (2 l) is {1.5 * SPEED * np.sin(ANGLE) / (2 * HALF):.4f}")
