"""Reads springs of joints, fixed tendons, and actuators of a MJCF."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ...system.joint_forces import JointForce
from ..reductions import Omission
from .file import disabled, mujoco_module

_FREE, _BALL = range(2)
_OVER_JOINTS = 1
_ALL = (-np.inf, np.inf)
# the last group of actuators that a file can disable
_LAST_GROUP = 30


class MjcfForces(NamedTuple):
    """The springs and actuators of a file.

    Attributes
    ----------
    springs, actuators : list of JointForce
        Those that are modelled.
    omitted : list of Omission
        The others.
    inputs : list of int
        Of each actuator its place among the inputs of the file.
    friction : dict of str to float
        Largest torque or force of dry friction of joints that have some [N m, N].
    """

    springs: list[JointForce]
    actuators: list[JointForce]
    omitted: list[Omission]
    inputs: list[int]
    friction: dict[str, float]


def forces_of(m: Any, joints: Sequence[str]) -> MjcfForces:
    """Return the springs and actuators of an MjModel, given the names of its joints."""
    found = MjcfForces([], [], [], [], {})
    for j, name in enumerate(joints):
        lost = float(m.dof_frictionloss[m.jnt_dofadr[j]])
        if lost and m.jnt_type[j] not in (_FREE, _BALL) and not disabled(m, "FRICTIONLOSS", "CONSTRAINT"):
            found.friction[name] = lost
        stiffness = float(m.jnt_stiffness[j])
        if is_linear_spring(m, j) and not disabled(m, "SPRING"):
            rest = 0.0 if m.jnt_type[j] == _BALL else float(m.qpos_spring[m.jnt_qposadr[j]])
            for unit in np.eye(3 if m.jnt_type[j] == _BALL else 1).tolist():
                bias = (stiffness * rest, -stiffness, 0.0)
                found.springs.append(JointForce(f"spring of {name}", {name: tuple(unit)}, bias))
    for t in range(m.ntendon):
        _add_tendon(m, t, joints, found)
    _add_actuators(m, joints, found)
    return found


def is_linear_spring(m: Any, j: int) -> bool:
    """Return whether a joint has a spring that is modelled."""
    given = [getattr(m, f"jnt_{extra}")[j] for extra in ("stiffnesspoly", "springyield") if hasattr(m, f"jnt_{extra}")]
    return bool(m.jnt_stiffness[j] and m.jnt_type[j] != _FREE and not any(np.any(extra) for extra in given))


def fixed_tendon(m: Any, t: int, joints: Sequence[str]) -> dict[str, tuple[float, ...]]:
    """Return the coefficient of each joint in the length of a fixed tendon; empty if it is another one."""
    found, first = dict[str, tuple[float, ...]](), int(m.tendon_adr[t])
    for k in range(first, first + int(m.tendon_num[t])):
        if m.wrap_type[k] != _OVER_JOINTS:
            return {}
        joint = joints[m.wrap_objid[k]]
        found[joint] = (found.get(joint, (0.0,))[0] + float(m.wrap_prm[k]),)
    return found


def _add_tendon(m: Any, t: int, joints: Sequence[str], found: MjcfForces) -> None:
    """Add the spring and the damper of a fixed tendon."""
    over, name = fixed_tendon(m, t, joints), f"tendon {m.tendon(t).name or t}"
    if not over:
        found.omitted.append(Omission(name, "only fixed tendons are modelled"))
        return
    for extra, what in (
        ("limited", "limits"), ("frictionloss", "dry friction"), ("armature", "armature"),
        ("stiffnesspoly", "spring beyond the linear"), ("dampingpoly", "damping beyond the linear"),
        ("springyield", "yielding spring"),
    ):  # fmt: skip
        if np.any(getattr(m, f"tendon_{extra}", np.zeros(m.ntendon))[t]):
            found.omitted.append(Omission(f"{what} of {name}", "not modelled"))
    stiffness, damping = float(m.tendon_stiffness[t]), float(m.tendon_damping[t])
    low, high = map(float, m.tendon_lengthspring[t])
    if stiffness and not disabled(m, "SPRING"):
        # a spring that is slack between two lengths is one that only pulls and one that only pushes
        ends = [(low, _ALL)] if low == high else [(low, (0.0, np.inf)), (high, (-np.inf, 0.0))]
        for rest, limits in ends:
            bias = (stiffness * rest, -stiffness, 0.0)
            found.springs.append(JointForce(f"spring of {name}", over, bias, limits=limits))
    if damping and not disabled(m, "DAMPER"):
        found.springs.append(JointForce(f"damper of {name}", over, (0.0, 0.0, -damping)))


def _add_actuators(m: Any, joints: Sequence[str], found: MjcfForces) -> None:
    over, taken = [_transmission(m, a, joints) for a in range(len(m.actuator_trntype))], set[str]()
    for a, moment in enumerate(over):
        target = int(m.actuator_trnid[a, 0])
        of_joint = _kind(m, a, "JOINT") or _kind(m, a, "JOINTINPARENT")
        driven = m.tendon(target).name if _kind(m, a, "TENDON") else joints[target] if of_joint else ""
        own = default = m.actuator(a).name or driven or str(a)
        number = 1
        while own in taken:
            number += 1
            own = f"{default}_{number}"
        taken.add(own)
        why = _reason(m, a) or ("" if moment else "only joints and fixed tendons are driven")
        if len(next(iter(moment.values()), ())) > 1 and m.actuator_biastype[a] and m.actuator_biasprm[a, 1]:
            # the error of such a servo is taken modulo a turn
            why = why or "servos of ball joints are not modelled"
        if why:
            found.omitted.append(Omission(f"actuator {own}", why))
            continue
        k, ctrl = int(m.actuator_ctrladr[a]) if hasattr(m, "actuator_ctrladr") else a, _ALL
        if m.actuator_ctrllimited[a] and not disabled(m, "CLAMPCTRL"):
            low, high = map(float, m.actuator_ctrlrange[k])
            ctrl = low, high
        constant, stiffness, damping = map(float, m.actuator_biasprm[a, :3] if m.actuator_biastype[a] else np.zeros(3))
        gain, limits = float(m.actuator_gainprm[a, 0]), _limits(m, a, over, joints, found)
        found.actuators.append(JointForce(own, moment, (constant, stiffness, damping), gain, ctrl, limits))
        found.inputs.append(k)


def _limits(
    m: Any, a: int, over: Sequence[dict[str, tuple[float, ...]]], joints: Sequence[str], found: MjcfForces
) -> tuple[float, float]:
    """Return the limits of an actuator's force, those of what it alone drives among them; name the others."""
    moment, target, limits = over[a], int(m.actuator_trnid[a, 0]), _ALL
    bounds = [(1.0, m.actuator_forcerange[a])] if m.actuator_forcelimited[a] else []
    shared = []
    if _kind(m, a, "TENDON") and m.tendon_actfrclimited[target]:
        beside = [b for b in range(len(over)) if _kind(m, b, "TENDON") and m.actuator_trnid[b, 0] == target]
        # that of a tendon comes before the actuator's
        bounds.insert(0, (1.0, m.tendon_actfrcrange[target]))
        shared += [f"tendon {m.tendon(target).name}"] if len(beside) > 1 else []
    for name in moment:
        j = joints.index(name)
        if m.jnt_actfrclimited[j]:
            alone = len(moment) == sum(name in other for other in over) == 1
            shared += [] if alone else [name]
            bounds += [(moment[name][0], m.jnt_actfrcrange[j])] if alone and moment[name][0] else []
    for factor, given in bounds:
        low, high = sorted(float(bound) / factor for bound in given)
        limits = min(max(limits[0], low), high), min(max(limits[1], low), high)
    for name in shared:
        one = Omission(f"actuatorfrcrange of {name}", "several actuators share it")
        found.omitted.extend([one] if one not in found.omitted else [])
    return limits


def _kind(m: Any, a: int, name: str) -> bool:
    """Return whether an actuator drives a "JOINT", a "TENDON" or something else."""
    return int(m.actuator_trntype[a]) == int(getattr(mujoco_module().mjtTrn, f"mjTRN_{name}"))


def _transmission(m: Any, a: int, joints: Sequence[str]) -> dict[str, tuple[float, ...]]:
    """Return the coefficient of each joint in the length of an actuator; empty if it is not modelled."""
    target, gear = int(m.actuator_trnid[a, 0]), m.actuator_gear[a].tolist()
    if _kind(m, a, "TENDON"):
        return {name: (gear[0] * c,) for name, (c,) in fixed_tendon(m, target, joints).items()}
    if _kind(m, a, "JOINT") or _kind(m, a, "JOINTINPARENT"):
        if m.jnt_type[target] > _BALL:
            return {joints[target]: (gear[0],)}
        if m.jnt_type[target] == _BALL and _kind(m, a, "JOINT"):
            return {joints[target]: tuple(gear[:3])}
    return {}


def _reason(m: Any, a: int) -> str:
    """Return why an actuator is not modelled, whatever it drives; empty if it is."""
    mujoco = mujoco_module()
    biases = [int(mujoco.mjtBias.mjBIAS_NONE), int(mujoco.mjtBias.mjBIAS_AFFINE)]

    def given(*names: str) -> bool:
        return any(np.any(getattr(m, f"actuator_{name}", np.zeros(a + 1))[a]) for name in names)

    group = int(m.actuator_group[a])
    if disabled(m, "ACTUATION") or (0 <= group <= _LAST_GROUP and int(m.opt.disableactuator) >> group & 1):
        return "the file disables it"
    if m.actuator_dyntype[a] != int(mujoco.mjtDyn.mjDYN_NONE) or given("delay"):
        return "its input acts at once in mbvi"
    if m.actuator_gaintype[a] != int(mujoco.mjtGain.mjGAIN_FIXED) or m.actuator_biastype[a] not in biases:
        return "only a fixed gain and an affine bias are modelled"
    if given("damping", "dampingpoly", "armature"):
        return "it has a damping or an armature of its own"
    if getattr(m, "actuator_plugin", np.full(a + 1, -1))[a] >= 0:
        return "plugins are not run"
    return ""
