"""A system with forces and controls that are given as functions of the whole state."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

from ..projection import FreeMotion, TreeFreeMotion
from .articulated import ArticulatedSystem
from .blocks import BlockSystem
from .system import Array, System


class Load(Protocol):
    """Something that acts on a system: an external force, or a control of the whole scene."""

    def add(self, t: float, q: Array, v: Array, total: Array) -> None:
        """Add the generalised force at (t, q, v) to `total`, shape (nv,) [N, N m]."""
        ...


class ActuatedSystem:
    """A system and what acts on it from outside: g(t, q, v) of the system plus the loads'.

    Parameters
    ----------
    inner : System
        Mechanisms, bodies and spheres with their own forces. Constraints may go on asking it for their rows.
    loads : sequence of Load
        What acts on it, evaluated once at each (t, q, v).
    controlled : bool
        Whether there is a control among the loads.

    Attributes
    ----------
    parts : tuple of System
        The systems that `inner` consists of.
    controlled : bool
        Whether a control acts, of the whole scene or of one robot.
    observe : callable or None
        observe(contacts) gives the loads a function that returns the contacts of the last accepted step, None where no
        load looks at contacts. Whoever steps the system calls it after each step.
    """

    def __init__(self, inner: System, loads: Sequence[Load], controlled: bool) -> None:
        self.inner, self.loads = inner, tuple(loads)
        self.nq, self.nv, self.bodies = inner.nq, inner.nv, inner.bodies
        self.parts = parts_of(inner)
        self.controlled = controlled or any(getattr(part, "control", None) is not None for part in self.parts)
        # a control is called once a step
        self.velocity_dependent = not self.controlled and (inner.velocity_dependent or not controlled)
        self._robots: list[tuple[ArticulatedSystem, slice]] = []
        self._bodies: list[tuple[System, slice]] = []
        start = 0
        for part in self.parts:
            where = slice(start, start + part.nv)
            start += part.nv
            if isinstance(part, ArticulatedSystem):
                self._robots.append((part, where))
            else:
                self._bodies.append((part, where))
        self.observe = self._observe if controlled else None
        self._last: tuple[float, bytes, bytes, Array] | None = None
        # what does not depend on forces
        self.integrate, self.difference, self.metric = inner.integrate, inner.difference, inner.metric
        self.chart_rate, self.placements = inner.chart_rate, inner.placements
        self.kinetic_energy, self.potential_energy = inner.kinetic_energy, inner.potential_energy
        self.separation_rows, self.point_bias, self.reach = inner.separation_rows, inner.point_bias, inner.reach

    def __reduce__(self) -> tuple[type, tuple[Any, ...]]:
        return type(self), (self.inner, self.loads, self.observe is not None)

    def start(self) -> None:
        self._observe(tuple)
        if hasattr(self.inner, "start"):
            self.inner.start()

    def _observe(self, contacts: Callable[[], tuple[Any, ...]]) -> None:
        self._last = None
        for load in self.loads:
            if hasattr(load, "observe"):
                load.observe(contacts)

    def _act(self, t: float, q: Array, v: Array) -> Array:
        """Return the loads' generalised force, shape (nv,), and give each mechanism its part."""
        key = t, q.tobytes(), v.tobytes()
        if self._last is None or self._last[:3] != key:
            total = np.zeros(self.nv)
            for load in self.loads:
                load.add(t, q, v, total)
            self._last = *key, total
        total = self._last[3]
        for robot, where in self._robots:
            robot.applied = total[where]
        return total

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

    def force(self, t: float, q: Array, v: Array) -> Array:
        total = self._act(t, q, v)
        g = self.inner.force(t, q, v)
        if self._bodies:
            g = g.copy()
            for _, where in self._bodies:
                g[where] += total[where]
        return g

    def free_velocity(self, t: float, q: Array, v: Array, h: float) -> Array:
        total = self._act(t, q, v)
        free = self.inner.free_velocity(t, q, v, h)
        return free + h * self._accelerated(total, q) if self._bodies else free

    def free_motion(self, t: float, q: Array, v: Array, h: float) -> FreeMotion | TreeFreeMotion:
        total = self._act(t, q, v)
        push = self.inner.free_motion(t, q, v, h)
        return FreeMotion(push.free + h * self._accelerated(total, q), push.metric) if self._bodies else push

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        total = self._act(t, q, v)
        free = self.inner.acceleration(t, q, v)
        return free + self._accelerated(total, q) if self._bodies else free


class Part(NamedTuple):
    """One of the systems that a system consists of, and where its q, v and bodies begin."""

    system: System
    q: int
    v: int
    body: int


def parts_of(system: System) -> tuple[System, ...]:
    """Return the mechanisms, bodies and spheres that a system consists of, in the order of q and v."""
    return tuple(part.system for part in located_parts(system))


def located_parts(system: System) -> list[Part]:
    """Return what `parts_of` does, each with where it begins in q, in v and among the bodies."""
    inner = system.inner if isinstance(system, ActuatedSystem) else system
    if isinstance(inner, BlockSystem):
        return [Part(b.system, b.q.start, b.v.start, b.first_body) for b in inner.blocks]
    return [Part(inner, 0, 0, 0)]
