"""Reads the equality constraints of a MJCF: connections, welds and coupled joints."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from ...arguments import made_label
from ...geometry.shapes.shapes import Array
from ..connected.items import ConnectionItem, CouplingItem
from ..reductions import Omission
from .file import disabled, mujoco_module, placement
from .joint_forces import fixed_tendon

_CONNECT, _WELD, _JOINT, _TENDON = range(4)


class MjcfEqualities(NamedTuple):
    """The equality constraints of a file.

    Attributes
    ----------
    connections, couplings : list of ConnectionItem and list of CouplingItem
        Those that are modelled.
    omitted : list of Omission
        The others.
    """

    connections: list[ConnectionItem]
    couplings: list[CouplingItem]
    omitted: list[Omission]


def equalities_of(m: Any, pose: pin.SE3, own: str, bodies: Sequence[str], joints: Sequence[str]) -> MjcfEqualities:
    """Return the equality constraints of an MjModel.

    Parameters
    ----------
    m : MjModel
        The model.
    pose : pinocchio.SE3
        Where the frame of the file stands in the world.
    own : str
        Name of all that moves in the scene.
    bodies, joints : sequence of str
        Names of the bodies and of the joints.
    """
    found = MjcfEqualities([], [], [])
    if disabled(m, "EQUALITY", "CONSTRAINT"):
        return found
    for k in range(m.neq):
        kind, name = int(m.eq_type[k]), m.equality(k).name or f"equality{k}"
        label = made_label(f"{own}_{name}")
        if kind in (_CONNECT, _WELD) and len({m.body_weldid[body] for body in _bodies(m, k)}) == 1:
            found.omitted.append(Omission(f"equality constraint {name}", "its bodies do not move against each other"))
        elif kind in (_CONNECT, _WELD):
            found.connections.append(_connection(m, k, pose, own, bodies, label))
        elif kind == _JOINT and not np.any(m.eq_data[k, 2:5]) and _is_simple(m, k):
            found.couplings.append(_coupling(m, k, own, joints, label))
        elif kind == _TENDON and (coupling := _tendon_coupling(m, k, own, joints, label)) is not None:
            found.couplings.append(coupling)
        else:
            why = "only points, welds, and joints and fixed tendons in proportion are modelled"
            found.omitted.append(Omission(f"equality constraint {name}", why))
    return found


def _of_sites(m: Any, k: int) -> bool:
    """Return whether an equality connects sites, and not bodies."""
    return int(m.eq_objtype[k]) == int(mujoco_module().mjtObj.mjOBJ_SITE)


def _bodies(m: Any, k: int) -> list[int]:
    """Return the two bodies of a connection or weld."""
    sides = int(m.eq_obj1id[k]), int(m.eq_obj2id[k])
    return [int(m.site_bodyid[side]) if _of_sites(m, k) else side for side in sides]


def _connection(m: Any, k: int, pose: pin.SE3, own: str, bodies: Sequence[str], label: str) -> ConnectionItem:
    data, kind, sides, places = m.eq_data[k], int(m.eq_type[k]), list[str](), list[Array]()
    for number, body in enumerate(_bodies(m, k)):
        if _of_sites(m, k):
            side = int((m.eq_obj1id, m.eq_obj2id)[number][k])
            place = placement(m.site_pos[side], m.site_quat[side])
        elif kind == _CONNECT:
            place = pin.SE3(np.eye(3), np.array(data[3 * number : 3 * number + 3]))
        else:
            # the point in the second body, and in the first, with the orientation that the second has there
            place = pin.SE3(np.eye(3), np.array(data[:3])) if number else placement(data[3:6], data[6:10])
        sides.append(f"{own}/{bodies[body]}" if body else "world")
        places.append(_frame(place if body else pose * place))
    (first, second), frames = sides, (places[0], places[1])
    active = bool(m.eq_active0[k])
    # without a torque a weld holds its point only
    point = kind == _CONNECT or not data[10]
    return ConnectionItem(label, "point" if point else "weld", first, second, frames=frames, active=active)


def _frame(place: pin.SE3) -> Array:
    """Return a pose as `ConnectionItem` has it."""
    return np.vstack([place.rotation.T, place.translation])


def _is_simple(m: Any, k: int) -> bool:
    """Return whether both joints of an equality have one degree of freedom."""
    return all(side < 0 or m.jnt_type[side] >= 2 for side in (int(m.eq_obj1id[k]), int(m.eq_obj2id[k])))


def _coupling(m: Any, k: int, own: str, joints: Sequence[str], label: str) -> CouplingItem:
    first, second, data = int(m.eq_obj1id[k]), int(m.eq_obj2id[k]), m.eq_data[k]
    # MuJoCo counts both joints from their references
    zero = [float(m.qpos0[m.jnt_qposadr[side]]) if side >= 0 else 0.0 for side in (first, second)]
    ratio = float(data[1]) if second >= 0 else 0.0
    offset = zero[0] + float(data[0]) - ratio * zero[1]
    other = f"{own}/{joints[second]}" if second >= 0 else ""
    return CouplingItem(label, f"{own}/{joints[first]}", other, ratio, offset, bool(m.eq_active0[k]))


def _tendon_coupling(m: Any, k: int, own: str, joints: Sequence[str], label: str) -> CouplingItem | None:
    """Return the equality of fixed tendons as one of joints; None if it is not of one joint or two in proportion."""
    data, total, length = m.eq_data[k], dict[str, float](), float(m.eq_data[k, 0])
    for side, factor in ((int(m.eq_obj1id[k]), 1.0), (int(m.eq_obj2id[k]), -float(data[1]))):
        if side >= 0:
            over = fixed_tendon(m, side, joints)
            if not over:
                return None
            length += factor * float(m.tendon_length0[side])
            for name, (coefficient,) in over.items():
                total[name] = total.get(name, 0.0) + factor * coefficient
    kept = [(name, c) for name, c in total.items() if c]
    if np.any(data[2:5]) or len(kept) not in (1, 2):
        return None
    (first, scale), (second, other) = kept[0], kept[1] if len(kept) == 2 else ("", 0.0)
    active, leader = bool(m.eq_active0[k]), second and f"{own}/{second}"
    return CouplingItem(label, f"{own}/{first}", leader, -other / scale, length / scale, active)
