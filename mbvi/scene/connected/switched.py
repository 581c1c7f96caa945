"""Problems whose connections change at a state: bodies are attached to each other and released."""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ...arguments import printable, shown
from ...errors import InputError
from ...geometry.shapes.shapes import Array
from ...system import ArticulatedSystem, located_parts, parts_of
from ..assembly import assemble
from ..blocks import blocks_of
from ..items import SceneItems
from ..model import SceneModel
from .connections import Connections
from .equalities import frames_as_they_are, frames_by_name, joints_of, offset_as_it_is, sides_at
from .items import ConnectionItem

if TYPE_CHECKING:
    from ...problem import Problem


class _Connected(Connections):
    """The connections of a scene that is built already."""

    def __init__(self, items: SceneItems) -> None:
        self._items = items


def attached(
    problem: Problem, q: Array, first: str, second: str, at: Sequence[float] | Array | None = None,
    axis: Sequence[float] | Array | None = None, name: str | None = None,
) -> tuple[Problem, str]:  # fmt: skip
    """Return the problem at q with one more connection as the bodies are there, and its name.

    Parameters
    ----------
    problem : Problem
        That of a scene.
    q : ndarray, shape (nq,)
        The configuration.
    first, second : str
        See `Scene.connect`.
    at, axis : array_like, shape (3,), optional
        Without them both bodies are welded; with `at` they share a point, with both they are a hinge.
    name : str, optional
        See `Scene.connect`.

    Raises
    ------
    InputError
        As `Scene.weld`, `connect` and `hinge`, or if the problem has no scene.
    """
    model, items = _own_items(problem, "attach")
    made = _Connected(items)
    if at is None and axis is not None:
        raise InputError("axis is that of a hinge, which needs a point of it too: at")
    if at is None:
        own = made.weld(first, second, name)
    else:
        own = made.connect(first, second, at, name) if axis is None else made.hinge(first, second, at, axis, name)
    items.connections[-1] = _as_at(model, items, q)
    return _built(problem, model, items, q), own


def released(problem: Problem, q: Array, name: str) -> Problem:
    """Return the problem at q without the connection of a name.

    Raises
    ------
    InputError
        If there is none of that name, or the problem has no scene.
    """
    model, items = _own_items(problem, "detach")
    known = [item.name for item in items.connections]
    if printable(name, "the name of a connection") not in known:
        raise InputError(f"{shown(name)} is no connection; known are {', '.join(known) or 'none'}")
    del items.connections[known.index(name)]
    _let_meet(items, name)
    return _built(problem, model, items, q)


def switched(problem: Problem, t: float, q: Array, connections: Mapping[str, bool]) -> Problem:
    """Return the problem at (t, q) with connections of its scene switched on, as bodies and joints are there, or off.

    Raises
    ------
    InputError
        If there is none of a name, or the problem has no scene.
    """
    model, items = _own_items(problem, "switch")
    known, bodies = items.switchable, {item.name: k for k, item in enumerate(items.connections)}
    joints = {item.name: k for k, item in enumerate(items.couplings)}
    blocks = blocks_of(items, model.reduce)
    start, now = (
        sides_at(items, blocks.system, blocks.frames, blocks.shapes, place) for place in (np.concatenate(blocks.q0), q)
    )
    for name, on in connections.items():
        if printable(name, "the name of a connection") not in known:
            raise InputError(f"{shown(name)} is no connection of the scene; known are {', '.join(known) or 'none'}")
        if on == known[name]:
            continue
        if name in joints:
            coupling = items.couplings[joints[name]]
            if on:
                places = joints_of(items, located_parts(blocks.system))
                coupling = replace(coupling, offset=offset_as_it_is(coupling, places, q))
            items.couplings[joints[name]] = replace(coupling, active=on)
            continue
        item = items.connections[bodies[name]]
        if on:
            sides = [(one[item.first], one[item.second]) for one in (start, now)]
            item = replace(item, at=None, axis=None, frames=frames_as_they_are(item, *sides))
            items.leave_out(item.first, item.second, name)
        else:
            _let_meet(items, name)
        items.connections[bodies[name]] = replace(item, active=on)
    return _built(problem, model, items, q, t)


def connected(problem: Problem, t: float, q: Array, v: Array, *, attached: bool) -> Problem:
    """Return a problem with other connections at (t, q), with the nearest velocity to v that they allow.

    Where none is `attached`, no velocity changes.
    """
    return problem.at(q, problem.system.tangent(q, v) if attached else v, t)


def _own_items(problem: Problem, what: str) -> tuple[SceneModel, SceneItems]:
    """Return the scene of a problem, and its items, of which connections can be changed."""
    model = problem.scene
    if not isinstance(model, SceneModel):
        raise InputError(f"{what} needs bodies with names: build the problem from a Scene")
    items = copy.copy(model.items)
    items.connections, items.couplings = list(items.connections), list(items.couplings)
    items.excluded = set(items.excluded)
    items.left_out = dict(items.left_out)
    return model, items


def _let_meet(items: SceneItems, name: str) -> None:
    """Let shapes collide again that a connection has left out."""
    others = set().union(*(pairs for other, pairs in items.left_out.items() if other != name))
    items.excluded -= items.left_out.pop(name, set()) - others


def _as_at(model: SceneModel, items: SceneItems, q: Array) -> ConnectionItem:
    """Return the last connection with the frames that it has where the bodies are at q."""
    # the model has the frames of those links only that were connected before
    blocks, item = blocks_of(items, model.reduce), items.connections[-1]
    sides = sides_at(items, blocks.system, blocks.frames, blocks.shapes, q)
    frames = frames_by_name(item, sides[item.first], sides[item.second])
    return replace(item, at=None, axis=None, frames=frames)


def _built(problem: Problem, model: SceneModel, items: SceneItems, q: Array, t: float = 0.0) -> Problem:
    """Return the problem of some items at (t, q), with the controls that act in another one."""
    new = assemble(items, model.reduce, at=q.copy(), t0=t)
    for before, part in zip(parts_of(problem.system), parts_of(new.system), strict=True):
        if isinstance(before, ArticulatedSystem) and isinstance(part, ArticulatedSystem):
            # the same object: its inputs stay as they are, and the problem's own `ctrl` goes on setting them
            part.set_control(before.control)
    new.not_kept = problem.not_kept
    return new
