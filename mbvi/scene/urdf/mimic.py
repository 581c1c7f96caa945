"""Mimic joints of a URDF: joints whose position follows that of another one."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Collection, Mapping
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ...errors import InputError
from ..reductions import Omission

Array = np.ndarray

# how the name of a mimic joint that is not modelled begins
_MIMIC = "mimic of joint "
_FIXED, _ALONE = "the joint is fixed", "the joint moves on its own, and does not follow "
# largest part of a position by which a given one may differ from what it follows
_SAME = 1e-9


class Mimic(NamedTuple):
    """A joint at ratio times the position of another one plus an offset.

    Attributes
    ----------
    joint, leader : str
        The joint, and the one that it follows.
    ratio, offset : float
        Of the positions [rad or m].
    """

    joint: str
    leader: str
    ratio: float
    offset: float


def mimics_of(model: pin.Model, root: ElementTree.Element) -> tuple[tuple[Mimic, ...], list[Omission]]:
    """Return the mimic joints of a URDF, and those that are not modelled, and why."""
    kinds = {joint.get("name", ""): joint.get("type", "") for joint in root.findall("joint")}
    found, left = list[Mimic](), list[Omission]()
    for joint in root.findall("joint"):
        mimic, name = joint.find("mimic"), joint.get("name", "")
        if mimic is None:
            continue
        leader = mimic.get("joint", "")
        one = Mimic(name, leader, float(mimic.get("multiplier", "1")), float(mimic.get("offset", "0")))
        why = _obstacle(model, one, kinds)
        if why:
            left.append(Omission(f"{_MIMIC}{name}", why))
        else:
            found.append(one)
    return tuple(found), left


def _obstacle(model: pin.Model, one: Mimic, kinds: Mapping[str, str]) -> str:
    """Return why a joint cannot follow another one; empty if it can."""
    if not model.existJointName(one.joint):
        return _FIXED
    if one.leader not in kinds or one.leader == one.joint:
        return f"the file has no other joint {one.leader!r} that it could follow"
    sides = [name for name in (one.joint, one.leader) if model.existJointName(name)]
    if any(model.nvs[model.getJointId(name)] != 1 for name in sides):
        return "a joint with several degrees of freedom follows none"
    if one.leader in sides and model.nqs[model.getJointId(one.leader)] == 2 and one.ratio % 1.0:
        return f"{one.leader} turns without limits: {one.ratio:g} times its angle is not unique"
    return ""


def on_their_own(mimics: Collection[Mimic]) -> tuple[Omission, ...]:
    """Return the omissions of mimic joints that a user frees."""
    return tuple(Omission(f"{_MIMIC}{one.joint}", f"{_ALONE}{one.leader}") for one in mimics)


def unfollowed(omitted: Collection[Omission], still: Collection[str]) -> str:
    """Return which joints cannot follow others as their URDF wants, and why, in words; `still` are locked."""
    named = {one.what.removeprefix(_MIMIC): one.why for one in omitted if one.what.startswith(_MIMIC)}
    said = [
        f"{name}: {why}"
        for name, why in named.items()
        if name not in still and why != _FIXED and not why.startswith(_ALONE)
    ]
    return f"joints do not mimic others: {'; '.join(said)}" if said else ""


def followed(
    mimics: Collection[Mimic], model: pin.Model, q: Array, v: Array, given: Collection[str], moving: Collection[str],
    still: Collection[str],
) -> None:  # fmt: skip
    """Write the positions and velocities of mimic joints into those of a robot, shapes (nq,) and (nv,).

    Parameters
    ----------
    mimics, model
        The robot's.
    q, v : ndarray
        Where the other joints are.
    given, moving : collection of str
        Joints whose positions and velocities the user gives.
    still : collection of str
        Locked joints, which follow none.

    Raises
    ------
    InputError
        If a position or velocity that is given is another one than that of the joint it follows.
    """
    left = [one for one in mimics if one.joint not in still]
    names = {one.joint for one in left}
    while left:
        # a joint may follow one that follows another
        ready = [one for one in left if one.leader not in names] or left
        for one in ready:
            _follow(one, model, q, v, one.joint in given, one.joint in moving)
        left = [one for one in left if one not in ready]
        names = {one.joint for one in left}


def _follow(one: Mimic, model: pin.Model, q: Array, v: Array, placed: bool, moved: bool) -> None:
    place, speed = _state(model, one.leader, q, v)
    place, speed = one.ratio * place + one.offset, one.ratio * speed
    now, fast = _state(model, one.joint, q, v)
    for here, there, given, what in ((now, place, placed, "at"), (fast, speed, moved, "with the velocity")):
        if given and abs(here - there) > _SAME * max(1.0, abs(there)):
            raise InputError(
                f"joint {one.joint!r} follows {one.leader!r} and starts {what} {there:.6g}, not {here:.6g}: "
                f"leave it out, or lock it so that it follows none"
            )
    joint = model.getJointId(one.joint)
    k = model.idx_qs[joint]
    q[k : k + model.nqs[joint]] = (place,) if model.nqs[joint] == 1 else (np.cos(place), np.sin(place))
    v[model.idx_vs[joint]] = speed


def _state(model: pin.Model, name: str, q: Array, v: Array) -> tuple[float, float]:
    """Return position and velocity of a joint; zero of a fixed one."""
    if not model.existJointName(name):
        return 0.0, 0.0
    joint = model.getJointId(name)
    return joint_position(model, joint, q), float(v[model.idx_vs[joint]])


def joint_position(model: pin.Model, joint: int, q: Array) -> float:
    """Return the position of a joint with one degree of freedom [rad, m]."""
    k = model.idx_qs[joint]
    return float(q[k] if model.nqs[joint] == 1 else np.arctan2(q[k + 1], q[k]))
