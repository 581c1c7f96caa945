"""Several systems that are connected by equalities c(q) = 0 between them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..errors import InputError
from ..projection import FreeMotion, Metric, TreeMetric, in_flight
from .actuated import ActuatedSystem
from .blocks import BlockSystem
from .mechanisms.articulated import ArticulatedSystem
from .mechanisms.equalities import CoupledJoints, Equality, PointRows
from .mechanisms.joined import joined
from .system import Array, System

# most velocities of systems that are connected: the mass matrix is dense
_MOST = 600
# what does not depend on forces and equalities is that of the systems
_THEIRS = (
    "difference", "chart_rate", "placements", "kinetic_energy", "potential_energy", "separation_rows", "point_bias",
    "reach", "are_lengths", "go_straight", "unit_groups", "located_parts", "start", "torque", "force",
    "added_acceleration", "notes", "coast",
)  # fmt: skip


class ConnectedSystem(System):
    """Robots, bodies and spheres with equalities between them.

    Parameters
    ----------
    inner : System
        The systems, with all that acts on them.
    equalities : sequence of PointRows or CoupledJoints
        The equalities between them, numbered as q, v and bodies are here.

    Raises
    ------
    InputError
        If they have more than 600 velocities, or move in a plane.

    Notes
    -----
    Metric, retraction and reactions are those of one mechanism that the systems are joined to; see `ArticulatedSystem`.
    """

    whole: ArticulatedSystem

    def __init__(self, inner: System, equalities: Sequence[Equality]) -> None:
        if inner.nv > _MOST:
            raise InputError(f"bodies of at most {_MOST} velocities can be connected; these have {inner.nv}")
        self.inner, self.equalities = inner, tuple(equalities)
        self.nq, self.nv, self.bodies = inner.nq, inner.nv, inner.bodies
        self.controlled, self.loaded, self.observe = inner.controlled, inner.loaded, inner.observe
        self.velocity_dependent = inner.velocity_dependent
        self.whole = joined(inner, self.equalities)
        self.has_joint_friction = self.whole.has_joint_friction
        self._damped = bool(self.whole.damping.any())
        for name in _THEIRS:
            # unless a class derived from this one has its own
            if name not in vars(type(self)):
                setattr(self, name, getattr(inner, name))

    def __reduce__(self) -> tuple[type, tuple[Any, ...]]:
        return type(self), (self.inner, self.equalities)

    def share_closings(self, shared: bool) -> None:
        self.whole.share_closings(shared)

    def coupled(self) -> list[Array]:
        found = []
        for one in self.equalities:
            if isinstance(one, PointRows):
                found.append(np.flatnonzero(self.whole.supported([one.first, one.second])))
            elif isinstance(one, CoupledJoints):
                found.append(np.array([one.first[1], *([one.second[1]] if one.second[2] else [])]))
        return found

    def gaps(self, q: Array) -> Array:
        return self.whole.gaps(q)

    def closed(self, q: Array) -> Array:
        return self.whole.closed(q)

    def tangent(self, q: Array, v: Array) -> Array:
        return self.metric(q).tangent(v)

    def keeping(self, q: Array, metric: Metric) -> Metric:
        return self.whole.keeping(q, metric)

    def integrate(self, q: Array, dv: Array) -> Array:
        return self.whole.integrate(q, dv).copy()

    def metric(self, q: Array) -> TreeMetric:
        return self.whole.metric(q)

    def free_velocity(self, t: float, q: Array, v: Array, h: float) -> Array:
        if self.has_joint_friction or self._damped:
            return in_flight(self.free_motion(t, q, v, h))
        return self.metric(q).tangent(self.inner.free_velocity(t, q, v, h))

    def pushed_velocity(self, t: float, q: Array, v: Array, h: float) -> Array:
        metric = self.metric(q)
        if self._damped:
            free = self._driven(t, q, v).pushed_motion(t, q, v, h).free
        else:
            free = metric.tangent(self.inner.pushed_velocity(t, q, v, h))
        return in_flight(FreeMotion(free, self._with_friction(metric, h)))

    def free_motion(self, t: float, q: Array, v: Array, h: float) -> FreeMotion:
        if self._damped:
            motion = self._driven(t, q, v).free_motion(t, q, v, h)
            return FreeMotion(motion.free, self._with_friction(self.metric(q), h))
        inner, metric = self.inner.free_motion(t, q, v, h), self.metric(q)
        return FreeMotion(metric.tangent(inner.free), self._with_friction(metric, h))

    def _with_friction(self, metric: TreeMetric, h: float) -> TreeMetric:
        """Return the metric with the dry friction of joints in a step."""
        return metric.with_friction(h * self.whole.friction) if self.has_joint_friction else metric

    def _driven(self, t: float, q: Array, at: Array) -> ArticulatedSystem:
        """Return the one mechanism with the torques at a velocity: its damping acts along the equalities."""
        self.whole.applied = self.torque(t, q, at)
        return self.whole

    def centered_motion(self, t: float, q: Array, v: Array, h: float, at: Array) -> FreeMotion:
        if self._damped:
            motion = self._driven(t, q, at).centered_motion(t, q, v, h, at)
            return FreeMotion(motion.free, self._with_friction(self.metric(q), h))
        inner, metric = self.inner.centered_motion(t, q, v, h, at), self.metric(q)
        # the mean velocity of the step keeps the equalities
        return FreeMotion(metric.tangent(inner.free + v) - v, self._with_friction(metric, h))

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        return self.held_acceleration(q, v, self.inner.acceleration(t, q, v))

    def unheld_acceleration(self, t: float, q: Array, v: Array) -> Array:
        return self.inner.unheld_acceleration(t, q, v)

    def held_acceleration(self, q: Array, v: Array, free: Array) -> Array:
        return self.whole.held_acceleration(q, v, free)


def with_parts(system: System, replaced: Callable[[System], System]) -> System:
    """Return a system like a given one, of which each part is what a function returns for it.

    Forces from outside and equalities between parts are shared.
    """
    if isinstance(system, ActuatedSystem):
        return ActuatedSystem(with_parts(system.inner, replaced), system.loads, system.observe is not None)
    if isinstance(system, ConnectedSystem):
        return ConnectedSystem(with_parts(system.inner, replaced), system.equalities)
    if isinstance(system, BlockSystem):
        return BlockSystem([replaced(part) for part in system.parts])
    return replaced(system)
