"""Which contacts of a step are closed, and are projected out of penetration."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.sparse import csr_array, diags_array

from ...constraints import Rows
from ...constraints.carried import Place, carried_along
from ...constraints.rows import match_contacts
from ...problem import Problem
from ...projection import FreeMotion, Metric, TreeFreeMotion
from ...system.system import Array, System
from ..step import Step, advance_gaps

# two rows whose kinetic angle has a cosine below this are independent
INDEPENDENT = 1e-9
# a contact moves within a step by less than this part of the scene's length
SAME_CONTACT = 0.1


class Applied(NamedTuple):
    """Where in a step of length h a scheme applied the impact law.

    Attributes
    ----------
    t : float
        When [s].
    q, v : ndarray, shapes (nq,) and (nv,)
        Configuration, and velocity before the law.
    h : float
        Length of the step [s].
    motion : FreeMotion or TreeFreeMotion
        Free motion of v.
    opened : ndarray, shape (k,), or None
        Speeds at which rows of the law that are open may close.
    ahead : Rows or None
        What the rows of the law are at the end of the step, in the same order; None where this is not to be used.
    bouncing : ndarray, shape (parts,), or None
        1 for the parts of which it is not to be used either, because some contact may bounce, and 0 for others.
    across : ndarray, shape (nv,), or None
        What is added to the velocity after the law: its part that does not keep the equalities. Free motion and v have
        none then.
    coasts : bool
        Whether bodies move from there as `System.coast` does, and not along the retraction.
    usual : float
        Length of a usual step [s], 0 if it is not known.
    """

    t: float
    q: Array
    v: Array
    h: float
    motion: FreeMotion | TreeFreeMotion
    opened: Array | None = None
    ahead: Rows | None = None
    bouncing: Array | None = None
    across: Array | None = None
    coasts: bool = False
    usual: float = 0.0

    @property
    def judged(self) -> float:
        """The time in which closed contacts hardly move [s]: a shortened step does not tell how fast others leave."""
        return max(self.h, self.usual)

    def end(self, system: System, w: Array, time: float) -> tuple[Array, Array]:
        """Return configuration and velocity a time after the law, which has led to w; shapes (nq,) and (nv,)."""
        displacement, after = system.coast(w, time) if self.coasts else (time * w, w)
        return system.integrate(self.q, displacement), after


def closed_contacts(problem: Problem, applied: Applied, step: Step) -> Array:
    """Return which rows of the law are closed contacts, shape (k,); see `project_positions`."""
    rows, h = step.active, applied.judged
    lever = problem.constraints.levers(rows.constraint)
    rise = h * lever * step.after
    # one that bears load and closes lands within the step
    closed = (np.abs(rise) <= problem.tolerance) | ((rise < 0.0) & (step.percussion > 0.0))
    sunk = stays_sunk(problem, applied, advance_gaps(step, step.t - applied.t).active, step.after, step.before)
    closed |= sunk
    if not rows.restitution.any():
        # without restitution a contact bears load and does not rise, or it leaves
        return np.asarray(closed)
    gap = lever * rows.gap
    # at e = 1 every contact that rises bounces
    rises = (rise > problem.tolerance) & (rows.restitution < 1.0) & (step.percussion > 0.0)
    if rises.any():
        place = problem.system.integrate(applied.q, h * step.v)
        # the lowest gap of each contact after a whole step at the velocity after the law
        ahead = problem.constraints.active(applied.t + h, place, problem.tolerance)
        rows = carried_along(problem.constraints, rows, Place(applied.t, applied.q), Place(applied.t + h, place))
        owner, lowest = match_contacts(ahead, rows), np.full(len(rise), np.inf)
        # not another contact of the same pair, such as the edge of a box that sinks while the other rises
        apart = np.linalg.norm(ahead.point - rows.point[owner], axis=1)
        known = (owner >= 0) & ~(apart > SAME_CONTACT * problem.length)
        np.minimum.at(lowest, owner[known], ahead.gap[known])
        closed |= rises & (lever * lowest <= gap + problem.tolerance)
    if closed.any() and not closed.all():
        # to project a contact of a body that bounces at another contact would make the body rock
        metric, J = applied.motion.metric, rows.jacobian
        bounces = ~closed & ((step.percussion > 0.0) | (gap < -problem.tolerance))
        # but one that stays sunk would do so as long as the body bounces
        landed = closed & ~sunk
        if bounces.any() and landed.any():
            closed[landed] = ~_coupled(metric, J, landed, bounces)
    return closed


def stays_sunk(problem: Problem, applied: Applied, rows: Rows, after: Array, before: Array) -> Array:
    """Return which rows at the end of a step stay in penetration, shape (k,); see the kernel `stays_sunk`.

    `after` and `before`, shape (k,), are the rates of their gaps after and before the law.
    """
    lever, e, tolerance = problem.constraints.levers(rows.constraint), rows.restitution, problem.tolerance
    depth, rise, fall = -lever * rows.gap, applied.judged * lever * after, applied.judged * lever * before
    still = (2.0 * np.abs(rise) < depth) & (depth > -fall)
    return np.asarray((depth > tolerance) & (e < 1.0) & ((e == 0.0) | still))


def bears_or_sinks(problem: Problem, step: Step, drift: float) -> bool:
    """Return whether a row of the law bears load, or is below zero by more than the tolerance after a drift [s]."""
    rows = step.active
    lengths = problem.constraints.levers(rows.constraint) * (rows.gap + drift * step.after)
    return bool((step.percussion > 0.0).any() or lengths.min(initial=0.0) < -problem.tolerance)


def _coupled(metric: Metric, J: Array | csr_array, some: Array, others: Array) -> Array:
    """Return which of the rows `some` are coupled to any of the rows `others` in the kinetic metric, shape (k,).

    Both are masks of the rows of J; k is the number of rows in `some`.
    """
    if isinstance(J, np.ndarray):
        lengths = np.sqrt(np.vecdot(J, metric.solve_rows(J)))
        cosines = np.abs(J[some] @ metric.solve_rows(J[others]).T)
        return np.asarray((cosines > INDEPENDENT * lengths[some][:, None] * lengths[others]).any(axis=1))
    U = metric.whiten_rows(J)
    lengths = np.sqrt((U * U).sum(axis=1))
    unit = diags_array(1.0 / np.where(lengths > 0.0, lengths, 1.0)) @ U
    # nonzero only for rows on the same bodies
    cosines = abs(unit[some] @ unit[others].T).tocoo()
    found = np.zeros(int(some.sum()), bool)
    found[cosines.coords[0][cosines.data > INDEPENDENT]] = True
    return found
