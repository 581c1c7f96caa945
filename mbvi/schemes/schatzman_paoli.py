"""The position-level scheme of M. Schatzman and L. Paoli, on configuration manifolds."""

from __future__ import annotations

from functools import partial

import numpy as np

from ..constraints import Rows
from ..constraints.rows import concatenate, match_contacts, take
from ..errors import ProjectionError
from ..problem import Problem
from ..projection import Metric, Projector
from ..system.system import Array
from .scheme import Scheme, Timing, refuse_friction
from .step import NO_RATES, Step

# most linearisations of K within a step
_MOST_LINEARISATIONS = 20


class SchatzmanPaoli(Scheme):
    """q_{i+1} = -e q_{i-1} + (1 + e) Proj_K((2 q_i - (1 - e) q_{i-1} + h^2 M^-1 g) / (1 + e)), in increments.

    With h v_i the tangent vector from q_{i-1} to q_i and p(w) = q_i + h (w - e v_i) / (1 + e) along the retraction:
    v_{i+1} = argmin |w - v_i - h M^-1 g|_M subject to f(p(w)) >= 0, M and g at q_i; q_{i+1} = q_i + h v_{i+1}. In R^d
    the two are the same; here each f_a may have its own e. K is linearised at p(w) of the last w, repeatedly, until
    p(w) is in K to within the activation tolerance. The first step is q_1 = q_0 + h v_0 + h^2 M^-1 g / 2.

    Notes
    -----
    Order 1. Position level: p(w) is in K, so that resting contacts do not drift and penetration does not add up. An
    impact takes two steps, between which q may be up to h |v-| inside, and v, the mean velocity of the step before,
    lies between those before and after. The record of an impact holds what the law (8) leads to at once, and the energy
    of that state is the one after it. Any e in [0, 1], one per constraint, across those two steps. At e = 1 an impact
    changes the energy by up to h |g| |v|, up or down. Several constraints at once by the projection onto K.

    A step evaluates M and g once. It evaluates the gaps twice in free flight, and about six times together with the
    gradients where a constraint is active.

    The form above holds for steps of equal length, because the second step of an impact reflects the displacement of
    the first. A run therefore takes whole steps only: the last one goes beyond the end of the run, and the state at the
    end is interpolated. Where a step must be shorter so that no body passes through another, `shortened` is used.

    Schatzman and Paoli, Mouvement a un nombre fini de degres de liberte avec contraintes unilaterales (1993); Paoli and
    Schatzman, A numerical scheme for impact problems I, II (2002).
    """

    timing = Timing(jump=0.0, whole_steps=True)

    def check(self, problem: Problem) -> None:
        """Raise `UnsuitableError` if the problem has friction."""
        refuse_friction(problem, self, "its projection onto K acts on positions")

    def step(self, problem: Problem, t: float, q: Array, v: Array, h: float, projector: Projector) -> Step:
        """Return the state at t + h; see `Scheme`."""
        system = problem.system
        # v_i is the mean velocity of the step before; v_0 is the velocity at t0 itself, so that half a step is left
        free = system.free_velocity(t, q, v, 0.5 * h if t == problem.t0 else h)
        rows = _rows_at_p(problem, t + h, q, v, free, h, problem.tolerance)
        if rows is None:
            empty = problem.constraints.empty
            return Step(t + h, system.integrate(q, h * free), free, empty, NO_RATES, 0.0)
        w, found, lower, metric = free, [rows], np.zeros(0), system.metric(q)
        deepest = float(-rows.gap.min())
        for _ in range(_MOST_LINEARISATIONS):
            # f(p(w)) >= 0, linearised at the present w; rows of earlier linearisations are kept
            last = found[-1]
            lower = np.concatenate([lower, last.jacobian @ w - (1.0 + last.restitution) / h * last.gap])
            rows = concatenate(found)
            w, percussion, residual = projector.project(free, metric, rows.jacobian, lower)
            more = _rows_at_p(problem, t + h, q, v, w, h, -problem.tolerance)
            if more is None:
                break
            found.append(more)
        else:
            left = float(-found[-1].gap.min())
            raise ProjectionError(
                f"the projection onto K at t = {t:.6g} s still leaves {left:.1e} of {deepest:.1e} after "
                f"{_MOST_LINEARISATIONS} linearisations: take a smaller step than h = {h:g} s",
                {"x": free, "M": metric.dense(), "J": rows.jacobian, "lower": lower},
                left / deepest,
            )
        J, e = rows.jacobian, rows.restitution
        after, before = rows.speeds(w), rows.speeds(v)
        # gaps at the end of the step; the lower bounds belong to p(w)
        gap = h * (J @ w - lower) / (1.0 + e) + h * e * (after + before) / (1.0 + e)
        rates = np.array([percussion, rows.speeds(free), after, before])
        at_once = partial(_law_at_once, metric, free, rows, rates)
        rows = rows._replace(gap=gap)
        return Step(t + h, system.integrate(q, h * w), w, rows, rates, residual, at_once=at_once)

    def shortened(self, problem: Problem, t: float, state: Step, h: float, projector: Projector) -> Step:
        """Return the state at t + h, where h differs from the length of the step that led to `state`.

        The law (8) on velocities, J w >= -e J v, for all contacts that are active at t or would be at t + h. Where
        `state` lies between the two steps of an impact, v is the velocity before the impact. Penetration is removed by
        a displacement that does not enter the velocity, so that steps of equal length can follow.

        Parameters
        ----------
        problem : Problem
            System, admissible set and restitution.
        t : float
            Time [s].
        state : Step
            The state at t.
        h : float
            Time step [s].
        projector : Projector
            Solves the projections.
        """
        system, q, v = problem.system, state.q, state.v
        free_motion = system.free_motion(t, q, v, h)
        free = free_motion.free
        rows = problem.constraints.active(t, q, problem.tolerance)
        ahead = problem.constraints.active(t + h, system.integrate(q, h * free), problem.tolerance)
        new = match_contacts(ahead, rows) < 0
        # gaps at t
        gap = np.concatenate([rows.gap, (ahead.gap - h * ahead.speeds(free))[new]])
        rows = concatenate([rows, take(ahead, new)]) if new.any() else rows
        if not rows.gap.size:
            return Step(t + h, system.integrate(q, h * free), free, rows, NO_RATES, 0.0)
        before, owner = rows.speeds(v), match_contacts(rows, state.active)
        impacting = (owner >= 0) & (np.append(state.percussion, 0.0)[owner] > 0.0)
        incoming = np.where(impacting, np.minimum(before, np.append(state.before, 0.0)[owner]), before)
        rate = 0.0 if rows.rate is None else rows.rate
        w, percussion, residual = projector.project(
            free, free_motion.metric, rows.jacobian, -rows.restitution * incoming - rate
        )
        displacing, _, error = projector.project(w, free_motion.metric, rows.jacobian, -gap / h - rate)
        rates = np.array([percussion, rows.speeds(free), rows.speeds(w), incoming])
        rows = rows._replace(gap=gap + h * rows.speeds(displacing))
        return Step(t + h, system.integrate(q, h * displacing), w, rows, rates, max(residual, error))


def _law_at_once(metric: Metric, free: Array, rows: Rows, rates: Array, impacting: Array) -> Array:
    """Return what `Step.at_once` does, for a step with these rows and rates.

    Rows whose impact began in the step before reach -e times the speed before it in this one, and keep that.
    """
    percussion, _, after, before = rates
    rebound = -rows.restitution * before
    lower = np.where(impacting[: len(before)], rebound, np.where(percussion > 0.0, after, np.minimum(after, rebound)))
    # a projector of its own, so that what is recorded changes nothing
    lower = lower if rows.rate is None else lower - rows.rate
    w, percussion, _ = Projector().project(free, metric, rows.jacobian, lower)
    return np.array([percussion, rows.speeds(free), rows.speeds(w), before])


def _rows_at_p(problem: Problem, t: float, q: Array, v: Array, w: Array, h: float, least: float) -> Rows | None:
    """Return the rows with f(p(w)) <= least, or None; p(w) depends on e, and each row is evaluated at that of its e."""

    def at(e: float) -> Rows:
        # p(w) is a weighted mean of the configurations at t and, with weight e, at t - 2 h
        place = problem.system.integrate(q, h / (1.0 + e) * (w - e * v))
        return problem.constraints.active(t - 2.0 * h * e / (1.0 + e), place, problem.tolerance)

    # p(w) of every e lies between p(w) of e = 0 and of e = 1
    ends = {e: at(e) for e in (0.0, 1.0)}
    known = np.unique(np.concatenate([rows.restitution for rows in ends.values()]))
    found = []
    for e in known.tolist():
        rows = ends[e] if e in ends else at(e)
        found.append(take(rows, (rows.restitution == e) & (rows.gap <= least)))
    found = [rows for rows in found if rows.gap.size]
    return concatenate(found) if found else None
