"""Prescribed motions of walls: how a shaker or a drum moves, whatever pushes on it.

An own one is an object with `pose(t)` and `twist(t)`; `scene.add_...(..., motion=...)` takes it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from .errors import InputError

Array = np.ndarray
Vector = Sequence[float] | Array


class Motion(Protocol):
    """How what stands in the world is displaced over time."""

    def pose(self, t: float) -> tuple[Array, Array]:
        """Return rotation, shape (3, 3), and position, shape (3,): what stands at x is at rotation x + position [m]."""
        ...

    def twist(self, t: float) -> tuple[Array, Array]:
        """Return u and w, shapes (3,): what is at x moves with u + w x x, in the world [m/s, rad/s]."""
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
        object.__setattr__(self, "velocity", _vector(self.velocity, "velocity"))

    def pose(self, t: float) -> tuple[Array, Array]:
        """Return identity and velocity t."""
        return np.eye(3), t * np.asarray(self.velocity)

    def twist(self, t: float) -> tuple[Array, Array]:
        """Return the velocity and zero."""
        return np.asarray(self.velocity), np.zeros(3)


@dataclass(frozen=True)
class Oscillation:
    """A harmonic translation: amplitude sin(2 pi frequency t + phase).

    Parameters
    ----------
    amplitude : array_like, shape (3,)
        Along which way and how far [m].
    frequency : float
        Oscillations a second [Hz].
    phase : float
        Phase at t = 0 [rad]: unless it is zero, walls are displaced there already.

    Raises
    ------
    InputError
        On anything that is not finite.
    """

    amplitude: Vector
    frequency: float
    phase: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "amplitude", _vector(self.amplitude, "amplitude"))
        _finite(self.frequency, "frequency")
        _finite(self.phase, "phase")

    def pose(self, t: float) -> tuple[Array, Array]:
        """Return identity and the displacement."""
        return np.eye(3), np.sin(self._angle(t)) * np.asarray(self.amplitude)

    def twist(self, t: float) -> tuple[Array, Array]:
        """Return the velocity and zero."""
        rate = 2.0 * np.pi * self.frequency * np.cos(self._angle(t))
        return rate * np.asarray(self.amplitude), np.zeros(3)

    def _angle(self, t: float) -> float:
        return 2.0 * np.pi * self.frequency * t + self.phase


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
        axis = np.array(_vector(self.axis, "axis"))
        if not axis.any():
            raise InputError("the axis of a rotation must not be zero")
        object.__setattr__(self, "axis", tuple((axis / np.linalg.norm(axis)).tolist()))
        object.__setattr__(self, "centre", _vector(self.centre, "centre"))
        _finite(self.rate, "rate")

    def pose(self, t: float) -> tuple[Array, Array]:
        """Return the rotation so far, and where it takes the origin."""
        along, across, square = self._about
        angle = self.rate * t
        turn = np.cos(angle) * square + np.sin(angle) * across + along
        centre = np.asarray(self.centre)
        return turn, centre - turn @ centre

    def twist(self, t: float) -> tuple[Array, Array]:
        """Return the velocity at the origin and the angular velocity."""
        spin = self.rate * np.asarray(self.axis)
        return np.cross(self.centre, spin), spin

    @cached_property
    def _about(self) -> tuple[Array, Array, Array]:
        """The projection onto the axis, the cross product with it, and the projection across it, shapes (3, 3)."""
        x, y, z = self.axis
        along = np.outer(self.axis, self.axis)
        return along, np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]), np.eye(3) - along


def checked_motion(motion: Motion | None) -> Motion | None:
    """Return a prescribed motion, or raise `InputError` where it is none or does not fit itself."""
    if motion is None:
        return None
    if isinstance(motion, type) or not (hasattr(motion, "pose") and hasattr(motion, "twist")):
        raise InputError(
            f"motion must be an object such as mbvi.motion.Oscillation((0, 0, 0.01), 5.0), with pose(t) and twist(t); "
            f"got {motion!r}"
        )
    turn, place = motion.pose(0.0)
    u, w = motion.twist(0.0)
    if np.shape(turn) != (3, 3) or any(np.shape(part) != (3,) for part in (place, u, w)):
        raise InputError("motion: pose(t) must return shapes (3, 3) and (3,), twist(t) twice (3,)")
    h = 1e-6
    (R1, p1), (R0, p0) = motion.pose(h), motion.pose(-h)
    corners = np.concatenate([np.zeros((1, 3)), np.eye(3)])
    measured = (corners @ (R1 - R0).T + (p1 - p0)) / (2.0 * h)
    told = u + np.cross(w, corners @ turn.T + place)
    # written so that a NaN is refused too
    if not np.abs(measured - told).max() <= 1e-3 * (1.0 + np.abs(told).max()):
        raise InputError("motion: twist(t) is not the velocity of pose(t), or one of them is not finite")
    return motion


def _vector(values: Vector, name: str) -> tuple[float, ...]:
    try:
        vector = np.array(values, dtype=float)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} is no array of three numbers: {values!r}") from error
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise InputError(f"{name} must be three finite numbers; got {values!r}")
    return tuple(vector.tolist())


def _finite(value: float, name: str) -> None:
    if not (isinstance(value, (int, float, np.number)) and np.isfinite(value)):
        raise InputError(f"{name} must be a finite number; got {value!r}")
