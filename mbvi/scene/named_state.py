"""Configurations and velocities of a problem by the names of its robots, joints, bodies and spheres."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ..arguments import Array, array, shown
from ..errors import InputError
from ..system import ArticulatedSystem, located_parts
from .connected.led import lead_joints
from .state import Place, Places

if TYPE_CHECKING:
    from ..problem import Problem

_Named = Mapping[str, Mapping[str, float | Sequence[float] | Array] | Sequence[float] | Array]


def named_state(problem: Problem, places: Places, q: _Named | None, v: _Named | None) -> tuple[Array, Array]:
    """Return the start of a problem with the values that are given by name, shapes (nq,) and (nv,).

    Parameters
    ----------
    problem : Problem
        The problem.
    places : Places
        The places in q and v of what moves.
    q, v : mapping or None
        See `Problem.state`.

    Raises
    ------
    InputError
        See `Problem.state`.
    """
    robots = {
        part.system.name: part.system
        for part in located_parts(problem.system)
        if isinstance(part.system, ArticulatedSystem)
    }
    both = problem.q0.copy(), problem.v0.copy()
    stated = np.zeros(problem.system.nq, bool), np.zeros(problem.system.nv, bool)
    for given, vector, said, what in zip((q, v), both, stated, ("q", "v"), strict=True):
        if given is None:
            continue
        if not isinstance(given, Mapping):
            raise InputError(f"{what} must be a mapping of names to values; got {shown(given)}")
        for name, value in given.items():
            place = places.of(name)
            where = place.q if what == "q" else place.v
            own, marks = vector[where], said[where]
            if isinstance(value, Mapping):
                if name not in robots:
                    raise InputError(f"{what} of {name} must be numbers: it is no robot, and has no joints")
                _write_joints(robots[name], value, own, marks, what)
            else:
                _write_body(place, value, own, f"{what} of {name}", what == "v")
                marks[:] = True
    lead_joints(problem.system, both, stated)
    return both


def _write_joints(system: ArticulatedSystem, values: Mapping[str, Any], own: Array, marks: Array, what: str) -> None:
    """Write values of joints into q or v of their robot, and mark their entries."""
    model = system.model
    for joint, value in values.items():
        joints = list(model.names)[1:]
        if joint not in joints:
            known = ", ".join(joints) or "none"
            raise InputError(f"{system.name} has no joint {shown(joint)}; known are {known}")
        k, label = model.getJointId(joint), f"{what} of {system.name}/{joint}"
        first, width = (model.idx_qs[k], model.nqs[k]) if what == "q" else (model.idx_vs[k], model.nvs[k])
        numbers = array(value, label)
        if what == "q" and numbers.shape == () and (model.nqs[k], model.nvs[k]) == (2, 1):
            # a joint without limits has cosine and sine
            numbers = np.array([np.cos(numbers), np.sin(numbers)])
        if numbers.reshape(-1).shape != (width,):
            raise InputError(f"{label} has {numbers.size} numbers; it must have {width}")
        own[first : first + width], marks[first : first + width] = numbers, True


def _write_body(place: Place, value: Any, own: Array, label: str, velocity: bool) -> None:
    """Write numbers of a robot, body or sphere, or of a group; of bodies the first three numbers alone will do."""
    shape, numbers = place.shape_v if velocity else place.shape_q, array(value, label)
    if velocity and place.lift is not None:
        _write_in_plane(place.lift, numbers, own, shape, label)
        return
    rows = own.reshape(shape)
    part = rows[..., :3] if numbers.shape == (*shape[:-1], 3) else rows
    if numbers.shape != part.shape:
        raise InputError(f"{label} has shape {numbers.shape}; it must have {shape}")
    part[...] = numbers


def _write_in_plane(lift: Array, numbers: Array, own: Array, shape: tuple[int, ...], label: str) -> None:
    """Write the velocities in a scene's plane that bring about those in space."""
    if numbers.shape != shape:
        raise InputError(f"{label} has shape {numbers.shape}; it must have {shape}")
    for matrix, full, part in zip(lift, numbers.reshape(len(lift), -1), own.reshape(len(lift), -1), strict=True):
        part[:] = np.linalg.lstsq(matrix, full, rcond=None)[0]
        if not np.allclose(matrix @ part, full, rtol=0.0, atol=1e-9 * (1.0 + np.abs(full).max())):
            raise InputError(f"{label} leaves the plane of the scene")
