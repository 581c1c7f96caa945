"""Derivatives of exact motions, which are written for complex numbers."""

import numpy as np

import mbvi

G = 9.81


def slopes(motion, x):
    """The derivative of motion(x), exact to rounding."""
    steps = 1e-30j * np.eye(len(x))
    return np.array([np.imag(motion(x + dx)) / 1e-30 for dx in steps]).T


def agrees(found, exact, tolerance=1e-8):
    assert np.abs(found - exact).max() <= tolerance * np.abs(exact).max()


def beads(x, duration, masses):
    """Beads on a line, from (places, speeds, e)."""
    n = len(masses)
    q, v, e, left = x[:n], x[n : 2 * n], x[-1], duration
    while True:
        closing = [(q[k + 1] - q[k]) / (v[k] - v[k + 1]) if v[k].real > v[k + 1].real else np.inf for k in range(n - 1)]
        k = int(np.argmin(np.real(closing)))
        if np.real(closing[k]) > np.real(left):
            return np.concatenate([q + left * v, v])
        q, left = q + closing[k] * v, left - closing[k]
        a, b = masses[k : k + 2]
        push = (1 + e) * (v[k] - v[k + 1]) * a * b / (a + b)
        v = v + np.array([-push / a if j == k else push / b if j == k + 1 else 0 for j in range(n)])


def block(width, tilt, inertia, e):
    """A planar block that falls on two feet; G's cosine is (I - m w^2) / (I + m w^2)."""
    system = mbvi.LagrangianSystem(lambda q: np.diag([1.0, inertia]), lambda t, q, v: np.array([-G, 0.0]), 2)
    feet = [
        mbvi.GapFunction(
            lambda q, s=s: q[0] + s * width * np.sin(q[1]), lambda q, s=s: np.array([1.0, s * width * np.cos(q[1])]),
            name=f"foot {s:+d} | floor",
        )
        for s in (-1, 1)
    ]  # fmt: skip
    return mbvi.Problem(system, feet, [0.3, tilt], [0.0, 0.0], restitution=e)
