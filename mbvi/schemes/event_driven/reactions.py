"""Reactions of closed contacts over a stride of the smooth motion."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...projection import Projector
from ...system.system import Array
from ..step import closes, still_rates
from .integrator import EventDrivenIntegrator
from .release_events import complementarity
from .runge_kutta import RungeKuttaStep

# Gauss's nodes and weights on a stride: exact for polynomials of degree seven, as its dense output
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)


def reactions(walk: EventDrivenIntegrator, stride: RungeKuttaStep) -> Iterator[tuple[Array, Array, Array, Array]]:
    """Yield constraint, point, normal and percussion of what pressed during the stride that a motion just took.

    The percussions of all that is yielded add up to the integral of the reactions over the stride. Where contacts
    depend on each other they share it by the least percussions that are not negative.
    """
    step, closed = walk.fallback, walk.closed
    if stride.h <= 0.0:
        return
    if step is not None:
        # an impact has all the percussions of its step
        if not closes(step.rates, still_rates(walk.problem, step.active.constraint)).any():
            yield step.active.constraint, step.active.point, step.active.normal, step.percussion
    elif closed.size:
        # a projector of its own: what another remembers may change the rounding of the motion
        projector = Projector(walk.projector.residual, walk.projector.solver)
        for node, weight in zip(0.5 * (1.0 + _NODES), 0.5 * _WEIGHTS * stride.h, strict=True):
            t, (q, v) = stride.t + node * stride.h, stride.at(walk.system, node)
            press, _ = complementarity(walk.flow, projector, t, q, v, closed)
            yield walk.rows.number[closed], *walk.rows.points(t, q, closed), weight * press
