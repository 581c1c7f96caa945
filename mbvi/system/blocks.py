"""A system of several independent systems: block-diagonal M."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array

from ..projection import BlockMetric, FreeMotion, Metric, TreeFreeMotion
from .free.sparse_rows import MOST_DENSE, rows_from, side_by_side
from .system import Array, Part, System


class _Block(NamedTuple):
    system: System
    q: slice
    v: slice
    first_body: int


class BlockSystem(System):
    """Independent systems whose q, v and bodies follow each other.

    Parameters
    ----------
    parts : sequence of System
        The systems; body k of a part is body `first + k` here.
    """

    def __init__(self, parts: Sequence[System]) -> None:
        self.parts = tuple(parts)
        blocks, names = [], ["world"]
        q = v = 0
        for part in parts:
            blocks.append(_Block(part, slice(q, q + part.nq), slice(v, v + part.nv), len(names) - 1))
            names.extend(part.bodies[1:])
            q, v = q + part.nq, v + part.nv
        self.nq, self.nv = q, v
        self.controlled = any(part.controlled for part in parts)
        self.velocity_dependent = any(part.velocity_dependent for part in parts)
        self.has_joint_friction = any(part.has_joint_friction for part in parts)
        self.bodies = tuple(names)
        self.blocks = tuple(blocks)
        self._slices = [b.v for b in blocks]
        bodies = [part for part in parts if part.can_be_sparse]
        self.sparse = sum(part.nv for part in bodies) > MOST_DENSE
        for part in bodies:
            # a part with few bodies has sparse rows too if the whole system has many
            part.sparse = self.sparse

    def start(self) -> None:
        for part in self.parts:
            part.start()

    def share_closings(self, shared: bool) -> None:
        for part in self.parts:
            part.share_closings(shared)

    def notes(self) -> list[str]:
        return list(dict.fromkeys(note for part in self.parts for note in part.notes()))

    def located_parts(self) -> list[Part]:
        return [Part(b.system, b.q.start, b.v.start, b.first_body) for b in self.blocks]

    def are_lengths(self) -> Array:
        return np.concatenate([part.are_lengths() for part in self.parts])

    def go_straight(self) -> Array:
        return np.concatenate([part.go_straight() for part in self.parts])

    def unit_groups(self) -> list[Array]:
        return [group + b.q.start for b in self.blocks for group in b.system.unit_groups()]

    def integrate(self, q: Array, dv: Array) -> Array:
        return np.concatenate([b.system.integrate(q[b.q], dv[b.v]) for b in self.blocks])

    def difference(self, q0: Array, q1: Array) -> Array:
        return np.concatenate([b.system.difference(q0[b.q], q1[b.q]) for b in self.blocks])

    def metric(self, q: Array) -> BlockMetric:
        return BlockMetric([b.system.metric(q[b.q]) for b in self.blocks], self._slices)

    def torque(self, t: float, q: Array, v: Array) -> Array:
        return np.concatenate([b.system.torque(t, q[b.q], v[b.v]) for b in self.blocks])

    def force(self, t: float, q: Array, v: Array) -> Array:
        return np.concatenate([b.system.force(t, q[b.q], v[b.v]) for b in self.blocks])

    def free_velocity(self, t: float, q: Array, v: Array, h: float) -> Array:
        return np.concatenate([b.system.free_velocity(t, q[b.q], v[b.v], h) for b in self.blocks])

    def coast(self, v: Array, h: float) -> tuple[Array, Array]:
        displacements, velocities = zip(*(b.system.coast(v[b.v], h) for b in self.blocks), strict=True)
        return np.concatenate(displacements), np.concatenate(velocities)

    def pushed_velocity(self, t: float, q: Array, v: Array, h: float) -> Array:
        return np.concatenate([b.system.pushed_velocity(t, q[b.q], v[b.v], h) for b in self.blocks])

    def force_velocity(self, t: float, q: Array, v: Array, h: float) -> Array:
        return np.concatenate([b.system.force_velocity(t, q[b.q], v[b.v], h) for b in self.blocks])

    def free_motion(self, t: float, q: Array, v: Array, h: float) -> FreeMotion:
        return self._side_by_side([b.system.free_motion(t, q[b.q], v[b.v], h) for b in self.blocks])

    def centered_motion(self, t: float, q: Array, v: Array, h: float, at: Array) -> FreeMotion:
        return self._side_by_side([b.system.centered_motion(t, q[b.q], v[b.v], h, at[b.v]) for b in self.blocks])

    def keeping(self, q: Array, metric: Metric) -> BlockMetric:
        assert isinstance(metric, BlockMetric)
        parts = zip(self.blocks, metric.parts, strict=True)
        return BlockMetric([b.system.keeping(q[b.q], part) for b, part in parts], self._slices)

    def _side_by_side(self, parts: list[FreeMotion | TreeFreeMotion]) -> FreeMotion:
        free = np.concatenate([part.free for part in parts])
        return FreeMotion(free, BlockMetric([part.metric for part in parts], self._slices))

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        return np.concatenate([b.system.acceleration(t, q[b.q], v[b.v]) for b in self.blocks])

    def unheld_acceleration(self, t: float, q: Array, v: Array) -> Array:
        return np.concatenate([b.system.unheld_acceleration(t, q[b.q], v[b.v]) for b in self.blocks])

    def chart_rate(self, q: Array, dv: Array, v: Array) -> Array:
        return np.concatenate([b.system.chart_rate(q[b.q], dv[b.v], v[b.v]) for b in self.blocks])

    def kinetic_energy(self, q: Array, v: Array) -> float:
        return sum(b.system.kinetic_energy(q[b.q], v[b.v]) for b in self.blocks)

    def potential_energy(self, t: float, q: Array) -> float:
        return sum(b.system.potential_energy(t, q[b.q]) for b in self.blocks)

    def placements(self, q: Array, bodies: Array) -> Array:
        places = np.empty((len(bodies), 4, 3))
        for b in self.blocks:
            here = np.flatnonzero(self._inside(b, bodies))
            if here.size:
                # slices are copied faster
                some = slice(here[0], here[-1] + 1) if here[-1] - here[0] + 1 == here.size else here
                places[some] = b.system.placements(q[b.q], bodies[some] - b.first_body)
        return places

    @staticmethod
    def _inside(b: _Block, bodies: Array) -> Array:
        return (bodies > b.first_body) & (bodies < b.first_body + len(b.system.bodies))

    def separation_rows(self, q: Array, first: Array, second: Array, point: Array, normal: Array) -> Array | csr_array:
        if self.sparse and len(point):
            b = next(b for b in reversed(self.blocks) if b.first_body < max(first.max(), second.max(), 1))
            if all(((side > b.first_body) | (side == 0)).all() for side in (first, second)):
                # bodies of one part only
                first, second = (np.where(side > 0, side - b.first_body, 0) for side in (first, second))
                part = b.system.separation_rows(q[b.q], first, second, point, normal)
                if not isinstance(part, np.ndarray):
                    return rows_from(part.data, part.indices + b.v.start, part.indptr, (len(point), self.nv))
                return side_by_side(self.nv, len(point), [(np.arange(len(point)), b.v.start, part)])
        parts = []
        for b in self.blocks:
            sides = [np.where(self._inside(b, side), side - b.first_body, 0) for side in (first, second)]
            here = np.flatnonzero(sides[0] | sides[1])
            if here.size:
                part = b.system.separation_rows(q[b.q], sides[0][here], sides[1][here], point[here], normal[here])
                parts.append((here, b.v, part))
        if self.sparse:
            return side_by_side(self.nv, len(point), [(here, v.start, part) for here, v, part in parts])
        rows = np.zeros((len(point), self.nv))
        for here, v, part in parts:
            rows[here, v] = part
        return rows

    def point_bias(self, q: Array, v: Array, bodies: Array, points: Array) -> Array:
        bias = np.zeros((len(points), 3))
        for b in self.blocks:
            here = self._inside(b, bodies)
            if here.any():
                bias[here] = b.system.point_bias(q[b.q], v[b.v], bodies[here] - b.first_body, points[here])
        return bias

    def reach(self, body: int, centre: Array, radius: float) -> Array:
        b = next(b for b in reversed(self.blocks) if b.first_body < body)
        reach = np.zeros(self.nv)
        reach[b.v] = b.system.reach(body - b.first_body, centre, radius)
        return reach
