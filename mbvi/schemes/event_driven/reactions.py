"""Percussions of closed contacts: the integral of their forces over a smooth step."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from ...projection import Projector
from ..contact_friction import friction_of
from .finding.release_events import complementarity
from .friction.forces import contact_forces
from .motion_state import MotionState
from .runge_kutta import RungeKuttaStep

# Gauss's nodes and weights on a step: exact for polynomials of degree seven, the degree of the dense output
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)


def reactions(state: MotionState, step: RungeKuttaStep) -> Iterator[tuple[Any, ...]]:
    """Yield constraint, point, normal, percussion and friction of the contacts of the step that was just taken.

    The percussions add up to the integral of the contact forces over the step. Where contacts depend on each other, the
    integral is split into the least percussions that are not negative.

    Parameters
    ----------
    state : MotionState
        The state at the end of the step.
    step : RungeKuttaStep
        The step.
    """
    fallback, closed = state.fallback, state.closed
    if step.h <= 0.0:
        return
    if fallback is not None:
        # where the step has an impact, that holds all percussions of the step
        active = fallback.active
        if not state.strikes:
            yield active.constraint, active.point, active.normal, fallback.percussion, friction_of(fallback)
    elif closed.size and state.modes is not None:
        for node, weight in zip(0.5 * (1.0 + _NODES), 0.5 * _WEIGHTS * step.h, strict=True):
            t, (q, v) = step.t + node * step.h, step.at(state.system, node)
            normal, friction = contact_forces(state.rows, state.modes, (t, q, v), closed, weight)
            yield state.rows.number[closed], *state.rows.points(t, q, closed), normal, friction
    elif closed.size:
        # a separate projector: further calls of the integrator's would change its warm starts, and so its rounding
        projector = Projector(state.projector.residual, state.projector.solver)
        for node, weight in zip(0.5 * (1.0 + _NODES), 0.5 * _WEIGHTS * step.h, strict=True):
            t, (q, v) = step.t + node * step.h, step.at(state.system, node)
            forces, _ = complementarity(state.flow, projector, t, q, v, closed)
            yield state.rows.number[closed], *state.rows.points(t, q, closed), weight * forces
