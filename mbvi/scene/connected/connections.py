"""The part of a scene that connects bodies and couples joints: equalities that hold through impacts."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

import numpy as np

from ...arguments import between, boolean, finite, function, not_negative, printable, shown, vector
from ...errors import InputError
from ...geometry.shapes.shapes import Array
from ...system.mechanisms.articulated import Control
from ..items import SceneItems
from ..urdf.robot import Robot
from .hinges import fitted_control
from .items import ConnectionItem, CouplingItem

# largest angle of a hinge with limits, so that one beyond them is known [rad]
_WIDEST = 3.1
# most names that an error lists
_MOST_NAMED = 50


class Connections:
    """Methods of `Scene` that connect bodies and couple joints."""

    _items: SceneItems

    def connect(
        self, first: str, second: str, at: Sequence[float] | Array, name: str | None = None, *, active: bool = True
    ) -> str:
        """Let two bodies share a point, as a ball joint does; they no longer collide with each other.

        Parameters
        ----------
        first, second : str
            A rigid body, a sphere, a robot's link "robot/link", or "world". One of both moves. A sphere in a scene
            without friction does not turn: its centre alone can be connected.
        at : array_like, shape (3,)
            The point, in the world, where the scene starts [m].
        name : str, optional
            "connection", then numbered, by default.
        active : bool
            Whether it holds at the start. Else `simulate(switch=)` or `Simulator.switch` switches it on.

        Returns
        -------
        str
            The name.

        Raises
        ------
        InputError
            If a name is unknown, neither moves, one has a prescribed motion, both are the same, or the point is none.

        Notes
        -----
        The equality c(q) = 0 holds at the end of every step to rounding, and through impacts: docs/theory/loops.md.
        """
        place = vector(at, "at")
        return self._add_connection("point", first, second, name, "connection", place, None, active=active)

    def hinge(
        self,
        first: str,
        second: str,
        at: Sequence[float] | Array,
        axis: Sequence[float] | Array,
        name: str | None = None,
        limits: Sequence[float] | Array | None = None,
        *,
        stiffness: float = 0.0,
        rest: float = 0.0,
        damping: float = 0.0,
        friction: float = 0.0,
        control: Control | None = None,
        active: bool = True,
    ) -> str:
        """Let two bodies share a point and an axis through it, about which they turn; the rest as `connect`.

        Angles are those of the second body about the axis, counted from the start, or from where it was switched on,
        within -pi and pi.

        Parameters
        ----------
        axis : array_like, shape (3,)
            Its direction in the world where the scene starts.
        limits : array_like, shape (2,), optional
            Least and largest angle, within -3.1 and 3.1 [rad]. They have the scene's restitution, as limits of joints.
        stiffness, rest : float
            Of a spring: torque per angle [N m/rad], and its angle without torque, within -3.1 and 3.1 [rad]. More than
            half a turn from there it acts the shorter way.
        damping : float
            Torque per angular velocity [N m s/rad].
        friction : float
            Largest torque of dry friction [N m].
        control : callable, optional
            control(t, q, v) -> tau with the angle and its rate, each of shape (1,), as that of a robot with one joint;
            also `ConstantTorque` or `PDControl` [N m].
        """
        direction = vector(axis, "axis")
        length = float(np.linalg.norm(direction))
        if not length > 0.0:
            raise InputError("axis is zero; it must have a direction")
        bounds = None if limits is None else _checked_limits(vector(limits, "limits", 2))
        acting = {
            "stiffness": not_negative(stiffness, "stiffness"),
            "rest": between(rest, "rest", -_WIDEST, _WIDEST),
            "damping": not_negative(damping, "damping"),
            "friction": not_negative(friction, "friction"),
            "control": None if control is None else function(control, "control", "control(t, q, v) -> tau"),
        }
        place, own = vector(at, "at"), direction / length
        return self._add_connection(
            "hinge", first, second, name, "hinge", place, own, limits=bounds, active=active, **acting
        )

    def weld(self, first: str, second: str, name: str | None = None, *, active: bool = True) -> str:
        """Keep two bodies as they are to each other where the scene starts; the rest as `connect`."""
        return self._add_connection("weld", first, second, name, "weld", None, None, active=active)

    def couple(
        self, first: str, second: str, ratio: float = 1.0, offset: float = 0.0, name: str | None = None, *,
        active: bool = True,
    ) -> str:  # fmt: skip
        """Couple two joints: the position of the first is `ratio` times that of the second plus `offset`.

        Parameters
        ----------
        first, second : str
            Joints "robot/joint" with one degree of freedom each, of one robot or of two.
        ratio, offset : float
            Of the positions [rad, m]. Where the second turns without limits, the ratio is a whole number.
        name : str, optional
            "coupling", then numbered, by default.
        active : bool
            Whether it holds at the start. When it is switched on later, it holds the joints as they are then: with an
            offset of its own, as a gear that engages. With the ratio 0 it is a brake.

        Returns
        -------
        str
            The name.

        Raises
        ------
        InputError
            If a joint is unknown or has several degrees of freedom, both are the same, or a number is not finite.
        """
        ratio, offset, active = finite(ratio, "ratio"), finite(offset, "offset"), boolean(active, "active")
        widths = [self._checked_joint(joint) for joint in (first, second)]
        if first == second:
            raise InputError(f"{first} cannot be coupled with itself")
        if widths[1] == 2 and ratio % 1.0:
            raise InputError(f"{second} turns without limits: {ratio:g} times its angle is not unique")
        own = self._items.new_name(name, "coupling")
        self._items.couplings.append(CouplingItem(own, first, second, ratio, offset, active))
        return own

    def _couple_mimics(self, robot: Robot, still: Collection[str]) -> None:
        """Couple the mimic joints of a robot, but those that are locked."""
        own, items = robot.name, self._items
        for one in robot.mimics:
            if one.joint not in still:
                name = items.new_name(None, f"{own}_{one.joint}")
                # a fixed joint stands at zero
                leader = f"{own}/{one.leader}" if robot.model.existJointName(one.leader) else ""
                items.couplings.append(CouplingItem(name, f"{own}/{one.joint}", leader, one.ratio, one.offset))

    def _add_connection(
        self, kind: str, first: str, second: str, name: str | None, default: str, at: Array | None, axis: Array | None,
        *, active: bool, **more: Any,
    ) -> str:  # fmt: skip
        active = boolean(active, "active")
        moves = [self._checked_side(side) for side in (first, second)]
        if first == second or not any(moves):
            why = "is one body" if first == second else "do not move"
            raise InputError(f"{first} and {second} {why}: there is nothing to connect")
        own = self._items.new_name(name, default)
        item = ConnectionItem(own, kind, first, second, at, axis, active=active, **more)
        fitted_control(item)
        self._items.connections.append(item)
        if active:
            self._items.leave_out(first, second, own)
        return own

    def _checked_side(self, body: str) -> bool:
        """Return whether a body that a connection names moves."""
        items = self._items
        known = {"world": False} | {b.name: not b.fixed for b in items.bodies}
        known |= {n: True for s in items.spheres for n in s.names()}
        known |= {link: moves for robot in items.robots for link, moves in robot.links().items()}
        if printable(body, "the name of a body") in known:
            if any(b.name == body and b.motion is not None for b in items.bodies):
                raise InputError(
                    f"{body} has a prescribed motion, which nothing that is connected with it would follow"
                )
            return known[body]
        if any(robot.robot.name == body for robot in items.robots):
            links = [link for link in known if link.startswith(f"{body}/")]
            raise InputError(f"{body} is a robot; name one of its links: {', '.join(links[:_MOST_NAMED])}")
        raise InputError(f"{shown(body)} is no body of this scene; known are {', '.join([*known][:_MOST_NAMED])}")

    def _checked_joint(self, joint: str) -> int:
        """Return how many numbers a joint has in q."""
        robots = {item.robot.name: item.robot.model for item in self._items.robots}
        owner, _, own = printable(joint, "the name of a joint").partition("/")
        model = robots.get(owner)
        names = [] if model is None else [model.names[j] for j in range(1, model.njoints) if model.nvs[j] == 1]
        if model is None or own not in names:
            known = ", ".join(f"{owner}/{name}" for name in names) or f"of the robots {', '.join(robots) or 'none'}"
            raise InputError(f"{shown(joint)} is no joint with one degree of freedom; known are {known}")
        return int(model.nqs[model.getJointId(own)])


def _checked_limits(limits: Array) -> tuple[float, float]:
    lower, upper = map(float, limits)
    if not -_WIDEST <= lower <= 0.0 <= upper <= _WIDEST:
        within = f"-{_WIDEST} and {_WIDEST} rad"
        raise InputError(f"limits must hold the start, angle 0, within {within}; got {lower:g} and {upper:g}")
    return lower, upper
