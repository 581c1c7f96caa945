"""Moves bodies out of each other at the end of a step, with contacts linearised there."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...constraints import Rows
from ...errors import ProjectionError
from ...problem import Problem
from ...projection import Metric, Projector
from ...system.system import Array

# most linearisations of the contacts
_MOST_LINEARISATIONS = 6
# relative KKT residual of displacements, whose depths are measured afterwards
_RESIDUAL = 1e-2
# contacts with a gap up to this multiple of the allowed depth take part, so that nothing is pushed into what is near
_NEAR = 2.0
# contacts deeper than this part of the allowed depth are pushed out, so that they do not sink again at once
_SUNK = 0.1


class Repaired(NamedTuple):
    """A configuration without deep penetration.

    Attributes
    ----------
    q : ndarray, shape (nq,)
        The configuration.
    moved : ndarray, shape (nv,)
        Tangent vector to it from the configuration before.
    rows : Rows
        The rows there with a gap up to twice the allowed depth.
    """

    q: Array
    moved: Array
    rows: Rows


def near_rows(problem: Problem, t: float, q: Array, allowed: float) -> Rows:
    """Return the rows at (t, q) that `repair` uses where no contact may be deeper than `allowed` [m]."""
    return problem.constraints.active(t, q, _NEAR * allowed)


def repair(
    problem: Problem, t: float, q: Array, rows: Rows, metric: Metric, projector: Projector, allowed: float
) -> Repaired:
    """Return the nearest configuration, in the kinetic metric, at which no contact is deeper than allowed.

    The displacement is a projection onto the contacts as they are at its start, rotation included: deep ones are pushed
    out, others get no deeper. Contacts are linearised again until none is deeper than allowed. A projection changes
    only those parts of a heap that the deep contacts push.

    Parameters
    ----------
    problem : Problem
        System and constraints.
    t : float
        Time [s].
    q : ndarray, shape (nq,)
        Configuration.
    rows : Rows
        `near_rows` there.
    metric : Metric
        Kinetic metric.
    projector : Projector
        Its solver is used; its percussions stay as they are.
    allowed : float
        Allowed depth [m].

    Notes
    -----
    Penetration remains where contacts contradict each other, or where six linearisations do not suffice. The run
    records it.
    """
    moved, own = np.zeros(problem.system.nv), Projector(_RESIDUAL, projector.solver)
    for _ in range(_MOST_LINEARISATIONS):
        depth = -problem.constraints.levers(rows.constraint) * rows.gap
        if depth.max(initial=0.0) <= allowed:
            break
        lower = np.where(depth > _SUNK * allowed, -rows.gap, np.minimum(-rows.gap, 0.0))
        try:
            change = own.project(np.zeros_like(moved), metric, rows.jacobian, lower, rows.constraint).velocity
        except ProjectionError:
            break
        q, moved = problem.system.integrate(q, change), moved + change
        rows = near_rows(problem, t, q, allowed)
    return Repaired(q, moved, rows)
