"""Prescribed motions of walls, such as those of a shaker or a drum.

Pass a motion as `scene.add_...(..., motion=...)`. Any object with `pose(t)` and `twist(t)` is a motion, too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from ..arguments import LARGEST, SMALLEST, Array, finite, returned, shown, vector
from ..errors import InputError

Vector = Sequence[float] | Array
# by how much the length of a unit vector may differ from 1 by rounding
_UNIT = 1e-15


class Motion(Protocol):
    """The displacement of a wall of the world as a function of time."""

    def pose(self, t: float) -> tuple[Array, Array]:
        """Return R, shape (3, 3), and p, shape (3,): the point of the wall placed at x is at R x + p at time t [m]."""
        ...

    def twist(self, t: float) -> tuple[Array, Array]:
        """Return u and w, shapes (3,): the point of the wall that is now at y has velocity u + w x y [m/s, rad/s]."""
        ...


@dataclass(frozen=True)
class Translation:
    """A constant velocity.

    Parameters
    ----------
    velocity : array_like, shape (3,)
        Velocity [m/s].

    Raises
    ------
    InputError
        If it is no vector of three finite numbers.
    """

    velocity: Vector

    def __post_init__(self) -> None:
        object.__setattr__(self, "velocity", _fixed(self.velocity, "velocity"))

    def pose(self, t: float) -> tuple[Array, Array]:
        """Return identity and velocity t."""
        return np.eye(3), _time(t) * np.asarray(self.velocity)

    def twist(self, t: float) -> tuple[Array, Array]:
        """Return the velocity and zero."""
        _time(t)
        return np.asarray(self.velocity), np.zeros(3)


@dataclass(frozen=True)
class Oscillation:
    """A harmonic translation: amplitude sin(2 pi frequency t + phase).

    Parameters
    ----------
    amplitude : array_like, shape (3,)
        Direction and amplitude [m].
    frequency : float
        Frequency [Hz].
    phase : float
        Phase at t = 0 [rad]. Unless sin(phase) is zero, walls are displaced from the start.

    Raises
    ------
    InputError
        On anything that is not finite.
    """

    amplitude: Vector
    frequency: float
    phase: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "amplitude", _fixed(self.amplitude, "amplitude"))
        object.__setattr__(self, "frequency", finite(self.frequency, "frequency"))
        object.__setattr__(self, "phase", finite(self.phase, "phase"))

    def pose(self, t: float) -> tuple[Array, Array]:
        """Return identity and the displacement."""
        return np.eye(3), np.sin(self._angle(t)) * np.asarray(self.amplitude)

    def twist(self, t: float) -> tuple[Array, Array]:
        """Return the velocity and zero."""
        rate = 2.0 * np.pi * self.frequency * np.cos(self._angle(t))
        return rate * np.asarray(self.amplitude), np.zeros(3)

    def _angle(self, t: float) -> float:
        return 2.0 * np.pi * self.frequency * _time(t) + self.phase


@dataclass(frozen=True)
class Rotation:
    """A steady rotation about a fixed axis.

    Parameters
    ----------
    axis : array_like, shape (3,)
        Direction of the axis; its length does not matter.
    rate : float
        Angular velocity about it [rad/s].
    centre : array_like, shape (3,)
        A point of the axis [m].

    Raises
    ------
    InputError
        If the axis is zero, or anything is not finite.
    """

    axis: Vector
    rate: float
    centre: Vector = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        axis = vector(self.axis, "axis")
        length = float(np.linalg.norm(axis))
        if length < SMALLEST:
            raise InputError("the axis of a rotation must not be zero")
        # a unit vector stays as it is, so that a file gives the same one
        object.__setattr__(self, "axis", tuple((axis if abs(length - 1.0) <= _UNIT else axis / length).tolist()))
        object.__setattr__(self, "centre", _fixed(self.centre, "centre"))
        object.__setattr__(self, "rate", finite(self.rate, "rate"))

    def pose(self, t: float) -> tuple[Array, Array]:
        """Return the rotation by rate t, and the position to which it moves the origin."""
        along, across, square = self._about
        angle = self.rate * _time(t)
        turn = np.cos(angle) * square + np.sin(angle) * across + along
        centre = np.asarray(self.centre)
        return turn, centre - turn @ centre

    def twist(self, t: float) -> tuple[Array, Array]:
        """Return the velocity at the origin and the angular velocity."""
        _time(t)
        spin = self.rate * np.asarray(self.axis)
        return np.cross(self.centre, spin), spin

    @cached_property
    def _about(self) -> tuple[Array, Array, Array]:
        """The projection onto the axis, the cross product with it, and the projection across it, shapes (3, 3)."""
        x, y, z = self.axis
        along = np.outer(self.axis, self.axis)
        return along, np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]), np.eye(3) - along


def checked_motion(motion: Motion | None) -> Motion | None:
    """Return a prescribed motion; raise `InputError` if it is none, or if `twist` is not the derivative of `pose`."""
    if motion is None:
        return None
    if isinstance(motion, type) or not (hasattr(motion, "pose") and hasattr(motion, "twist")):
        raise InputError(
            f"motion must be an object such as mbvi.motion.Oscillation((0, 0, 0.01), 5.0), with pose(t) and twist(t); "
            f"got {shown(motion)}"
        )
    h = 1e-6
    (turn, place), (R1, p1), (R0, p0) = (_pair(motion.pose(t), (3, 3)) for t in (0.0, h, -h))
    u, w = _pair(motion.twist(0.0), (3,))
    corners = np.concatenate([np.zeros((1, 3)), np.eye(3)])
    measured = (corners @ (R1 - R0).T + (p1 - p0)) / (2.0 * h)
    expected = u + np.cross(w, corners @ turn.T + place)
    # written so that a NaN is refused too
    if not np.abs(measured - expected).max() <= 1e-3 * (1.0 + np.abs(expected).max()):
        raise InputError("motion: twist(t) is not the velocity of pose(t), or one of them is not finite")
    return motion


def _pair(given: tuple[Array, Array], shape: tuple[int, ...]) -> tuple[Array, Array]:
    """Check and return the two arrays of `pose` or `twist`: the first of a given shape, the second of shape (3,)."""
    if isinstance(given, tuple | list) and len(given) == 2:
        first, second = (returned(part, "motion: pose(t) and twist(t)") for part in given)
        if first.shape == shape and second.shape == (3,):
            return first, second
    raise InputError("motion: pose(t) must return shapes (3, 3) and (3,), twist(t) twice (3,)")


def _time(t: float) -> float:
    # the usual call, once a step, skips the full check
    return t if type(t) is float and -LARGEST <= t <= LARGEST else finite(t, "t")


def _fixed(values: Vector, name: str) -> tuple[float, ...]:
    return tuple(vector(values, name).tolist())
