"""Reference motions of mechanisms: a double pendulum at a wall, a rod and a block on a floor, a tumbling box."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..constraints import GapFunction
from ..problem import Problem
from ..scene import Scene
from ..system import LagrangianSystem
from .located import Mechanism, locate
from .solution import Array, Reference, checked

G = 9.81
# longest duration; about twenty simulated seconds cost a second of CPU [s]
_LONGEST = 50.0

_SOURCE = (
    "DOP853 at relative tolerance 1e-13 in small steps, impacts located to rounding by re-taken steps, the law (8) by "
    "enumeration; q within 1e-11 over the default durations (with half the step)"
)


def double_pendulum(e: float, duration: float | None = None) -> Reference:
    """Return a double pendulum (unit masses and lengths) swinging against a vertical wall.

    Parameters
    ----------
    e : float
        Restitution in [0, 1].
    duration : float, optional
        [s]; by default 2.5, or less if impacts accumulate earlier.

    Raises
    ------
    InputError
        If e is outside [0, 1], the duration is not positive, or a given duration contains an accumulation of impacts.

    Notes
    -----
    q holds both angles from the vertical; the tip may not go beyond the wall at x = -0.1. M depends on q.
    """
    e, end = checked(e, 2.5 if duration is None else duration, _LONGEST)

    def mass(q: Array) -> Array:
        c = np.cos(q[0] - q[1])
        return np.array([[2.0, c], [c, 1.0]])

    def force(t: float, q: Array, v: Array) -> Array:
        s = np.sin(q[0] - q[1])
        return np.array([-s * v[1] ** 2 - 2 * G * np.sin(q[0]), s * v[0] ** 2 - G * np.sin(q[1])])

    mechanism = Mechanism(
        mass,
        force,
        gap=lambda q: np.array([np.sin(q).sum() + 0.1]),
        gradient=lambda q: np.cos(q)[None],
        bias=lambda q, v: np.array([-np.sin(q) @ v**2]),
    )

    def potential(q: Array) -> float:
        return float(-G * (2 * np.cos(q[0]) + np.cos(q[1])))

    return _reference(
        "double pendulum", mechanism, potential, [0.6, 0.4], [0.0, 0.0], ("tip | wall",), e, end, duration is None
    )


def rod(e: float, duration: float | None = None) -> Reference:
    """Return a frictionless uniform rod of mass 1 kg and length 1 m falling on a floor.

    Parameters
    ----------
    e : float
        Restitution in [0, 1].
    duration : float, optional
        [s]; by default 0.6, or less if impacts accumulate earlier.

    Raises
    ------
    InputError
        If e is outside [0, 1], the duration is not positive, or a given duration contains an accumulation of impacts.

    Notes
    -----
    q holds the height of the middle and the angle from the horizontal; without friction the rod does not move
    sideways. Each end is a constraint. The ends' gradients are at an obtuse kinetic angle near the horizontal, so that
    condition (12) holds at e = 0: there the rod comes to rest when its second end lands.
    """
    e, end = checked(e, 0.6 if duration is None else duration, _LONGEST)
    half, side = 0.5, np.array([1.0, -1.0])
    mechanism = Mechanism(
        mass=lambda q: np.diag([1.0, half**2 / 3]),
        force=lambda t, q, v: np.array([-G, 0.0]),
        gap=lambda q: q[0] + half * side * np.sin(q[1]),
        gradient=lambda q: np.column_stack([np.ones(2), half * side * np.cos(q[1])]),
        bias=lambda q, v: -half * side * np.sin(q[1]) * v[1] ** 2,
    )
    labels = ("right end | floor", "left end | floor")
    return _reference("rod", mechanism, lambda q: G * q[0], [0.7, 0.35], [0.0, 0.0], labels, e, end, duration is None)


def rocking_block(e: float, duration: float | None = None) -> Reference:
    """Return a frictionless block, 1 m wide and 1.5 m high, falling on a floor and rocking there.

    Parameters
    ----------
    e : float
        Restitution in [0, 1].
    duration : float, optional
        [s]; by default 0.6, or less if impacts accumulate earlier.

    Raises
    ------
    InputError
        If e is outside [0, 1], the duration is not positive, or a given duration contains an accumulation of impacts.

    Notes
    -----
    Siconos' example of this name: m = 1 kg, moment of inertia 3.25 / 12 kg m^2, q = (x, z, theta) = (0, 1, 0.2) at
    rest; the two lower corners are the constraints. At e = 0.5 it strikes at 0.1837515, 0.2962969, 0.4726932,
    0.5185766 and 0.6146458 s.
    """
    e, end = checked(e, 0.6 if duration is None else duration, _LONGEST)
    width, height, side = 0.5, 0.75, np.array([1.0, -1.0])

    def gap(q: Array) -> Array:
        return q[1] - height * np.cos(q[2]) + width * side * np.sin(q[2])

    def gradient(q: Array) -> Array:
        turning = height * np.sin(q[2]) + width * side * np.cos(q[2])
        return np.column_stack([np.zeros(2), np.ones(2), turning])

    mechanism = Mechanism(
        mass=lambda q: np.diag([1.0, 1.0, 3.25 / 12]),
        force=lambda t, q, v: np.array([0.0, -G, 0.0]),
        gap=gap,
        gradient=gradient,
        bias=lambda q, v: (height * np.cos(q[2]) - width * side * np.sin(q[2])) * v[2] ** 2,
    )
    labels = ("right corner | floor", "left corner | floor")
    return _reference(
        "rocking block", mechanism, lambda q: G * q[1], [0, 1, 0.2], [0, 0, 0], labels, e, end, duration is None
    )


def tumbling_body(e: float, duration: float | None = None) -> Reference:
    """Return a box with three unequal moments of inertia tumbling onto a floor, built by `Scene`.

    Parameters
    ----------
    e : float
        Restitution in [0, 1].
    duration : float, optional
        [s]; by default 0.45, or less if impacts accumulate earlier.

    Raises
    ------
    InputError
        If e is outside [0, 1], the duration is not positive, or a given duration contains an accumulation of impacts.

    Notes
    -----
    q holds the centre and the quaternion (x, y, z, w), v the velocity of the centre in the world and the angular
    velocity in the body's axes. Its eight vertices are the constraints.
    """
    e, end = checked(e, 0.45 if duration is None else duration, _LONGEST)
    size, centre, speed, spin = np.array([0.3, 0.5, 0.7]), (0.0, 0.0, 0.54), (0.3, 0.1, 0.0), (1.2, 3.0, 2.4)
    scene = Scene(gravity=(0, 0, -G), restitution=e)
    scene.add_halfspace((0, 0, 1), name="floor")
    # the initial rotation is the identity, so world axes and body axes agree
    scene.add_box(tuple(size), mass=2.0, position=centre, velocity=speed, angular_velocity=spin, name="box")
    problem = scene.build()
    found = locate(_free_box(size, 2.0), problem.q0, problem.v0, e, end, duration is None)
    return Reference("tumbling body", problem, found.end, found.at, found.impacts, _SOURCE, found.releases)


def _free_box(size: Array, mass: float) -> Mechanism:
    """Return a free homogeneous box above the plane z = 0."""
    inertia = mass / 12 * (size @ size - size**2)
    vertices = 0.5 * size * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    M = np.diag([mass] * 3 + inertia.tolist())

    def up(q: Array) -> Array:
        x, y, z, w = q[3:]
        return np.array([2 * (x * z - y * w), 2 * (y * z + x * w), w * w + z * z - x * x - y * y])

    def rate(q: Array, v: Array) -> Array:
        u, s, spin = q[3:6], q[6], v[3:]
        return np.concatenate([v[:3], 0.5 * (s * spin + _cross(u, spin)), [-0.5 * (u @ spin)]])

    def normalise(q: Array) -> Array:
        turn = q[..., 3:]
        return np.concatenate([q[..., :3], turn / np.linalg.norm(turn, axis=-1, keepdims=True)], axis=-1)

    def gradient(q: Array) -> Array:
        rows = np.zeros((8, 6))
        rows[:, 2], rows[:, 3:] = 1.0, np.cross(vertices, up(q))
        return rows

    def bias(q: Array, v: Array) -> Array:
        # the vertical, in body axes, rotates against the body
        return np.cross(vertices, _cross(up(q), v[3:])) @ v[3:]

    return Mechanism(
        mass=lambda q: M,
        force=lambda t, q, v: np.concatenate([[0, 0, -mass * G], _cross(inertia * v[3:], v[3:])]),
        gap=lambda q: q[2] + vertices @ up(q),
        gradient=gradient,
        bias=bias,
        rate=rate,
        normalise=normalise,
    )


def _cross(a: Array, b: Array) -> Array:
    """Return the vector product; np.cross is ten times slower for a single pair."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def _reference(
    name: str,
    mechanism: Mechanism,
    potential: Callable[[Array], float],
    q0: list[float],
    v0: list[float],
    labels: tuple[str, ...],
    e: float,
    duration: float,
    shorten: bool,
) -> Reference:
    """Return the located motion of a mechanism in R^d."""

    def constraint(k: int) -> GapFunction:
        return GapFunction(lambda q: mechanism.gap(q)[k], lambda q: mechanism.gradient(q)[k], name=labels[k])

    system = LagrangianSystem(mechanism.mass, mechanism.force, len(q0), potential)
    problem = Problem(system, [constraint(k) for k in range(len(labels))], q0, v0, restitution=e)
    found = locate(mechanism, problem.q0, problem.v0, e, duration, shorten)
    return Reference(name, problem, found.end, found.at, found.impacts, _SOURCE, found.releases)
