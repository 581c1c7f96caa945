"""A system on which external forces and controls of the whole scene act."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from ..projection import FreeMotion, TreeFreeMotion
from .parts import parts_of
from .system import Array, System


class Load:
    """Something that acts on a system: an external force, or a control of the whole scene."""

    def add(self, t: float, q: Array, v: Array, total: Array) -> None:
        """Add the generalised force at (t, q, v) to `total`, shape (nv,) [N, N m]."""
        raise NotImplementedError

    def observe(self, contacts: Callable[[], tuple[Any, ...]]) -> None:
        """Keep the function that returns the contacts of the last accepted step; most loads do not look at them."""


# methods that do not depend on forces: bound to the inner system's own, so that they cost no second call
_FORCE_FREE = (
    "integrate", "difference", "metric", "chart_rate", "placements", "kinetic_energy", "potential_energy",
    "separation_rows", "point_bias", "reach", "are_lengths", "go_straight", "unit_groups", "located_parts",
    "notes", "coast", "share_closings", "keeping",
)  # fmt: skip


class ActuatedSystem(System):
    """A system and what acts on it from outside: g(t, q, v) of the system plus the loads'.

    Parameters
    ----------
    inner : System
        Mechanisms, bodies and spheres with their own forces. Constraints may go on using it for their rows.
    loads : sequence of Load
        Forces and controls that act on it, evaluated once at each (t, q, v).
    controlled : bool
        Whether one of the loads is a control.

    Attributes
    ----------
    parts : tuple of System
        The systems that `inner` consists of.
    controlled : bool
        Whether a control acts, of the whole scene or of one robot.
    """

    loaded = True

    def __init__(self, inner: System, loads: Sequence[Load], controlled: bool) -> None:
        self.inner, self.loads = inner, tuple(loads)
        self.nq, self.nv, self.bodies = inner.nq, inner.nv, inner.bodies
        self.parts, self.sparse = parts_of(inner), inner.sparse
        self.controlled, self.has_joint_friction = controlled or inner.controlled, inner.has_joint_friction
        # a control is called once a step
        self.velocity_dependent = not self.controlled and (inner.velocity_dependent or not controlled)
        # parts that add forces from outside themselves, and the others
        self._mechanisms: list[tuple[System, slice]] = []
        self._bodies: list[tuple[System, slice]] = []
        start = 0
        for part in self.parts:
            where = slice(start, start + part.nv)
            start += part.nv
            (self._bodies if part.applied is None else self._mechanisms).append((part, where))
        self.observe = self._observe if controlled else None
        self._last: tuple[float, bytes, bytes, Array] | None = None
        for name in _FORCE_FREE:
            setattr(self, name, getattr(inner, name))

    def __reduce__(self) -> tuple[type, tuple[Any, ...]]:
        return type(self), (self.inner, self.loads, self.observe is not None)

    def start(self) -> None:
        self._observe(tuple)
        self.inner.start()

    def _observe(self, contacts: Callable[[], tuple[Any, ...]]) -> None:
        self._last = None
        for load in self.loads:
            load.observe(contacts)

    def _act(self, t: float, q: Array, v: Array) -> Array:
        """Return the loads' generalised force, shape (nv,), and pass each mechanism its part."""
        key = t, q.tobytes(), v.tobytes()
        if self._last is None or self._last[:3] != key:
            total = np.zeros(self.nv)
            for load in self.loads:
                load.add(t, q, v, total)
            self._last = *key, total
        total = self._last[3]
        for part, where in self._mechanisms:
            part.applied = total[where]
        return total

    def torque(self, t: float, q: Array, v: Array) -> Array:
        total = self._act(t, q, v)
        # that of mechanisms is among their own
        torque = self.inner.torque(t, q, v).copy()
        for _, where in self._bodies:
            torque[where] += total[where]
        return torque

    def added_acceleration(self, t: float, q: Array, v: Array) -> Array:
        """Return what the loads add to the acceleration of bodies and spheres, shape (nv,); zero for mechanisms."""
        return self._accelerated(self._act(t, q, v), q)

    def _accelerated(self, total: Array, q: Array) -> Array:
        """Return what the loads add to the acceleration of bodies and spheres, shape (nv,); zero for mechanisms."""
        out = np.zeros(self.nv)
        for part, where in self._bodies:
            # M of bodies does not depend on q
            out[where] = part.metric(q).solve_rows(total[None, where])[0]
        return out

    def _half_change(self, t: float, q: Array, v: Array, h: float) -> Array:
        """Return half of what loads add to velocities in a step: it acts before gyroscopic torques do, see `spin`."""
        return 0.5 * h * self.added_acceleration(t, q, v)

    def force(self, t: float, q: Array, v: Array) -> Array:
        total = self._act(t, q, v)
        g = self.inner.force(t, q, v)
        if self._bodies:
            g = g.copy()
            for _, where in self._bodies:
                g[where] += total[where]
        return g

    def free_velocity(self, t: float, q: Array, v: Array, h: float) -> Array:
        half = self._half_change(t, q, v, h)
        return self.inner.free_velocity(t, q, v + half, h) + half

    def pushed_velocity(self, t: float, q: Array, v: Array, h: float) -> Array:
        added = h * self.added_acceleration(t, q, v)
        return self.inner.pushed_velocity(t, q, v, h) + added

    def free_motion(self, t: float, q: Array, v: Array, h: float) -> FreeMotion | TreeFreeMotion:
        half = self._half_change(t, q, v, h)
        return self._with_change(self.inner.free_motion(t, q, v + half, h), half)

    def centered_motion(self, t: float, q: Array, v: Array, h: float, at: Array) -> FreeMotion | TreeFreeMotion:
        half = self._half_change(t, q, at, h)
        return self._with_change(self.inner.centered_motion(t, q, v + half, h, at), half)

    @staticmethod
    def _with_change(motion: FreeMotion | TreeFreeMotion, half: Array) -> FreeMotion | TreeFreeMotion:
        # loads on a mechanism are among its torques
        return motion if isinstance(motion, TreeFreeMotion) else motion._replace(free=motion.free + half)

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        return self._with_loads(self.inner.acceleration, t, q, v)

    def unheld_acceleration(self, t: float, q: Array, v: Array) -> Array:
        return self._with_loads(self.inner.unheld_acceleration, t, q, v)

    def _with_loads(self, of: Callable[[float, Array, Array], Array], t: float, q: Array, v: Array) -> Array:
        total = self._act(t, q, v)
        free = of(t, q, v)
        return free + self._accelerated(total, q) if self._bodies else free
