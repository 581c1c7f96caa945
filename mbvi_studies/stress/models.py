"""Models of stress scenes for other engines, and the reasons why some scenes have none."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from mbvi.geometry.shapes.shapes import Box, Sphere
from mbvi.problem import Problem
from mbvi.system.system import Array

from ..engines.bodies import Bodies, Body, NoModelError, Poses, closing, of_scene
from .bodies import BEAD, LEGS
from .scene import StressScene

_X, _Y, _Z = np.eye(3)
_DOWN, _NONE = np.array([0.0, 0.0, -9.81]), np.zeros(3)
_FLOOR = (_Z, 0.0)
# radius of balls that stand for points [m]
_POINT = 0.05


def model_of(scene: StressScene, problem: Problem) -> Bodies:
    """Return the model of a scene for other engines.

    Raises
    ------
    NoModelError
        If the scene has no model; the message gives the reason.
    """
    if problem.scene is not None:
        return of_scene(problem, scene.duration)
    if scene.name in _LEFT_OUT:
        raise NoModelError(_LEFT_OUT[scene.name])
    return _MODELS[scene.name](problem, closing(problem, scene.duration))


def _model(
    problem: Problem, speed: float, bodies: list[Body], planes: list[tuple[Array, float]], gravity: Array,
    state: Callable[[Array, Array], Poses], coordinates: Callable[[Poses], tuple[Array, Array]],
) -> Bodies:  # fmt: skip
    e = problem.constraints.largest_restitution
    return Bodies(tuple(bodies), tuple(planes), gravity, e, state, coordinates, speed)


def _row(
    problem: Problem, speed: float, axis: Array, radius: float, apart: float, planes: list[tuple[Array, float]],
    gravity: Array,
) -> Bodies:  # fmt: skip
    """Return balls of 1 kg on a line; ball k is displaced along it by k times `apart`."""
    count = problem.system.nq
    shift = apart * np.arange(count)
    still, none = np.tile([0.0, 0.0, 0.0, 1.0], (count, 1)), np.zeros((count, 3))
    ball = Body(Sphere(radius), 1.0, np.full(3, 0.4 * radius**2))
    return _model(
        problem, speed, [ball] * count, planes, gravity,
        lambda q, v: Poses(np.outer(q + shift, axis), still, np.outer(v, axis), none),
        lambda s: (s.position @ axis - shift, s.linear @ axis),
    )  # fmt: skip


def _block(problem: Problem, speed: float) -> Bodies:
    """Return a block 1 m wide and 1.5 m high, turning about -y."""

    def state(q: Array, v: Array) -> Poses:
        turn = Rotation.from_rotvec(-q[2] * _Y).as_quat()
        return Poses(np.array([[q[0], 0.0, q[1]]]), turn[None], np.array([[v[0], 0.0, v[1]]]), -v[2:] * _Y[None])

    def coordinates(s: Poses) -> tuple[Array, Array]:
        angle = -Rotation.from_quat(s.quaternion[0]).as_rotvec()[1]
        (x, _, z), (u, _, w) = s.position[0], s.linear[0]
        return np.array([x, z, angle]), np.array([u, w, -s.angular[0, 1]])

    size = (1.0, 0.5, 1.5)
    squares = np.square(size)
    body = Body(Box(size), 1.0, (squares.sum() - squares) / 12)
    return _model(problem, speed, [body], [_FLOOR], _DOWN, state, coordinates)


def _table(problem: Problem, speed: float) -> Bodies:
    """Return a disc on legs that end in balls; the lowest points of these balls are the legs' ends."""

    def state(q: Array, v: Array) -> Poses:
        turn = Rotation.from_rotvec(q[1] * _X + q[2] * _Y).as_quat()
        return Poses(q[:1, None] * _Z, turn[None], v[:1, None] * _Z, (v[1] * _X + v[2] * _Y)[None])

    def coordinates(s: Poses) -> tuple[Array, Array]:
        turn = Rotation.from_quat(s.quaternion[0]).as_rotvec()
        return np.array([s.position[0, 2], *turn[:2]]), np.array([s.linear[0, 2], *s.angular[0, :2]])

    legs = np.column_stack([-LEGS[:, 2], LEGS[:, 1], np.zeros(len(LEGS))])
    body = Body(Sphere(_POINT), 10.0, np.array([2.5, 2.5, 5.0]), legs)
    return _model(problem, speed, [body], [(_Z, -_POINT)], _DOWN, state, coordinates)


def _corner(problem: Problem, speed: float) -> Bodies:
    """Return a ball of 1 kg between two walls, in coordinates whose kinetic metric is Euclidean."""
    # q = lower y
    lower = problem.system.metric(problem.q0).unwhiten(np.eye(2))
    normals = problem.constraints.gradient(problem.t0, problem.q0) @ lower
    # position of the ball's centre when it touches both walls
    shift = np.linalg.solve(normals, np.full(2, _POINT))
    still, none = np.array([[0.0, 0.0, 0.0, 1.0]]), np.zeros((1, 3))

    def state(q: Array, v: Array) -> Poses:
        y, rate = np.linalg.solve(lower, np.column_stack([q, v])).T
        return Poses(np.append(y + shift, 0.0)[None], still, np.append(rate, 0.0)[None], none)

    def coordinates(s: Poses) -> tuple[Array, Array]:
        return lower @ (s.position[0, :2] - shift), lower @ s.linear[0, :2]

    ball = Body(Sphere(_POINT), 1.0, np.full(3, 0.4 * _POINT**2))
    return _model(problem, speed, [ball], [(np.append(n, 0.0), 0.0) for n in normals], _NONE, state, coordinates)


_cradle = partial(_row, axis=_X, radius=0.1, apart=0.2, planes=[], gravity=_NONE)
_MODELS: dict[str, Callable[[Problem, float], Bodies]] = {
    "table on 100 legs": _table,
    "ten beads, e = 0.9": partial(_row, axis=_Z, radius=0.5 * BEAD, apart=0.0, planes=[_FLOOR], gravity=_DOWN),
    "cradle, touching": _cradle,
    "cradle, gaps of 1e-3": _cradle,
    "rocking block": _block,
    "obtuse corner": _corner,
    "a ball for 1e6 steps of 1e-3 s": partial(
        _row, axis=_Z, radius=_POINT, apart=0.0, planes=[(_Z, -_POINT)], gravity=_DOWN
    ),
}
_LEFT_OUT = {
    "near-grazing chaos": "its driven spring is no part of what other engines are given",
    "slider-crank with play": "its linkage was not written for other engines",
    "arm at full stretch": "its linkage was not written for other engines",
    "50 s in a disc": "a wall that is a circle from within is none of their shapes",
}
