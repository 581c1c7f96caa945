"""Second derivatives of rows that are heights of points of bodies above planes: of mechanisms, bodies and spheres."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import pinocchio as pin

from ...system import System
from ...system.free.bodies import FreeBodies, Spheres
from ...system.free.planar import PlanarBodies, PlanarSpheres
from ...system.mechanisms.articulated import ArticulatedSystem
from ...system.mechanisms.joint_tree import KINDS
from ...system.system import Array, Part, located_parts

# (q, v, body, point, normal) -> derivatives by q of gradients, (k, nv, nv), and of the bias, (k, nv), of one part
Second = Callable[[Array, Array, Array, Array, Array], tuple[Array, Array]]


class PointRows:
    """Derivatives by q of the gradient and the bias of heights n . x - c of points x of bodies, and of their turns.

    Parameters
    ----------
    system : System
        The system; those of parts whose kind has no formula here are not known.
    """

    def __init__(self, system: System) -> None:
        self._nv = system.nv
        found = ((part, _second(part.system)) for part in located_parts(system))
        self._parts = [(part, second) for part, second in found if second is not None]

    def known(self, table: Array) -> Array:
        """Return which rows of `SmoothRows.body_points` are known here, shape (k,) of bool."""
        here = np.zeros(len(table), bool)
        for part, _ in self._parts:
            here |= _of_part(part, table)
        return (here & ~np.isnan(table[:, 1])) | (table[:, 0] == 0.0)

    def by_q(self, q: Array, v: Array, table: Array) -> tuple[Array, Array]:
        """Return derivatives by q of gradients, shape (k, nv, nv), and of biases, (k, nv), of rows that are known."""
        gradients, biases = np.zeros((len(table), self._nv, self._nv)), np.zeros((len(table), self._nv))
        for part, second in self._parts:
            rows = np.flatnonzero(_of_part(part, table))
            if not rows.size:
                continue
            own = slice(part.v, part.v + part.system.nv)
            body = table[rows, 0].astype(np.int64) - part.body
            here = q[part.q : part.q + part.system.nq]
            gradients[rows, own, own], biases[rows, own] = second(here, v[own], body, table[rows, 1:4], table[rows, 4:])
        return gradients, biases

    def turns_by_q(self, q: Array, v: Array, body: Array, axis: Array) -> tuple[Array, Array]:
        """Return what `by_q` does, of rows that are the rates at which bodies turn about axes in the world."""
        gradients, biases = np.zeros((len(body), self._nv, self._nv)), np.zeros((len(body), self._nv))
        for part, _ in self._parts:
            rows = np.flatnonzero((body > part.body) & (body < part.body + len(part.system.bodies)))
            turns = _turns_of(
                part.system, q[part.q : part.q + part.system.nq], (body[rows] - part.body).astype(np.int64)
            )
            own = slice(part.v, part.v + part.system.nv)
            for row, (columns, before) in zip(rows.tolist(), turns, strict=True):
                # each column turns with the joints before it, and so does what these turn it by
                turned = before[..., None] * _cross(columns[:, None], columns)
                rate = v[own]
                spin, spins = (before * rate[:, None]).T @ columns, np.einsum("lkx,kj,k->ljx", turned, before, rate)
                gradients[row, own, own] = turned.swapaxes(0, 1) @ axis[row]
                biases[row, own] = (_cross(spins, columns) + _cross(spin, turned)).swapaxes(1, 2) @ rate @ axis[row]
        return gradients, biases


def _turns_of(system: System, q: Array, body: Array) -> list[tuple[Array, Array]]:
    """Return of bodies the angular velocities by each velocity, shape (nv, 3), and which act before which, (nv, nv)."""
    found = []
    if isinstance(system, ArticulatedSystem):
        _, columns, support = system.kinematics(q)
        order = _order(system.model).astype(float)
        found = [(columns[:, 3:] * support[one][:, None], order) for one in body.tolist()]
    elif isinstance(system, FreeBodies):
        for one, place in zip(body.tolist(), system.placements(q, body), strict=True):
            columns = np.zeros((system.nv, 3))
            columns[6 * one - 3 : 6 * one] = place[:3]
            found.append((columns, np.ones((system.nv, system.nv))))
    else:
        found = [(np.zeros((system.nv, 3)), np.ones((system.nv, system.nv)))] * len(body)
    return found


def _of_part(part: Part, table: Array) -> Array:
    """Return which rows are of bodies of a part, shape (k,) of bool."""
    return np.asarray((table[:, 0] > part.body) & (table[:, 0] < part.body + len(part.system.bodies)))


def _second(system: System) -> Second | None:
    """Return what computes the derivatives of one part; None where it is not known."""
    if isinstance(system, ArticulatedSystem):
        if all(joint.shortname() in KINDS for joint in list(system.model.joints)[1:]):
            return partial(_of_mechanism, system, system.model.createData(), _order(system.model))
    elif isinstance(system, FreeBodies) and not isinstance(system, PlanarBodies):
        return partial(_of_bodies, system)
    elif isinstance(system, Spheres) and not isinstance(system, PlanarSpheres):
        return _of_spheres
    return None


def _order(model: pin.Model) -> Array:
    """Return whether the joint of one velocity is not behind that of another, shape (nv, nv) of bool."""
    joint = np.repeat(np.arange(model.njoints), list(model.nvs))
    return np.asarray(joint[:, None] <= joint)


def _of_mechanism(
    system: ArticulatedSystem,
    data: pin.Data,
    order: Array,
    q: Array,
    v: Array,
    body: Array,
    point: Array,
    normal: Array,
) -> tuple[Array, Array]:  # fmt: skip
    # a joint turns all that it carries, the axes of joints behind it too: the velocity of x by joint j changes with
    # joint k by w_k x (v_j at x) where k is not behind j, and by w_j x (v_k at x) where it is
    model = system.model
    poses, columns, support = system.kinematics(q)
    place = poses[body]
    at = np.einsum("kij,ki->kj", place[:, :3], point) + place[:, 3]
    moved = support[body][:, :, None]
    slides, turns = columns[:, :3], columns[:, 3:]
    speeds = (slides + _cross(turns, at[:, None])) * moved
    turned = np.matmul(_cross(normal[:, None], turns) * moved, speeds.swapaxes(1, 2))
    gradients = np.where(order.T, turned.swapaxes(1, 2), turned)
    pin.computeForwardKinematicsDerivatives(model, data, q, v, np.zeros(model.nv))
    biases = np.empty((len(body), model.nv))
    for k, (one, x) in enumerate(zip(body.tolist(), point, strict=True)):
        there = pin.SE3(np.eye(3), x)
        _, by_q, *_ = pin.getPointClassicAccelerationDerivatives(model, data, one, there, pin.LOCAL_WORLD_ALIGNED)
        biases[k] = normal[k] @ by_q
    return gradients, biases


def _of_bodies(system: FreeBodies, q: Array, v: Array, body: Array, point: Array, normal: Array) -> tuple[Array, Array]:
    # the gradient is (n, x x R'n), the bias R'n . (w x (w x x)), and R'n changes by R'n x dq
    k, n = len(body), len(v)
    gradients, biases, rows = np.zeros((k, n, n)), np.zeros((k, n)), np.arange(k)
    turned = np.einsum("kij,kj->ki", system.placements(q, body)[:, :3], normal)
    spin = v.reshape(-1, 6)[body - 1, 3:]
    inward = _cross(spin, _cross(spin, point))
    first = 6 * body - 3
    for axis, along in enumerate(np.eye(3)):
        change = _cross(point, _cross(turned, along))
        for j in range(3):
            gradients[rows, first + j, first + axis] = change[:, j]
    toward = _cross(inward, turned)
    for j in range(3):
        biases[rows, first + j] = toward[:, j]
    return gradients, biases


def _of_spheres(q: Array, v: Array, body: Array, point: Array, normal: Array) -> tuple[Array, Array]:
    return np.zeros((len(body), len(v), len(v))), np.zeros((len(body), len(v)))


def _cross(a: Array, b: Array) -> Array:
    """Return a x b along the last axis; numpy's own takes ten times as long for few vectors."""
    x, y, z = a[..., 0], a[..., 1], a[..., 2]
    u, v, w = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)
