"""Rigs without joints for engines that read no URDF, and checks of what contact relations exist."""

from __future__ import annotations

from xml.etree import ElementTree

import numpy as np

from mbvi.geometry.shapes.shapes import Box, Sphere

from .bodies import Bodies, Body, NoModelError, Poses
from .rig import Array, Rig, State

_DOWN, _NONE = np.array([0.0, 0.0, -9.81]), np.zeros(0)


def alone(rig: Rig, e: float) -> Bodies:
    """Return the one body of a rig.

    Raises
    ------
    NoModelError
        If the rig has joints or a fixed base.
    """
    if rig.joints or not rig.free:
        raise NoModelError("mechanisms with joints are not written for an engine that reads no URDF")
    (link,) = ElementTree.fromstring(rig.urdf).iter("link")
    ball, box = link.find(".//sphere"), link.find(".//box")
    shape: Sphere | Box
    if ball is not None:
        shape = Sphere(float(ball.attrib["radius"]))
    else:
        assert box is not None
        x, y, z = (float(word) for word in box.attrib["size"].split())
        shape = Box((x, y, z))
    mass, inertia = link.find(".//mass"), link.find(".//inertia")
    assert mass is not None and inertia is not None
    moments = np.array([float(inertia.attrib[k]) for k in ("ixx", "iyy", "izz")])
    body = Body(shape, float(mass.attrib["value"]), moments)

    return Bodies(
        (body,), rig.planes, _DOWN, e, lambda q, v: posed(rig.state(q, v)), lambda s: rig.coordinates(placed(s)),
        rig.closing,
    )  # fmt: skip


def posed(state: State) -> Poses:
    """Return the state of a rig without joints as that of its body."""
    return Poses(*(x[None] for x in (state.position, state.quaternion, state.linear, state.angular)))


def placed(poses: Poses) -> State:
    """Return the state of a body as that of a rig without joints."""
    place, turn, linear, angular = (x[0] for x in poses)
    return State(place, turn, _NONE, linear, angular, _NONE)


def refuse(model: Bodies) -> None:
    """Raise `NoModelError` if bodies can touch in a way for which no relation is written."""
    turning = [body for body in model.bodies if body.turns]
    if turning and (len(model.bodies) > 1 or model.fixed):
        raise NoModelError("bodies that turn have relations with planes only")


def points(body: Body) -> tuple[Array, float]:
    """Return the points of a body that planes can touch, and the radius of balls around them."""
    if isinstance(body.shape, Box):
        return body.shape.vertices, 0.0
    return body.places, body.shape.radius
