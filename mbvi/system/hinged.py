"""Connected systems with hinges that have springs, damping, dry friction and controls of their own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arguments import returned
from ..errors import InputError
from ..projection import FreeMotion, TreeFreeMotion, in_flight
from ..projection.damped_rows import damped_velocity, moving_rows
from ..projection.tree import damp_slowed
from .connected import ConnectedSystem
from .given import not_finite
from .mechanisms.articulated import Control
from .mechanisms.equalities import Equality
from .mechanisms.hinge_angles import HingeAngles
from .system import Array, System


@dataclass(frozen=True)
class Hinges:
    """Hinges between bodies, and what acts about them on the second bodies.

    Attributes
    ----------
    names : tuple of str
        Their names.
    angles : HingeAngles
        Their angles.
    stiffness, rest, damping, friction : ndarray, shape (k,)
        Of springs the torque per angle and the angle of no torque, of damping the torque per rate, and the largest
        torques of dry friction [N m/rad, rad, N m s/rad, N m].
    controls : tuple of callable or None
        control(t, q, v) -> tau of the angle and its rate, each of shape (1,).
    """

    names: tuple[str, ...]
    angles: HingeAngles
    stiffness: Array
    rest: Array
    damping: Array
    friction: Array
    controls: tuple[Control | None, ...]


class HingedSystem(ConnectedSystem):
    """Robots, bodies and spheres with equalities between them, and hinges with forces of their own.

    Parameters
    ----------
    inner, equalities
        See `ConnectedSystem`; the equalities of the hinges are among these.
    hinges : Hinges
        The hinges.

    Notes
    -----
    Steps are implicit in the damping of hinges as in that of joints, by the same rule on the velocities that keep the
    equalities; dry friction is part of the law. A spring acts along the shorter way to its angle of rest.
    """

    def __init__(self, inner: System, equalities: Sequence[Equality], hinges: Hinges) -> None:
        super().__init__(inner, equalities)
        self.hinges: Hinges = hinges
        self.has_joint_friction = self.has_joint_friction or bool(hinges.friction.any())
        driven = any(control is not None for control in hinges.controls)
        self.controlled, self.loaded = self.controlled or driven, self.loaded or driven
        # a control is called once a step
        self.velocity_dependent = self.velocity_dependent and not driven
        # which velocities move hinges that take energy, as a damping
        self.losing = np.zeros(self.nv)
        for k in np.flatnonzero((hinges.damping > 0.0) | (hinges.friction > 0.0)):
            self.losing[self.whole.supported(hinges.angles.bodies[:, k].tolist())] = 1.0
        self._last: tuple[bytes, Array] | None = None

    def __reduce__(self) -> tuple[type, tuple[Any, ...]]:
        return type(self), (self.inner, self.equalities, self.hinges)

    def notes(self) -> list[str]:
        names = ", ".join(self.hinges.names)
        return [*self.inner.notes(), f"steps are Python's, because hinges have forces of their own: {names}"]

    def hinge_gradients(self, q: Array) -> Array:
        """Return the gradients of the angles of the hinges, shape (k, nv)."""
        key = q.tobytes()
        if self._last is None or self._last[0] != key:
            self._last = key, self.hinges.angles.gradients(self, q)
        return self._last[1]

    def _stretched(self, q: Array) -> Array:
        """Return by how much springs are turned from their rest, within (-pi, pi], shape (k,) [rad]."""
        turned = self.hinges.angles.at(self, q) - self.hinges.rest
        return turned - 2.0 * np.pi * np.ceil(turned / (2.0 * np.pi) - 0.5)

    def _about_hinges(self, t: float, q: Array, v: Array) -> Array:
        """Return the force of springs and controls of the hinges, shape (nv,)."""
        hinges, rows = self.hinges, self.hinge_gradients(q)
        about = -hinges.stiffness * self._stretched(q) if hinges.stiffness.any() else np.zeros(len(rows))
        for k, control in enumerate(hinges.controls):
            if control is not None:
                about[k] += self._controlled(k, control, t, q, rows[k] @ v)
        return np.asarray(about @ rows)

    def torque(self, t: float, q: Array, v: Array) -> Array:
        return self.inner.torque(t, q, v) + self._about_hinges(t, q, v)

    def _controlled(self, k: int, control: Control, t: float, q: Array, rate: float) -> float:
        """Return the torque of the control of a hinge."""
        what = f"the control of {self.hinges.names[k]}"
        own = self.hinges.angles.at(self, q)[k : k + 1], np.array([rate])
        tau = returned(control(t, *own), what)
        if tau.shape != (1,):
            raise InputError(f"{what} returned shape {tau.shape} at t = {t:.6g} s; (1,) is expected")
        if not np.isfinite(tau).all():
            raise not_finite(what, tau, t, *own)
        return float(tau[0])

    def damping_force(self, q: Array, v: Array) -> Array:
        rows = self.hinge_gradients(q)
        return super().damping_force(q, v) + (self.hinges.damping * (rows @ v)) @ rows

    def force(self, t: float, q: Array, v: Array) -> Array:
        return self.inner.force(t, q, v) + self._added(t, q, v)

    def _added(self, t: float, q: Array, v: Array) -> Array:
        """Return the force of the hinges, dry friction left out, shape (nv,)."""
        rows = self.hinge_gradients(q)
        damping = (self.hinges.damping * (rows @ v)) @ rows
        return self._about_hinges(t, q, v) - np.asarray(damping)

    def potential_energy(self, t: float, q: Array) -> float:
        springs = 0.5 * float(self.hinges.stiffness @ self._stretched(q) ** 2)
        return self.inner.potential_energy(t, q) + springs

    def free_velocity(self, t: float, q: Array, v: Array, h: float) -> Array:
        return in_flight(self.free_motion(t, q, v, h))

    def pushed_velocity(self, t: float, q: Array, v: Array, h: float) -> Array:
        return in_flight(self._with_hinges(self._driven(t, q, v).pushed_motion(t, q, v, h), q, h))

    def free_motion(self, t: float, q: Array, v: Array, h: float) -> FreeMotion:
        return self._with_hinges(self._driven(t, q, v).free_motion(t, q, v, h), q, h)

    def centered_motion(self, t: float, q: Array, v: Array, h: float, at: Array) -> FreeMotion:
        slowed = None
        if self.has_joint_friction and self.velocity_dependent:
            pushed = self._driven(t, q, v).pushed_motion(t, q, v, 0.5 * h)
            slowed = self._with_hinges(pushed, q, 0.5 * h).free, at
        return self._with_hinges(self._driven(t, q, at).centered_motion(t, q, v, h, at), q, h, slowed)

    def _with_hinges(
        self, motion: TreeFreeMotion, q: Array, h: float, slowed: tuple[Array, Array] | None = None
    ) -> FreeMotion:
        """Return the free motion with the damping of the hinges, and the metric with their dry friction.

        `slowed` has the velocities without and with dry friction in the middle of the step; see `damp_slowed`.
        """
        hinges, metric, rows = self.hinges, self.metric(q), self.hinge_gradients(q)
        free, damped = motion.free, np.flatnonzero(hinges.damping)
        _, _, _, v, _, torque, effects, twice = motion.kernel_arguments
        joints = np.flatnonzero(self.whole.damping)
        if damped.size or (joints.size and slowed is not None):
            along = np.vstack([np.eye(self.nv)[joints], rows[damped]])
            damping = np.concatenate([self.whole.damping[joints], hinges.damping[damped]])
            if slowed is not None:
                damp_slowed(damping.copy(), along @ slowed[0], along @ slowed[1], damping)
            free = damped_velocity(metric, (np.sqrt(damping)[:, None] * along).T, v, h, torque - effects, twice)
        if self.has_joint_friction:
            rough = np.flatnonzero(hinges.friction)
            # a hinge that other equalities hold does not turn
            rough = rough[moving_rows(metric, rows[rough])]
            most = np.concatenate([self.whole.friction, hinges.friction[rough]])
            metric = metric.with_friction(h * most, rows[rough])
        return FreeMotion(free, metric)

    def unheld_acceleration(self, t: float, q: Array, v: Array) -> Array:
        added = self.inner.metric(q).solve_rows(self._added(t, q, v)[None])[0]
        return np.asarray(self.inner.unheld_acceleration(t, q, v) + added)

    def acceleration(self, t: float, q: Array, v: Array) -> Array:
        return self.held_acceleration(q, v, self.unheld_acceleration(t, q, v))
