"""Forces along combinations of joints, linear in length and rate between limits: springs and actuators."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..compiled import kernel, plain_array, record
from .system import Array

_UNLIMITED = (-np.inf, np.inf)


@dataclass(frozen=True)
class JointForce:
    """A force f along the length L = sum of coefficient times joint position; joints receive coefficient times f.

    f = gain u + bias[0] + bias[1] L + bias[2] dL/dt, with the input u and then f kept between their limits.

    Attributes
    ----------
    name : str
        Its name.
    joints : dict of str to tuple of float
        The coefficient of each joint, a hinge or slide; of a ball joint three, of its rotation vector.
    bias : (float, float, float)
        Constant, and factors of length and rate [N, N m].
    gain : float
        Factor of the input.
    ctrl, limits : (float, float)
        Limits of the input and of the force.
    """

    name: str
    joints: dict[str, tuple[float, ...]]
    bias: tuple[float, float, float]
    gain: float = 0.0
    ctrl: tuple[float, float] = _UNLIMITED
    limits: tuple[float, float] = _UNLIMITED

    def holding(self, held: Mapping[str, Array]) -> JointForce:
        """Return the force where some joints stay at given positions, of which it keeps their part of the length."""
        length = 0.0
        for name in held.keys() & self.joints.keys():
            place = held[name] if len(held[name]) == 1 else pin.log3(pin.Quaternion(held[name]).toRotationMatrix())
            length += float(np.dot(self.joints[name], place))
        constant, stiffness, damping = self.bias
        kept = {name: c for name, c in self.joints.items() if name not in held}
        return replace(self, joints=kept, bias=(constant + stiffness * length, stiffness, damping))


@record("f8[:,::1], i8[::1], i8[:,::1], f8[:,::1], f8[:,::1]")
class ForceRows(NamedTuple):
    """Forces along combinations of joints as kernels take them; they act on the last n velocities.

    Attributes
    ----------
    moment : ndarray, shape (k, n)
        The coefficients of each force.
    position : ndarray of int, shape (n,)
        Where in q the position of each joint is, counted from the end; 0 where it is not one coordinate.
    balls : ndarray of int, shape (b, 2)
        Of each ball joint where in q its quaternion begins, counted from the end, and which of the n velocities is its
        first.
    law : ndarray, shape (k, 8)
        Gain, the three of `bias`, lower and upper limit of the input, and of the force.
    ctrl : ndarray, shape (r, k)
        Inputs.
    """

    moment: Array
    position: Array
    balls: Array
    law: Array
    ctrl: Array


@kernel("void(ForceRows, i8, Array(f8, 1, 'C', True), Array(f8, 1, 'C', True), f8[::1])")
def write_row_forces(rows: ForceRows, at: int, q: Array, v: Array, force: Array) -> None:
    """Write the forces at q, v and a row of inputs, shape (k,)."""
    n = len(rows.position)
    place, rate = np.zeros(n), len(v) - n
    for j in range(n):
        if rows.position[j] > 0:
            place[j] = q[len(q) - rows.position[j]]
    for b in range(len(rows.balls)):
        i, j = len(q) - rows.balls[b, 0], rows.balls[b, 1]
        sine = np.sqrt(q[i] * q[i] + q[i + 1] * q[i + 1] + q[i + 2] * q[i + 2])
        if sine > 0.0:
            angle = 2.0 * np.arctan2(sine, q[i + 3])
            # the shorter way
            angle = angle - 2.0 * np.pi if angle > np.pi else angle
            for c in range(3):
                place[j + c] = angle / sine * q[i + c]
    for k in range(len(force)):
        law, length, speed = rows.law[k], 0.0, 0.0
        for j in range(n):
            if rows.moment[k, j] != 0.0:
                length += rows.moment[k, j] * place[j]
                speed += rows.moment[k, j] * v[rate + j]
        given = min(max(rows.ctrl[at, k], law[4]), law[5])
        f = law[0] * given + law[1] + law[2] * length + law[3] * speed
        force[k] = min(max(f, law[6]), law[7])


@kernel("void(ForceRows, i8, Array(f8, 1, 'C', True), Array(f8, 1, 'C', True), f8[::1])")
def add_row_forces(rows: ForceRows, at: int, q: Array, v: Array, torque: Array) -> None:
    """Add what forces do at q, v and a row of inputs to the generalised force, shape (nv,)."""
    count, n = len(rows.law), len(rows.position)
    if count == 0:
        return
    force = np.empty(count)
    write_row_forces(rows, at, q, v, force)
    for k in range(count):
        for j in range(n):
            torque[len(v) - n + j] += rows.moment[k, j] * force[k]


def force_rows(forces: Sequence[JointForce], model: pin.Model, ctrl: Array | None = None) -> ForceRows:
    """Return forces on the joints of a model; `ctrl` has shape (r, k), and is zero by default."""
    moment = np.zeros((len(forces), model.nv))
    law = np.array([[f.gain, *f.bias, *f.ctrl, *f.limits] for f in forces]).reshape(-1, 8)
    for row, force in zip(moment, forces, strict=True):
        for name, coefficients in force.joints.items():
            first = model.idx_vs[model.getJointId(name)]
            row[first : first + len(coefficients)] = coefficients
    position, balls = np.zeros(model.nv, np.int64), list[tuple[int, int]]()
    for joint in list(model.joints)[1:]:
        if joint.nq == joint.nv == 1:
            position[joint.idx_v] = model.nq - joint.idx_q
        elif joint.shortname() == "JointModelSpherical":
            balls.append((model.nq - joint.idx_q, joint.idx_v))
    places = np.array(balls, np.int64).reshape(-1, 2)
    return ForceRows(moment, position, places, law, np.zeros((1, len(forces))) if ctrl is None else ctrl)


def no_forces(n: int) -> ForceRows:
    """Return no forces on n velocities."""
    none = np.zeros((0, 2), np.int64)
    return ForceRows(np.zeros((0, n)), np.zeros(n, np.int64), none, np.zeros((0, 8)), np.zeros((1, 0)))


def rows_side_by_side(each: Sequence[tuple[ForceRows, int, int]], nq: int, nv: int) -> ForceRows:
    """Return the forces of several mechanisms, given with where q and v of the mechanism of each end."""
    moment, position, balls = np.zeros((sum(len(rows.law) for rows, *_ in each), nv)), np.zeros(nv, np.int64), []
    done = 0
    for rows, q_end, v_end in each:
        here, after = slice(v_end - len(rows.position), v_end), nq - q_end
        moment[done : done + len(rows.law), here] = rows.moment
        position[here] = np.where(rows.position > 0, rows.position + after, 0)
        balls.append(rows.balls + np.array([after, here.start]))
        done += len(rows.law)
    law, ctrl = np.concatenate([rows.law for rows, *_ in each]), np.concatenate([rows.ctrl for rows, *_ in each], 1)
    return ForceRows(moment, position, np.concatenate(balls), law, ctrl)


def spring_energy(rows: ForceRows, q: Array) -> float:
    """Return the energy of springs at q: that of a force -k L + c between limits, f^2 / (2 k) [J]."""
    force, stiff = np.empty(len(rows.law)), rows.law[:, 2] != 0.0
    write_row_forces(rows, 0, plain_array(q), np.zeros(len(rows.position)), force)
    return float((force[stiff] ** 2 / (-2.0 * rows.law[stiff, 2])).sum())
