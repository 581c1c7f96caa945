"""The state that a control of the whole scene receives, and the place of each robot and body in q and v."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..arguments import shown
from ..errors import InputError

if TYPE_CHECKING:
    from ..constraints.contact import Contact

Array = np.ndarray


class Place(NamedTuple):
    """The place in q and v of a robot, body or sphere, or of a group of them under one name.

    Attributes
    ----------
    q, v : slice
        Its entries.
    shape_q, shape_v : tuple of int
        The shapes in which a user sees them.
    lift : ndarray, shape (n, 6, 3) or (n, 3, 2), or None
        In a planar scene the velocities in space that each velocity of n bodies or spheres stands for.
    """

    q: slice
    v: slice
    shape_q: tuple[int, ...]
    shape_v: tuple[int, ...]
    lift: Array | None = None

    def configuration(self, q: Array) -> Array:
        """Return its q as a read-only array."""
        own = q[self.q].reshape(self.shape_q)
        own.flags.writeable = False
        return own

    def velocity(self, v: Array) -> Array:
        """Return its v as a read-only array; velocities of bodies and spheres are those in space."""
        own = v[self.v]
        if self.lift is not None:
            own = np.matvec(self.lift, own.reshape(len(self.lift), -1))
        own = own.reshape(self.shape_v)
        own.flags.writeable = False
        return own


class Values(Mapping[str, Array]):
    """q or v of every robot, body and sphere by name, extracted when needed.

    A group is found by its name, and each of its members by its own: "spheres", "spheres[3]".
    """

    __slots__ = ("_places", "_take", "_vector")

    def __init__(self, places: Places, take: Callable[[Place, Array], Array], vector: Array) -> None:
        self._places, self._take, self._vector = places, take, vector

    def __getitem__(self, name: str) -> Array:
        return self._take(self._places.of(name), self._vector)

    def __contains__(self, name: object) -> bool:
        return name in self._places.known or name in self._places.members

    def get(self, name: str, default: Array | None = None) -> Array | None:  # type: ignore[override]
        """Return the values of a thing, or the default if nothing that moves has that name."""
        return self[name] if name in self else default

    def __iter__(self) -> Iterator[str]:
        return iter(self._places.known)

    def __len__(self) -> int:
        return len(self._places.known)

    def __repr__(self) -> str:
        return repr(dict(self))


@dataclass(frozen=True)
class Places:
    """Places of all robots, bodies, spheres and groups by name, and of the members of groups."""

    known: dict[str, Place] = field(default_factory=dict)
    members: dict[str, Place] = field(default_factory=dict)

    def of(self, name: str) -> Place:
        """Return the place of a thing.

        Raises
        ------
        InputError
            If nothing of that name moves.
        """
        place = self.known.get(name) or self.members.get(name)
        if place is None:
            raise InputError(f"no robot, body or sphere {shown(name)} moves in this scene; those that do are {self}")
        return place

    def __str__(self) -> str:
        return ", ".join(self.known) or "none"


@dataclass(frozen=True, slots=True)
class State:
    """The state that a control of the whole scene receives; its arrays are read-only.

    Attributes
    ----------
    t : float
        Time [s].
    q, v : mapping of str to ndarray
        Configuration and velocity of each robot, body and sphere that moves, by name. A robot's are those that its own
        `control(t, q, v)` is given: those of `problem.model(name)`, without locked joints. A rigid body's are its
        centre of mass and quaternion (x, y, z, w), shape (7,) [m], and the velocity of the centre of mass in the world
        with the angular velocity in the body's own axes, shape (6,) [m/s, rad/s]; a sphere's are its centre and its
        velocity, shape (3,), or those of a rigid body where friction turns it. Bodies and spheres of a planar scene
        have the same shapes. A group of n has one row each, and its members are found by their own names, "boxes[2]".
    """

    t: float
    q: Mapping[str, Array]
    v: Mapping[str, Array]
    _contacts: Callable[[], tuple[Contact, ...]] = field(repr=False)

    @property
    def contacts(self) -> tuple[Contact, ...]:
        """Contacts of the last accepted step, those with a percussion; none before the first.

        Under `EventDriven` they are those of the last smooth step or impact. An impact that takes no time has an
        infinite force.
        """
        return self._contacts()
