"""Loads of a scene: external forces and controls of the whole scene as generalised forces."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ...arguments import returned, shown
from ...errors import InputError
from ...geometry.rotations import matrices
from ...system import ArticulatedSystem
from ...system.actuated import Load
from ...system.given import called, not_finite
from ..items import Force, SceneControl
from ..state import Place, Places, State, Values

if TYPE_CHECKING:
    from ...constraints.contact import Contact

Array = np.ndarray

# largest part of a force, due to rounding, that may point out of the plane of a planar scene
_ROUND = 1e-9


def _checked(value: Any, shapes: tuple[tuple[int, ...], ...], what: str, t: float, q: Array, v: Array) -> Array:
    """Return the result of a user's function at (t, q, v) as an array of finite floats with an allowed shape.

    Raises
    ------
    InputError
        If it is no array of numbers, or has another shape; `what` names the function.
    DivergedError
        If it is not finite.
    """
    if type(value) is np.ndarray and value.dtype == np.float64 and value.shape in shapes and np.isfinite(value).all():
        return value
    numbers = returned(value, f"{what} at t = {t:.6g} s")
    if numbers.shape not in shapes:
        expected = " or ".join(map(str, shapes))
        raise InputError(f"{what} at t = {t:.6g} s returned shape {numbers.shape}; {expected} is expected")
    if not np.isfinite(numbers).all():
        raise not_finite(what, numbers, t, q, v)
    return numbers


class SceneControls(Load):
    """The controls of a scene, added up.

    Parameters
    ----------
    functions : sequence of callable
        f(state) -> {robot: tau} or None.
    places : Places
        Where everything stands.
    robots : dict of str to slice
        Where in v each robot stands.
    """

    def __init__(self, functions: tuple[SceneControl, ...], places: Places, robots: dict[str, slice]) -> None:
        self._functions, self._places, self._robots = functions, places, robots
        self._contacts: Callable[[], tuple[Contact, ...]] = tuple

    def __reduce__(self) -> tuple[type, tuple[Any, ...]]:
        return type(self), (self._functions, self._places, self._robots)

    def observe(self, contacts: Callable[[], tuple[Contact, ...]]) -> None:
        """Keep the function that returns the contacts of the last accepted step; it is called once at most."""
        self._contacts = _Once(contacts)

    def add(self, t: float, q: Array, v: Array, total: Array) -> None:
        """Add the torques of all controls; see `Load`."""
        places = self._places
        state = State(t, Values(places, Place.configuration, q), Values(places, Place.velocity, v), self._contacts)
        for function in self._functions:
            found = function(state)
            if found is None:
                continue
            name = f"the control of the scene {called(function)}"
            if not isinstance(found, Mapping):
                raise InputError(
                    f"{name} at t = {t:.6g} s returned {shown(found)}; a dict of torques by robot, or None, is expected"
                )
            for robot, torque in found.items():
                where = self._robots.get(robot) if isinstance(robot, str) else None
                if where is None:
                    known = ", ".join(self._robots) or "none"
                    raise InputError(f"{name} at t = {t:.6g} s returned torques of {shown(robot)}; robots are {known}")
                shape = (where.stop - where.start,)
                total[where] += _checked(torque, (shape,), f"{name}, of {robot},", t, q, v)


class _Once:
    """A function without arguments whose result is computed at the first call and kept."""

    __slots__ = ("_found", "_make")

    def __init__(self, make: Callable[[], tuple[Contact, ...]]) -> None:
        self._make = make
        self._found: tuple[Contact, ...] | None = None

    def __call__(self) -> tuple[Contact, ...]:
        if self._found is None:
            self._found = self._make()
        return self._found


class _Force(Load):
    """An external force on one thing, or one on each of a group.

    Parameters
    ----------
    name : str
        What it acts on.
    function : callable
        f(t, q, v) of that thing's own q and v.
    place : Place
        Where that stands.
    normal : ndarray, shape (3,), or None
        Of the plane that a planar scene moves in.
    length : float
        By which moments are compared with forces [m].
    """

    def __init__(self, name: str, function: Force, place: Place, normal: Array | None, length: float) -> None:
        self._name, self._function, self._place = name, function, place
        self._normal, self._length = normal, length

    def _given(self, t: float, q: Array, v: Array, *shapes: tuple[int, ...]) -> tuple[Array, Array]:
        """Return the forces and moments in the world, shapes (n, 3); a force alone has moments of shape (n, 0)."""
        own = self._place.configuration(q), self._place.velocity(v)
        wrench = _checked(self._function(t, *own), shapes, f"the force on {self._name}", t, *own)
        wrench = wrench.reshape(-1, wrench.shape[-1])
        if self._normal is not None:
            self._check_plane(t, wrench, self._normal)
        return wrench[:, :3], wrench[:, 3:]

    def _what(self, t: float) -> str:
        return f"the force on {self._name} at t = {t:.6g} s"

    def _check_plane(self, t: float, wrench: Array, normal: Array) -> None:
        scaled = wrench / ([1.0] * 3 + [self._length] * (wrench.shape[1] - 3))
        force, moment = scaled[:, :3], scaled[:, 3:]
        out = np.abs(force @ normal).max()
        if moment.size:
            out = max(out, np.abs(moment - np.outer(moment @ normal, normal)).max())
        if out > _ROUND * np.abs(scaled).max():
            raise InputError(
                f"{self._what(t)} leaves the plane of the scene: its force must lie in the plane, and its moment be "
                f"about the plane's normal {np.abs(normal).tolist()}"
            )


class BodyForce(_Force):
    """Forces and moments at the centres of mass of rigid bodies."""

    def add(self, t: float, q: Array, v: Array, total: Array) -> None:
        """See `Load`."""
        place = self._place
        force, moment = self._given(t, q, v, (*place.shape_q[:-1], 6))
        own = np.zeros((len(force), 6))
        own[:, :3] = force
        if moment.any():
            # angular velocities are in the bodies' axes
            own[:, 3:] = np.vecmat(moment, matrices(q[place.q].reshape(-1, 7)[:, 3:]))
        total[place.v] += (own if place.lift is None else np.vecmat(own, place.lift)).ravel()


class SphereForce(_Force):
    """Forces at the centres of spheres, which have no rotation for a moment to change."""

    def add(self, t: float, q: Array, v: Array, total: Array) -> None:
        """See `Load`."""
        place, group = self._place, self._place.shape_q[:-1]
        force, moment = self._given(t, q, v, (*group, 6), (*group, 3))
        if moment.any():
            raise InputError(
                f"{self._what(t)} has a moment, but spheres have no rotation in this model: return the force alone, "
                "shape (3,), or add an ellipsoid of equal radii"
            )
        total[place.v] += (force if place.lift is None else np.vecmat(force, place.lift)).ravel()


class LinkForce(_Force):
    """A force and moment at the centre of mass of a robot's link.

    Parameters
    ----------
    robot : ArticulatedSystem
        The robot; `place` is where it stands.
    joint : int
        The joint that carries the link.
    centre : ndarray, shape (3,)
        Its centre of mass in that joint's frame [m].
    *force
        See `_Force`.
    """

    def __init__(self, robot: ArticulatedSystem, joint: int, centre: Array, *force: Any) -> None:
        super().__init__(*force)
        self._robot, self._joint, self._centre = robot, joint, centre

    def add(self, t: float, q: Array, v: Array, total: Array) -> None:
        """See `Load`."""
        force, moment = self._given(t, q, v, (6,))
        poses, columns, support = self._robot.kinematics(q[self._place.q])
        pose = poses[self._joint]
        point = self._centre @ pose[:3] + pose[3]
        # J' of the link: its columns are those of a point at the origin
        wrench = np.concatenate([force[0], moment[0] + np.cross(point, force[0])])
        total[self._place.v] += support[self._joint] * (columns @ wrench)
