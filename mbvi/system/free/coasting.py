"""Kernels of the motion of free bodies on which nothing acts: it keeps energy and both momenta at any step.

`Centered` moves its bodies so for half a step, lets forces and contacts act on them there, and moves them again.
"""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from .spinning import MOST_PARTS, PART, FreeLinks, add_cross, along, mean_spin, rotated_back

Array = np.ndarray

# angle below which a series replaces a difference with cancellation [rad]
_SMALL = 0.05


@kernel("void(f8[::1], f8, f8, f8, f8)")
def turn_quaternion(turn: Array, x: float, y: float, z: float, s: float) -> None:
    """Multiply a quaternion by (x, y, z, s) of any length from the right; the result has unit length."""
    a, b, c, d = turn[0], turn[1], turn[2], turn[3]
    u, v, w = d * x + s * a + b * z - c * y, d * y + s * b + c * x - a * z, d * z + s * c + a * y - b * x
    r = d * s - (a * x + b * y + c * z)
    length = np.sqrt(u * u + v * v + w * w + r * r)
    turn[0], turn[1], turn[2], turn[3] = u / length, v / length, w / length, r / length


@kernel("void(f8[::1], f8[::1], f8, f8[::1], f8[::1], f8[::1])")
def coast_spin(moments: Array, factors: Array, h: float, spin: Array, turn: Array, rotation: Array) -> None:
    """Turn a body on which no torque acts.

    Parameters
    ----------
    moments, factors : ndarray, shape (3,)
        See `principal`.
    h : float
        Time [s].
    spin : ndarray, shape (3,)
        Angular velocity w along the principal axes, overwritten [rad/s].
    turn : ndarray, shape (4,)
        Room.
    rotation : ndarray, shape (3,)
        Receives the rotation vector r along the principal axes, at their start [rad].

    Notes
    -----
    I (w+ - w) = -k x x I x with x = (w + w+) / 2, and exp(r) is Cayley's rotation by k x, so that exp(r) I w+ = I w:
    the angular momentum keeps its direction in the world, and w . I w stays. Any k does so. k = 2 tan(h s / 2) / s with
    s = w . I w / |I w|, which is constant, makes rotations about principal axes exact, and has order 2 for others. Far
    rotations are taken in parts as in `spin`; s is at most |w|, so that Newton's method converges in each.
    """
    x, y, z = spin[0], spin[1], spin[2]
    p, q, r = moments[0] * x, moments[1] * y, moments[2] * z
    momentum = np.sqrt(p * p + q * q + r * r)
    speed = (p * x + q * y + r * z) / momentum if momentum > 0.0 else 0.0
    turn[0] = turn[1] = turn[2] = 0.0
    turn[3], left = 1.0, h
    for _ in range(MOST_PARTS):
        angle = abs(left) * np.sqrt(x * x + y * y + z * z)
        part = left if angle <= PART else left * PART / angle
        k = 2.0 * np.tan(0.5 * part * speed) / speed if speed > 0.0 else part
        a, b, c, converged = mean_spin(factors, k, x, y, z)
        if not converged:
            break
        turn_quaternion(turn, 0.5 * k * a, 0.5 * k * b, 0.5 * k * c, 1.0)
        x, y, z, left = 2.0 * a - x, 2.0 * b - y, 2.0 * c - z, left - part
        if left == 0.0:
            break
    if left != 0.0:
        angle = left * np.sqrt(x * x + y * y + z * z)
        share = left * np.sin(0.5 * angle) / angle if angle != 0.0 else 0.5 * left
        turn_quaternion(turn, share * x, share * y, share * z, np.cos(0.5 * angle))
    spin[0], spin[1], spin[2] = x, y, z
    size = np.sqrt(turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2])
    share = 2.0 * np.arctan2(size, turn[3]) / size if size > 0.0 else 2.0
    rotation[0], rotation[1], rotation[2] = share * turn[0], share * turn[1], share * turn[2]


@kernel("Tuple((f8, f8, f8))(f8[::1], f8, f8, f8)")
def screw_displacement(rotation: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return the linear part of the tangent vector that moves a frame by (x, y, z) and turns it by exp(rotation)."""
    a, b, c = rotation[0], rotation[1], rotation[2]
    square = a * a + b * b + c * c
    angle = np.sqrt(square)
    if angle < _SMALL:
        share = 1.0 / 12.0 + square * (1.0 / 720.0 + square / 30240.0)
    else:
        share = (1.0 - 0.5 * angle / np.tan(0.5 * angle)) / square
    u, v, w = b * z - c * y, c * x - a * z, a * y - b * x
    return (
        x - 0.5 * u + share * (b * w - c * v),
        y - 0.5 * v + share * (c * u - a * w),
        z - 0.5 * w + share * (a * v - b * u),
    )


@kernel("void(FreeLinks, f8, f8[::1], f8[::1], f8[::1])")
def coast(bodies: FreeLinks, h: float, v: Array, displacement: Array, after: Array) -> None:
    """Write how far bodies move in a time on which nothing acts, and their velocity then.

    Parameters
    ----------
    bodies : FreeLinks
        Those that move so. Other velocities stay, and the displacement along them is h v.
    h : float
        Time [s].
    v : ndarray, shape (nv,)
        Velocity.
    displacement, after : ndarray, shape (nv,)
        Receive the tangent vector and the velocity at its end.
    """
    for k in range(len(v)):
        displacement[k], after[k] = h * v[k], v[k]
    w, u, rotation, centre = bodies.room[0], bodies.room[1], bodies.room[2], bodies.room[3]
    for body in range(len(bodies.first)):
        first, turning, k, c, A = (
            bodies.first[body], bodies.turning[body], bodies.factors[body], bodies.centre[body], bodies.axes[body]
        )  # fmt: skip
        # the rotation of a body of equal moments is h w, but the velocity of its origin may turn with its axes
        if not turning and k[0] == 0.0 and k[1] == 0.0 and k[2] == 0.0:
            continue
        along(A, v[first : first + 6], turning, w, u)
        add_cross(1.0, w, c, u)
        coast_spin(bodies.moments[body], k, h, w, bodies.turn, rotation)
        if turning:
            x, y, z = rotation[0], rotation[1], rotation[2]
            # the arm to the centre, turned with the body
            f, g, e = rotated_back(-1.0, x, y, z, c[0], c[1], c[2])
            f, g, e = screw_displacement(rotation, c[0] + h * u[0] - f, c[1] + h * u[1] - g, c[2] + h * u[2] - e)
            u[0], u[1], u[2] = rotated_back(1.0, x, y, z, u[0], u[1], u[2])
            add_cross(-1.0, w, c, u)
            centre[0], centre[1], centre[2] = f, g, e
        for i in range(3):
            displacement[first + 3 + i] = A[0, i] * rotation[0] + A[1, i] * rotation[1] + A[2, i] * rotation[2]
            after[first + 3 + i] = A[0, i] * w[0] + A[1, i] * w[1] + A[2, i] * w[2]
            if turning:
                displacement[first + i] = A[0, i] * centre[0] + A[1, i] * centre[1] + A[2, i] * centre[2]
                after[first + i] = A[0, i] * u[0] + A[1, i] * u[1] + A[2, i] * u[2]
