"""Moves coupled joints with those that they follow, in states that are given by name."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...arguments import Array
from ...errors import InputError
from ...system import System, located_parts
from ...system.mechanisms.equalities import CoupledJoints, joint_value

# largest part of a value by which a given one may differ from what it follows
_SAME = 1e-9


def lead_joints(system: System, state: tuple[Array, Array], stated: tuple[Array, Array]) -> None:
    """Write positions and velocities of the joints that follow others whose values are given.

    Parameters
    ----------
    system : System
        The system with its couplings.
    state : (ndarray, ndarray)
        q and v, shapes (nq,) and (nv,).
    stated : (ndarray of bool, ndarray of bool)
        Which of their entries are given.

    Raises
    ------
    InputError
        If a value that is given is another one than that of the joint it follows.
    """
    (q, v), (placed, moved), left = state, stated, list(_couplings(system))
    while left:
        # a joint may follow one that follows another
        followers = {one.first[0] for one in left}
        ready = [one for one in left if one.second[0] not in followers] or left
        for one in ready:
            (i, k, width), (j, m, others) = one.first, one.second
            if placed[i] or (others and placed[j]):
                place = one.offset + (one.ratio * joint_value(q, j, others) if others else 0.0)
                if placed[i]:
                    _check(system, one, joint_value(q, i, width), place, "at", width == 2 or others == 2)
                q[i : i + width] = (place,) if width == 1 else (np.cos(place), np.sin(place))
                placed[i] = True
            if moved[k] or (others and moved[m]):
                speed = one.ratio * v[m] if others else 0.0
                if moved[k]:
                    _check(system, one, v[k], speed, "with the velocity", False)
                v[k], moved[k] = speed, True
        left = [one for one in left if one not in ready]


def _couplings(system: System) -> Iterator[CoupledJoints]:
    """Yield the couplings of a system and of its parts, numbered as its q and v are."""
    for part in located_parts(system):
        for one in part.system.equalities:
            if isinstance(one, CoupledJoints):
                yield one.moved_to(part.q, part.v, 0)
    if system.whole is not None:
        yield from (one for one in system.equalities if isinstance(one, CoupledJoints))


def _check(system: System, one: CoupledJoints, given: float, wanted: float, what: str, turns: bool) -> None:
    apart = given - wanted
    if turns:
        # an angle of cosine and sine has no number of turns
        apart -= 2.0 * np.pi * np.round(apart / (2.0 * np.pi))
    if abs(apart) > _SAME * max(1.0, abs(wanted)):
        follower, leader = (_name(system, side[0]) for side in (one.first, one.second))
        raise InputError(
            f"joint {follower!r} follows {leader!r} and is {what} {wanted:.6g}, not {given:.6g}: leave it out"
            if one.second[2]
            else f"joint {follower!r} is held by {one.name} {what} {wanted:.6g}, not {given:.6g}: leave it out"
        )


def _name(system: System, place: int) -> str:
    """Return the name of the joint whose coordinates begin at a place in q; empty if there is none."""
    for part in located_parts(system):
        model = part.system.model
        if model is not None:
            for joint in range(1, model.njoints):
                if part.q + model.idx_qs[joint] == place:
                    return f"{part.system.name}/{model.names[joint]}"
    return ""
