"""Values of controls by the names of joints, in the order of a robot's velocities."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pinocchio as pin

from ...arguments import shown
from ...errors import InputError
from ..control_table import ControlTable
from ..joint_forces import no_forces
from ..system import Array


def in_order(given: Any, what: str, joints: Sequence[str] | None, missing: float | None = None) -> Any:
    """Return values by name as an array in the order of some joints, shape (n,) or (k, n); other values as they are.

    Parameters
    ----------
    given : mapping of str to float or ndarray of shape (k,), or anything else
        The values.
    what : str
        What they are called in errors.
    joints : sequence of str or None
        The joints that may be named.
    missing : float, optional
        The value of joints that are not; by default all must be.

    Raises
    ------
    InputError
        If another joint is named, or one that must be is not, or lengths differ.
    """
    if not isinstance(given, Mapping):
        return given
    if joints is None:
        raise InputError(f"{what} gives values by joint, and q does not: give q by joint, too")
    unknown = [one for one in given if one not in joints]
    absent = [one for one in joints if one not in given] if missing is None else []
    if unknown or absent:
        which = ", ".join(map(str, unknown or absent))
        raise InputError(f"{what} {'names' if unknown else 'lacks'} {which}; q names {', '.join(joints)}")
    try:
        columns = [np.asarray(given.get(joint, missing), dtype=float) for joint in joints]
        return np.stack(np.broadcast_arrays(*columns), axis=-1)
    except (ValueError, TypeError) as error:
        raise InputError(f"{what} must give numbers, as many for each joint; got {shown(given)}") from error


def expanded(
    table: ControlTable, model: pin.Model, joints: Sequence[str] | None, effort_limits: bool, name: str
) -> ControlTable:
    """Return the table of a control of some joints as that of the robot's last velocities, from the first of them on.

    Parameters
    ----------
    table : ControlTable
        With one column for each joint.
    model : pinocchio.Model
        The robot.
    joints : sequence of str or None
        The joints; None for the last ones.
    effort_limits : bool
        Whether torques are limited by what the robot's file says.
    name : str
        Of the robot.

    Raises
    ------
    InputError
        If the robot has no such joint with one degree of freedom, or no effort limit of one.
    """
    n = table.torque.shape[1]
    if n > model.nv:
        raise InputError(f"the control of {name} acts on {n} velocities; it has {model.nv}")
    rates = np.arange(model.nv - n, model.nv)
    if joints is not None:
        rates = np.array([_rate_of(model, joint, name) for joint in joints], dtype=np.int64)
    first = int(rates.min()) if n else model.nv
    here, width = rates - first, model.nv - first
    columns = {key: np.zeros((len(table.times), width)) for key in ("torque", "q", "v")}
    gains = {"stiffness": np.zeros(width), "damping": np.zeros(width), "limit": np.full(width, np.inf)}
    values: dict[str, Any] = columns | gains
    for key, full in values.items():
        full[..., here] = getattr(table, key)
    if effort_limits:
        values["limit"][here] = _efforts(model, rates, name)
    return table._replace(
        position=positions(model)[first:], actuators=no_forces(width), springs=no_forces(width), **values
    )


def _rate_of(model: pin.Model, joint: str, name: str) -> int:
    """Return the place in v of a joint with one degree of freedom."""
    if not model.existJointName(joint) or model.nvs[model.getJointId(joint)] != 1:
        known = ", ".join(one for one, nv in zip(model.names, model.nvs, strict=True) if nv == 1)
        raise InputError(
            f"the control of {name} names {shown(joint)}; its joints with one degree of freedom are {known or 'none'}"
        )
    return int(model.idx_vs[model.getJointId(joint)])


def _efforts(model: pin.Model, rates: Array, name: str) -> Array:
    """Return the effort limits of the file of some velocities."""
    limits = np.array(model.effortLimit)[rates]
    for k in np.flatnonzero(~((limits > 0.0) & (limits < 1e100))):
        places = zip(model.names, model.idx_vs, model.nvs, strict=True)
        joint = next(one for one, first, nv in places if nv and first <= rates[k] < first + nv)
        raise InputError(f"the file of {name} has no effort limit of {joint} above 0: give limits by name")
    return limits


def positions(model: pin.Model) -> Array:
    """Return for each velocity where in q its position is, counted from the end; 1 where it is not one coordinate."""
    found = np.ones(model.nv, np.int64)
    for nq, nv, at_q, at_v in zip(model.nqs, model.nvs, model.idx_qs, model.idx_vs, strict=True):
        if nq == nv == 1:
            found[at_v] = model.nq - at_q
    return found
