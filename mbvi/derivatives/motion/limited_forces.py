"""Springs and actuators with limits along a motion: which of their limits act, and the times at which that changes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.polynomial.chebyshev import chebpts1, chebroots, chebvander

from ...compiled import plain_array
from ...errors import SensitivityError
from ...schemes.event_driven.forces.limited_forces import reached_limits
from ...schemes.event_driven.runge_kutta import RungeKuttaStep
from ...system.actuators import Actuators, DrivenActuators
from ...system.joint_forces import ForceRows, add_row_forces, write_row_forces
from ...system.mechanisms.articulated import ArticulatedSystem
from ...system.system import Array, Part, System

# distance of a force from its limit, relative to that, which is rounding
_AT_LIMIT = 1e-10
# steps up to this length [s] are too short to tell whether a force stays at its limit: they may begin where it is there
SHORT = 1e-6
# shares of a step at which forces are computed, and what makes a polynomial through values there of them: forces are
# as smooth between their limits as the dense output, which is of degree 7
_NODES = chebpts1(14)
_SHARES, _FITTED = 0.5 * (1.0 + _NODES), np.linalg.inv(chebvander(_NODES, len(_NODES) - 1))
# columns of `ForceRows.law`
_BIAS, _INPUT, _FORCE = slice(1, 4), slice(4, 6), slice(6, 8)


class LimitedForces:
    """Springs and actuators of a mechanism, whose slopes jump where an input or a force reaches or leaves a limit.

    Forces themselves do not jump there, so that variations are continuous.

    Parameters
    ----------
    part : Part
        A mechanism with such forces.
    """

    def __init__(self, part: Part) -> None:
        system = part.system
        assert isinstance(system, ArticulatedSystem)
        control, self._tables = system.control, list[tuple[ForceRows, DrivenActuators | None]]()
        self._q, self._v, self._name = slice(part.q, part.q + system.nq), slice(part.v, part.v + system.nv), system.name
        if system.springs:
            self._tables.append((system.spring_rows, None))
        if isinstance(control, Actuators):
            self._tables.append((control.table.actuators, None))
        elif isinstance(control, DrivenActuators):
            self._tables.append((control.actuators.table.actuators, control))

    def as_at(self, t: float, q: Array, v: Array) -> Callable[[Array, Array], Array]:
        """Return the generalised force near a state of the mechanism, a function of (q, v): limits stay as they are."""
        held = list[tuple[ForceRows, DrivenActuators | None]]()
        for rows, driven in self._tables:
            inputs, forces = _unlimited(rows, driven, t, q, v)
            law = rows.law.copy()
            free = (law[:, 6] < forces) & (forces < law[:, 7])
            law[:, 0] *= free & (law[:, 4] < inputs) & (inputs < law[:, 5]) & (driven is not None)
            law[:, _BIAS] *= free[:, None]
            law[:, 4:] = np.tile([-np.inf, np.inf], 2)
            held.append((rows._replace(law=law), driven))

        def force(q: Array, v: Array) -> Array:
            total = np.zeros(len(v))
            for rows, driven in held:
                if driven is not None:
                    driven(t, q, v)
                add_row_forces(rows, 0, plain_array(q), plain_array(v), total)
            return total

        return force

    def kinks(self, system: System, step: RungeKuttaStep) -> list[float]:
        """Return the shares of a step at which slopes jump; raise `SensitivityError` if a force stays at an edge."""
        limits = [reached_limits(rows, driven is not None) for rows, driven in self._tables]
        if not any(one.any() for one in limits):
            return []
        samples = []
        for share in _SHARES.tolist():
            q, v = step.at(system, share)
            at = step.t + share * step.h, q[self._q], v[self._v]
            each = [np.stack(_unlimited(rows, driven, *at), axis=1) for rows, driven in self._tables]
            # inputs twice, for both of their limits, then forces twice
            samples.append([np.repeat(one, 2, axis=1)[asked] for one, asked in zip(each, limits, strict=True)])
        edges = np.concatenate([
            rows.law[:, 4:][asked] for (rows, _), asked in zip(self._tables, limits, strict=True)
        ])  # fmt: skip
        values = np.array([np.concatenate(one) for one in samples])
        found = list[float]()
        for off, edge in zip((values - edges).T, edges.tolist(), strict=True):
            if step.h > SHORT and np.abs(off).max() <= _AT_LIMIT * abs(edge):
                raise SensitivityError(
                    "a spring or an actuator stays at its limit, neither above nor below", step.t, (self._name,)
                )
            # a polynomial whose first coefficient exceeds the sum of the others has no root
            coefficients = _FITTED @ off
            if abs(coefficients[0]) <= np.abs(coefficients[1:]).sum():
                roots = chebroots(coefficients)
                real = 0.5 * (1.0 + roots.real[np.abs(roots.imag) == 0.0])
                found += real[(real > 0.0) & (real < 1.0)].tolist()
        return found


def has_limited_forces(system: System) -> bool:
    """Return whether a system is a mechanism with springs or actuators."""
    return isinstance(system, ArticulatedSystem) and bool(
        system.springs or isinstance(system.control, Actuators | DrivenActuators)
    )


def _unlimited(rows: ForceRows, driven: DrivenActuators | None, t: float, q: Array, v: Array) -> tuple[Array, Array]:
    """Return inputs without their limits, and forces of limited inputs without theirs, each of shape (k,)."""
    if driven is not None:
        driven(t, q, v)
    law, force = rows.law.copy(), np.empty(len(rows.law))
    law[:, _FORCE] = -np.inf, np.inf
    write_row_forces(rows._replace(law=law), 0, plain_array(q), plain_array(v), force)
    return rows.ctrl[0].copy(), force
