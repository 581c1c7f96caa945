"""Derivatives of the accelerations of a system without contacts, part by part."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import pinocchio as pin

from ...schemes.event_driven.runge_kutta import RungeKuttaStep
from ...system import System
from ...system.actuated import ActuatedSystem
from ...system.actuators import Actuators, DrivenActuators
from ...system.free.bodies import FreeBodies, Spheres
from ...system.free.planar import PlanarBodies
from ...system.mechanisms.articulated import ArticulatedSystem, Control
from ...system.mechanisms.loop_margin import with_equalities
from ...system.system import Array, Part, located_parts
from .differences import along, along_both
from .limited_forces import LimitedForces, has_limited_forces
from .tracking import Tracking, follows

# (q, w) -> derivative of M w by q at a constant w, shape (nv, nv)
Momenta = Callable[[Array, Array], Array]
# (t, q, v, force) -> derivative of acceleration + M^-1 force at constant force, shape (nv, 2 nv)
Jacobian = Callable[[float, Array, Array, Array], Array]


class Accelerations:
    """Derivatives of a system's accelerations without contacts by (q, v).

    Parameters
    ----------
    system : System
        The system. Where it has equalities, derivatives hold along variations that keep them.
    steps : ndarray, shape (nv,)
        Lengths of differences along each velocity; see `along`.
    """

    def __init__(self, system: System, steps: Array) -> None:
        self._system, self._steps = system, steps
        self._tracking = {part.v: Tracking(part) for part in located_parts(system) if follows(part.system)}
        self._limited = {
            part.v: LimitedForces(part) for part in located_parts(system) if has_limited_forces(part.system)
        }
        self._parts = [
            (part, _jacobian(part, steps[_columns(part)], part.v in self._tracking, self._limited.get(part.v)))
            for part in located_parts(system)
        ]
        self._momenta = [(part, _momenta(part.system, steps[_columns(part)])) for part, _ in self._parts]
        self._held = bool(with_equalities(system))

    def jacobian(self, t: float, q: Array, v: Array, force: Array) -> Array:
        """Return the derivative of M^-1 (g + force) by (q, v) at a constant generalised force, shape (nv, 2 nv)."""
        n, system = len(v), self._system
        if self._held:
            return _of_any(system, self._steps, t, q, v, force)
        out = np.zeros((n, 2 * n))
        if isinstance(system, ActuatedSystem):
            loads = along_both(partial(_loaded, system, t), system, q, v, self._steps)
            # passes the mechanisms their loads at (q, v), which are constant below
            system.torque(t, q, v)
            out += system.metric(q).solve_rows(np.ascontiguousarray(loads.T)).T
        for part, jacobian in self._parts:
            own = _columns(part)
            found = jacobian(t, q[part.q : part.q + part.system.nq], v[own], force[own])
            m = part.system.nv
            out[own, own] += found[:, :m]
            out[own, n + own.start : n + own.stop] += found[:, m:]
        if self._tracking:
            slopes = np.zeros((n, 2 * n))
            for one in self._tracking.values():
                one.add_slopes(t, q, v, slopes)
            out += system.metric(q).solve_rows(np.ascontiguousarray(slopes.T)).T
        return out

    def kinks(self, step: RungeKuttaStep) -> list[float]:
        """Return the shares of a step, ascending, at which derivatives jump: torques and forces have kinks there."""
        found = {share for one in self._tracking.values() for share in one.kinks(step)}
        return sorted(found.union(*(one.kinks(self._system, step) for one in self._limited.values())))

    def momenta(self, q: Array, w: Array) -> Array:
        """Return the derivative of M w by q at a constant w, shape (nv, nv)."""
        out = np.zeros((len(w), len(w)))
        for part, momenta in self._momenta:
            own = _columns(part)
            out[own, own] = momenta(q[part.q : part.q + part.system.nq], w[own])
        return out


def _columns(part: Part) -> slice:
    return slice(part.v, part.v + part.system.nv)


def _loaded(system: ActuatedSystem, t: float, q: Array, v: Array) -> Array:
    """Return the generalised force of the loads, shape (nv,)."""
    total = np.zeros(system.nv)
    for load in system.loads:
        load.add(t, q, v, total)
    return total


def _jacobian(part: Part, steps: Array, tracks: bool, limited: LimitedForces | None) -> Jacobian:
    """Return what computes the derivatives of one part, without those of the torque of a `Tracking`."""
    system = part.system
    if isinstance(system, ArticulatedSystem):
        named = tracks or isinstance(system.control, Actuators | DrivenActuators)
        given = None if named or not system.controlled else system.control
        return partial(_of_mechanism, system, system.model.createData(), steps, given, limited)
    if isinstance(system, Spheres | PlanarBodies):
        return lambda t, q, v, force: np.zeros((len(v), 2 * len(v)))
    if isinstance(system, FreeBodies):
        return partial(_of_bodies, system)
    return partial(_of_any, system, steps)


def _momenta(system: System, steps: Array) -> Momenta:
    """Return what computes the derivatives of M w of one part."""
    if isinstance(system, ArticulatedSystem):
        model, still = system.model.copy(), np.zeros(system.nv)
        model.gravity = pin.Motion.Zero()
        data = model.createData()
        return lambda q, w: pin.computeRNEADerivatives(model, data, q, still, w)[0].copy()
    if isinstance(system, Spheres | PlanarBodies | FreeBodies):
        return lambda q, w: np.zeros((len(w), len(w)))
    return lambda q, w: along(lambda dq: system.metric(system.integrate(q, dq)).apply(w), steps)


def _of_any(system: System, steps: Array, t: float, q: Array, v: Array, force: Array) -> Array:
    def forced(q: Array, v: Array) -> Array:
        free = system.acceleration(t, q, v)
        return free + system.metric(q).solve_rows(force[None])[0] if force.any() else free

    return along_both(forced, system, q, v, steps)


def _of_bodies(system: FreeBodies, t: float, q: Array, v: Array, force: Array) -> Array:
    # M of bodies does not depend on q, and gyroscopic torques are quadratic: these differences are exact
    n = len(v)
    out = np.zeros((n, 2 * n))
    for k in (3, 4, 5):
        dv = np.zeros(n)
        dv[k::6] = 1.0
        change = 0.5 * (system.acceleration(t, q, v + dv) - system.acceleration(t, q, v - dv))
        for body in range(n // 6):
            own = slice(6 * body, 6 * body + 6)
            out[own, n + 6 * body + k] = change[own]
    return out


def _of_mechanism(
    system: ArticulatedSystem,
    data: pin.Data,
    steps: Array,
    control: Control | None,
    limited: LimitedForces | None,
    t: float,
    q: Array,
    v: Array,
    force: Array,
) -> Array:
    """Pinocchio's analytical derivatives, with differences of what springs, actuators and a given `control` do."""
    torque = system.torque(t, q, v) - system.damping * v + force
    pin.computeABADerivatives(system.model, data, q, v, torque)
    out = np.hstack([data.ddq_dq, data.ddq_dv])
    acting = list[Callable[[Array, Array], Array]]()
    if control is not None:
        acting.append(partial(control, t))
    if limited is not None:
        acting.append(limited.as_at(t, q, v))
    if not (system.damping.any() or acting):
        return out
    upper = np.triu(data.Minv)
    inverse = upper + np.triu(upper, 1).T
    out[:, len(v) :] -= inverse * system.damping
    for one in acting:
        out += inverse @ along_both(one, system, q, v, steps)
    return out
