"""Kernels of the gyroscopic torques of free bodies: a rule that keeps the energy of rotation at any step."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ...compiled import kernel, record

Array = np.ndarray

# largest angle of one part of a step [rad]: below sqrt(3) / 2 Newton's method converges, see `spin`
PART = 0.8
# most parts of a step, and most iterations in each; four are usual
MOST_PARTS, _MOST_ITERATIONS = 64, 12
# relative error below rounding
_ROUNDING = 1e-17


def principal(inertias: Array) -> tuple[Array, Array, Array]:
    """Return principal axes of bodies, their moments of inertia, and the factors k of `spin`.

    Parameters
    ----------
    inertias : ndarray, shape (n, 3, 3)
        About the centres of mass, in the bodies' axes [kg m^2].

    Returns
    -------
    axes, moments, factors : ndarray, shapes (n, 3, 3), (n, 3) and (n, 3)
        An axis in each row; zero factors where a moment is zero.
    """
    moments, axes = np.linalg.eigh(inertias)
    # right-handed, as Euler's equation is
    axes[:, :, 0] *= np.sign(np.linalg.det(axes))[:, None]
    difference = np.roll(moments, -2, axis=1) - np.roll(moments, -1, axis=1)
    factors = np.divide(difference, moments, out=np.zeros_like(moments), where=moments > 0.0)
    return np.ascontiguousarray(axes.transpose(0, 2, 1)), moments, factors


@kernel("Tuple((f8, f8, f8, b1))(f8[::1], f8, f8, f8, f8)")
def mean_spin(factors: Array, h: float, first: float, second: float, third: float) -> tuple[float, float, float, bool]:
    """Return x of `spin` by Newton's method from x = w = (first, second, third), and whether it converged."""
    a, b, c = 0.5 * h * factors[0], 0.5 * h * factors[1], 0.5 * h * factors[2]
    x, y, z, small = first, second, third, _ROUNDING * np.sqrt(first * first + second * second + third * third)
    for _ in range(_MOST_ITERATIONS):
        d, e, f = first - x - a * y * z, second - y - b * z * x, third - z - c * x * y
        # Cramer's rule for the matrix (1, A, B; C, 1, D; E, F, 1)
        A, B, C, D, E, F = a * z, a * y, b * z, b * x, c * y, c * x
        share = 1.0 / (1.0 - D * F - A * C - B * E + A * D * E + B * C * F)
        u = share * ((1.0 - D * F) * d + (B * F - A) * e + (A * D - B) * f)
        v = share * ((D * E - C) * d + (1.0 - B * E) * e + (B * C - D) * f)
        w = share * ((C * F - E) * d + (A * E - F) * e + (1.0 - A * C) * f)
        x, y, z = x + u, y + v, z + w
        # the error is at most h times the square of the last correction; written so that a NaN does not converge
        if abs(h) * (u * u + v * v + w * w) <= small:
            return x, y, z, True
    return x, y, z, False


@kernel("Tuple((f8, f8, f8))(f8, f8, f8, f8, f8, f8, f8)")
def rotated_back(h: float, x: float, y: float, z: float, u: float, v: float, w: float) -> tuple[float, float, float]:
    """Return exp(-h (x, y, z)) (u, v, w)."""
    angle = h * np.sqrt(x * x + y * y + z * z)
    share = h * np.sin(0.5 * angle) / angle if angle != 0.0 else 0.5 * h
    x, y, z, s = -share * x, -share * y, -share * z, np.cos(0.5 * angle)
    a, b, c = 2.0 * (y * w - z * v), 2.0 * (z * u - x * w), 2.0 * (x * v - y * u)
    return u + s * a + y * c - z * b, v + s * b + z * a - x * c, w + s * c + x * b - y * a


@kernel("void(f8[::1], f8, f8[:,::1])")
def spin(factors: Array, h: float, state: Array) -> None:
    """Advance the angular velocity of a body by gyroscopic torques alone.

    Parameters
    ----------
    factors : ndarray, shape (3,)
        k = ((I3 - I2) / I1, (I1 - I3) / I2, (I2 - I1) / I3).
    h : float
        Time [s].
    state : ndarray, shape (2, 3)
        Components along the principal axes, overwritten: of the angular velocity w [rad/s], and of a vector u that is
        fixed in the world.

    Notes
    -----
    I (w+ - w) = -h x x I x with x = (w + w+) / 2, the implicit midpoint rule, of order 2. It keeps the energy
    w . I w / 2 and the norm of I w, because both are quadratic. u becomes exp(-h x) u.

    Along the principal axes x + h k (x2 x3, x3 x1, x1 x2) / 2 = w. |k| <= 1 holds for every physical inertia, so that
    by Kantorovich's theorem Newton's method converges from x = w where h |w| <= sqrt(3) / 2. A body that turns farther
    takes the step in parts. After the last of 64 parts, 51 rad, it stays where it is on its orbit of the same energy.
    """
    x, y, z, u, v, w = state[0, 0], state[0, 1], state[0, 2], state[1, 0], state[1, 1], state[1, 2]
    carries = u != 0.0 or v != 0.0 or w != 0.0
    left = h
    for _ in range(MOST_PARTS):
        angle = abs(left) * np.sqrt(x * x + y * y + z * z)
        part = left if angle <= PART else left * PART / angle
        a, b, c, converged = mean_spin(factors, part, x, y, z)
        if not converged:
            break
        if carries:
            u, v, w = rotated_back(part, a, b, c, u, v, w)
        x, y, z, left = 2.0 * a - x, 2.0 * b - y, 2.0 * c - z, left - part
        if left == 0.0:
            break
    if carries and left != 0.0:
        u, v, w = rotated_back(left, x, y, z, u, v, w)
    state[0, 0], state[0, 1], state[0, 2], state[1, 0], state[1, 1], state[1, 2] = x, y, z, u, v, w


@kernel("void(f8[::1], f8[:,::1], f8[:,:,::1], f8[:,::1], f8, f8[:,::1], f8[::1])")
def free_velocities(v: Array, pull: Array, axes: Array, factors: Array, h: float, state: Array, out: Array) -> None:
    """Write the velocities of bodies without contacts after a time.

    Parameters
    ----------
    v : ndarray, shape (6 n,)
        Velocities of the centres in the world, angular velocities in the bodies' axes.
    pull : ndarray, shape (n, 3)
        Accelerations of the centres [m/s^2].
    axes, factors : ndarray, shapes (n, 3, 3) and (n, 3)
        See `principal`.
    h : float
        Time [s].
    state : ndarray, shape (2, 3)
        Room.
    out : ndarray, shape (6 n,)
        Receives the velocities, the angular ones as of `spin`.
    """
    for body in range(len(pull)):
        j, A, k = 6 * body, axes[body], factors[body]
        for c in range(3):
            out[j + c], out[j + 3 + c] = v[j + c] + h * pull[body, c], v[j + 3 + c]
        # of a body whose moments are equal the angular velocity stays
        if k[0] == 0.0 and k[1] == 0.0 and k[2] == 0.0:
            continue
        for c in range(3):
            state[0, c] = A[c, 0] * v[j + 3] + A[c, 1] * v[j + 4] + A[c, 2] * v[j + 5]
            state[1, c] = 0.0
        spin(k, h, state)
        for c in range(3):
            out[j + 3 + c] = A[0, c] * state[0, 0] + A[1, c] * state[0, 1] + A[2, c] * state[0, 2]


@record("i8[::1], b1[::1], f8[::1], f8[:,::1], f8[:,:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[::1]")
class FreeLinks(NamedTuple):
    """The free bodies of a Pinocchio model: links on a joint of six velocities that carry no other link.

    Attributes
    ----------
    first : ndarray of int, shape (k,)
        The first velocity of each.
    turning : ndarray of bool, shape (k,)
        Whether the velocity of its origin is in the body's axes, and not in the world's.
    mass : ndarray, shape (k,)
        Masses [kg].
    centre : ndarray, shape (k, 3)
        Centres of mass, along the principal axes [m].
    axes, moments, factors : ndarray, shapes (k, 3, 3), (k, 3) and (k, 3)
        See `principal`.
    state, room, turn : ndarray, shapes (2, 3), (6, 3) and (4,)
        Room.
    """

    first: Array
    turning: Array
    mass: Array
    centre: Array
    axes: Array
    moments: Array
    factors: Array
    state: Array
    room: Array
    turn: Array


def free_links(model: pin.Model) -> FreeLinks:
    """Return the free bodies of a model; without those whose joint has armature or damping, which act on it alone."""
    found = []
    for joint in range(1, model.njoints):
        kind, j = model.joints[joint].shortname(), model.idx_vs[joint]
        if kind == "JointModelComposite":
            kind = " ".join(part.shortname() for part in model.joints[joint].extract().joints)
        body, acted = model.inertias[joint], [*model.armature[j : j + 6], *model.damping[j : j + 6]]
        lone = model.parents[joint] == 0 and joint not in list(model.parents)
        turning, heavy = kind == "JointModelFreeFlyer", body.mass > 0.0 and np.linalg.eigvalsh(body.inertia)[0] > 0.0
        fixed = kind == "JointModelTranslation JointModelSpherical" and not body.lever.any()
        if lone and heavy and (turning or fixed) and not np.any(acted):
            found.append((j, turning, body.mass, body.lever, body.inertia))
    first, turning, mass, lever, inertia = zip(*found, strict=True) if found else ((),) * 5
    axes, moments, factors = principal(np.array(inertia, float).reshape(-1, 3, 3))
    centre = np.einsum("kij,kj->ki", axes, np.array(lever, float).reshape(-1, 3))
    numbers = np.array(first, np.int64), np.array(turning, bool), np.array(mass, float)
    return FreeLinks(*numbers, centre, axes, moments, factors, *_room())


def links_of_bodies(masses: Array, inertias: Array) -> FreeLinks:
    """Return the free bodies of `FreeBodies`, of masses and inertias of the shapes (n,) and (n, 3, 3)."""
    n = len(masses)
    found = principal(inertias)
    return FreeLinks(6 * np.arange(n), np.zeros(n, bool), masses.astype(float), np.zeros((n, 3)), *found, *_room())


def _room() -> tuple[Array, Array, Array]:
    """Return what `FreeLinks` has of room."""
    return np.zeros((2, 3)), np.zeros((6, 3)), np.zeros(4)


@kernel("void(FreeLinks, f8[::1], f8[::1])")
def remove_spin_effects(bodies: FreeLinks, at: Array, effects: Array) -> None:
    """Take the gyroscopic part of the nonlinear effects at the velocity `at` off free bodies; both shapes (nv,)."""
    for body in range(len(bodies.first)):
        first, m, c, A = bodies.first[body], bodies.mass[body], bodies.centre[body], bodies.axes[body]
        J, turning, room = bodies.moments[body], bodies.turning[body], bodies.room
        w, u, line, turn = room[0], room[1], room[4], room[5]
        along(A, at[first : first + 6], turning, w, u)
        add_cross(1.0, w, c, u)
        # about the centre: m w x u and w x J w
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            line[i] = -m * (w[j] * u[k] - w[k] * u[j]) if turning else 0.0
            turn[i] = -(J[k] - J[j]) * w[j] * w[k]
        add_effects(A, c, line, turn, effects[first : first + 6])


@kernel("void(FreeLinks, f8[::1], f8[::1], f8, f8[::1], f8[::1])")
def spin_effects(bodies: FreeLinks, v: Array, at: Array, h: float, torque: Array, effects: Array) -> None:
    """Replace the gyroscopic part of the nonlinear effects of free bodies by its mean over a step; see `spin`.

    Parameters
    ----------
    bodies : FreeLinks
        The bodies.
    v, at : ndarray, shape (nv,)
        Velocity at the start of the step, and that at which the effects were evaluated.
    h : float
        Time step [s].
    torque, effects : ndarray, shape (nv,)
        Torques and nonlinear effects; those of the bodies are overwritten.

    Notes
    -----
    `spin` begins at the velocity that half of the other forces lead to, and the other half follows: together they are
    the implicit midpoint rule with constant forces.
    """
    remove_spin_effects(bodies, at, effects)
    for body in range(len(bodies.first)):
        first, m, c, A = bodies.first[body], bodies.mass[body], bodies.centre[body], bodies.axes[body]
        J, state, turning, room = bodies.moments[body], bodies.state, bodies.turning[body], bodies.room
        w, u, force, moment, line, turn = room[0], room[1], room[2], room[3], room[4], room[5]
        # all along the principal axes: state holds w and u of v
        along(A, v[first : first + 6], turning, state[0], state[1])
        for i in range(3):
            force[i] = moment[i] = 0.0
            for k in range(3):
                moment[i] += A[i, k] * (torque[first + 3 + k] - effects[first + 3 + k])
                if turning:
                    force[i] += A[i, k] * (torque[first + k] - effects[first + k])
        add_cross(1.0, state[0], c, state[1])
        # the other forces, about the centre; half of them act before the body turns
        add_cross(-1.0, c, force, moment)
        for i in range(3):
            state[0, i] += 0.5 * h * moment[i] / J[i]
            state[1, i] += 0.5 * h * force[i] / m
            w[i], u[i] = state[0, i], state[1, i]
        spin(bodies.factors[body], h, state)
        for i in range(3):
            turn[i] = J[i] * (w[i] - state[0, i]) / h
            line[i] = m * (u[i] - state[1, i]) / h if turning else 0.0
        add_effects(A, c, line, turn, effects[first : first + 6])


@kernel("void(f8[:,::1], f8[::1], f8[::1], f8[::1], f8[::1])")
def add_effects(axes: Array, centre: Array, line: Array, turn: Array, effects: Array) -> None:
    """Add a force and a moment about a centre, shapes (3,), along axes, to effects, shape (6,); `turn` is changed."""
    add_cross(1.0, centre, line, turn)
    for i in range(3):
        for k in range(3):
            effects[i] += axes[k, i] * line[k]
            effects[3 + i] += axes[k, i] * turn[k]


@kernel("void(f8[:,::1], f8[::1], b1, f8[::1], f8[::1])")
def along(axes: Array, v: Array, turning: bool, w: Array, u: Array) -> None:
    """Write the components of angular and, if it turns with the body, linear velocity along axes, shapes (3,)."""
    for i in range(3):
        w[i] = axes[i, 0] * v[3] + axes[i, 1] * v[4] + axes[i, 2] * v[5]
        u[i] = axes[i, 0] * v[0] + axes[i, 1] * v[1] + axes[i, 2] * v[2] if turning else 0.0


@kernel("void(f8, f8[::1], f8[::1], f8[::1])")
def add_cross(factor: float, a: Array, b: Array, to: Array) -> None:
    """Add a multiple of a x b, all of shape (3,)."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        to[i] += factor * (a[j] * b[k] - a[k] * b[j])
