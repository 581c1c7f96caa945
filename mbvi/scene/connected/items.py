"""Checked data of the connections and couplings of a scene."""

from __future__ import annotations

from dataclasses import dataclass

from ...geometry.shapes.shapes import Array
from ...system.mechanisms.articulated import Control


@dataclass(frozen=True)
class ConnectionItem:
    """Two bodies or links that keep a point, an axis or their relative pose in common.

    Attributes
    ----------
    name : str
        Its name.
    kind : "point", "hinge" or "weld"
        What they have in common.
    first, second : str
        Both: bodies, spheres, links "robot/link", or "world".
    at, axis : ndarray, shape (3,), or None
        The point, and the direction of a hinge, in the world at the start [m].
    frames : (ndarray, ndarray) or None
        Of what a file describes the frame of the connection in each side's own frame, shape (4, 3): the columns of its
        rotation, then its origin [m]. A hinge turns about its third axis. Such a connection may be open at the start.
    limits : (float, float) or None
        Of a hinge: the least and the largest angle of the second body about the axis, zero at the start [rad].
    stiffness, rest, damping, friction, control
        Of a hinge; see `Hinges`.
    active : bool
        Whether it holds; else it is switched off.
    """

    name: str
    kind: str
    first: str
    second: str
    at: Array | None = None
    axis: Array | None = None
    frames: tuple[Array, Array] | None = None
    limits: tuple[float, float] | None = None
    stiffness: float = 0.0
    rest: float = 0.0
    damping: float = 0.0
    friction: float = 0.0
    control: Control | None = None
    active: bool = True

    @property
    def acts(self) -> bool:
        """Whether a torque acts about it where it holds, beside that of limits."""
        return self.stiffness > 0.0 or self.damping > 0.0 or self.friction > 0.0 or self.control is not None


@dataclass(frozen=True)
class CouplingItem:
    """A joint at ratio times the position of another plus an offset; both are named "robot/joint".

    Without a second one, "", the joint is held at the offset. One that is not active is switched off.
    """

    name: str
    first: str
    second: str
    ratio: float
    offset: float
    active: bool = True

    def __str__(self) -> str:
        """Return the equation, such as "belt: a/turn = 2 b/turn + 0.1"."""
        follows = f"{self.ratio:g} {self.second} + " if self.second else ""
        return f"{self.name}: {self.first} = {follows}{self.offset:g}{'' if self.active else ', switched off'}"
