"""The result of one step of a scheme, and the impact law (8) that all schemes apply."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..compiled import kernel, plain_array
from ..constraints import Rows
from ..problem import Problem
from ..projection import FreeMotion, Projector, TreeFreeMotion
from ..projection.positions.travel import largest_of_parts, write_bends
from ..system import System
from ..system.system import Array
from .gap_bounds.reach import parts_of_bodies
from .row_projection import project_rows, slip_rates

# rates of a step without active rows
NO_RATES = np.zeros((4, 0))


class Step(NamedTuple):
    """The state after a step, with the constraints that acted in it.

    Attributes
    ----------
    t : float
        Time [s].
    q : ndarray, shape (nq,)
        Configuration.
    v : ndarray, shape (nv,)
        Velocity.
    active : Rows
        The active constraints at the configuration where the law was applied; for some schemes this is within the
        step. Their gaps are those at q, to first order. With `at_end` they are those at q.
    rates : ndarray, shape (4, k)
        Of each active row the percussion, then three rates of its gap: `percussion`, `free`, `after` and `before`.
    residual : float
        Relative KKT residual of the projection; with friction that of Coulomb's law.
    slip : ndarray, shape (4, k, w), or None
        Of each row the percussion and three velocities along its tangents, in the order of `rates` [N s, m/s]; None
        without friction. With torsional or rolling friction w is 5 (see `Tangents`), else 2.
    at_once : callable or None
        Of a scheme whose impacts last two steps: at_once(impacting) takes the rows whose impact begins in this step,
        shape (k,) of bool, and returns the rates that the law (8) would lead to at once, which records of impacts have.
    correction : ndarray, shape (k, 6), or None
        Of each row what its percussions leave out of the momentum of free bodies, as a force that acts for the time of
        the step and its moment about the origin, on the body that the normal points to [N s, N m s]; see
        `positions.corrections`. None where nothing is left out; further rows have none.
    at_end : bool
        Whether the rows are those at the end of the step, where positions are projected, although the law of the scheme
        may act elsewhere.
    """

    t: float
    q: Array
    v: Array
    active: Rows
    rates: Array
    residual: float
    slip: Array | None = None
    at_once: Callable[[Array], Array] | None = None
    correction: Array | None = None
    at_end: bool = False

    @property
    def percussion(self) -> Array:
        """P >= 0 with M (v - v_before) - h g = J' p, shape (k,) [N s, N m s] (Lemma 3.3 with the sign turned)."""
        return self.rates[0]

    @property
    def free(self) -> Array:
        """Rate of the gap, J v + df/dt, that the forces alone would lead to, shape (k,) [m/s, rad/s]."""
        return self.rates[1]

    @property
    def after(self) -> Array:
        """Rate of the gap after the step, shape (k,) [m/s, rad/s]."""
        return self.rates[2]

    @property
    def before(self) -> Array:
        """Rate of the gap before the step, shape (k,) [m/s, rad/s]."""
        return self.rates[3]


class AppliedLaw(NamedTuple):
    """What the law (8) gives: fields of a `Step`.

    Attributes
    ----------
    velocity : ndarray, shape (nv,)
        Velocity after.
    rates, residual, slip
        See `Step`.
    rows : Rows
        The rows, with the restitution that was used.
    """

    velocity: Array
    rates: Array
    residual: float
    slip: Array | None
    rows: Rows


def law(
    projector: Projector,
    v: Array,
    free_motion: FreeMotion | TreeFreeMotion,
    rows: Rows,
    opened: Array | None = None,
) -> AppliedLaw:
    """Return the velocity after the law (8) with all that a `Step` holds of it.

    e applies to the rate of the gap: argmin |w - x|_M with J w + r >= -e (J v + r), r = df/dt. With friction it is
    Coulomb's law with that bound of the normal rates.

    Parameters
    ----------
    projector : Projector
        Solves the projection.
    v : ndarray, shape (nv,)
        Velocity before.
    free_motion : FreeMotion
        The velocity x that the forces alone would lead to, and M.
    rows : Rows
        The active constraints.
    opened : ndarray, shape (k,), optional
        Speeds at which rows that are open may close; see `closing_speeds`.
    """
    joints = free_motion.friction is not None
    if rows.rate is None and rows.tangents is None and not joints:
        found = projector.law(v, free_motion, rows.jacobian, rows.restitution, rows.constraint, opened)
        return AppliedLaw(*found, None, rows)
    rough = projector.friction.law(free_motion, rows, opened) if rows.tangents is not None and not joints else None
    if rough is not None:
        return AppliedLaw(*rough, rows)
    x, before = free_motion.free, rows.speeds(v)
    e = None
    if opened is None and rows.tangents is not None:
        e = projector.friction.capped_restitution(x, free_motion.metric, rows, before)
    if e is not None:
        rows = rows._replace(restitution=e)
    lower = bounds(rows, before, opened)
    w, percussion, residual, tangential = project_rows(projector, x, free_motion.metric, rows, lower)
    yielding, e_of = projector.friction.yielding, rows.restitution
    if yielding is not None and rows.tangents is not None and rows.tangents.friction.any():
        rows = rows._replace(restitution=np.where(yielding[: len(e_of)], 0.0, e_of))
    rates = np.array([percussion, rows.speeds(x), rows.speeds(w), before])
    return AppliedLaw(w, rates, residual, slip_rates(rows, tangential, x, w, v), rows)


# rows join the law from so many activation tolerances on, where positions are projected: without penetration a contact
# would be active in every other step only, and its body would fall freely in the others
NEAR = 100.0
# rows are looked at up to so many times the estimate of their bend, and up to this part of the scene's length
BENDS, FARTHEST = 8.0, 0.02


class Margins(NamedTuple):
    """How far above the activation tolerance rows may join the law, of each mechanism and free body [m].

    A row has the larger one of its two. Which rows within these margins join, `joins` decides.

    Attributes
    ----------
    still : ndarray, shape (parts,)
        Of rows whose walls do not move along the normal.
    largest : ndarray, shape (parts,)
        Of the others, at least as much: walls that change their speed open gaps, too.
    """

    still: Array
    largest: Array


def near_margins(
    problem: Problem, project_positions: bool, displacement: Array, t: float, q: Array, time: float
) -> Margins:
    """Return how far above the activation tolerance rows may join the law after a displacement, shape (nv,).

    The displacement begins at q, shape (nq,), at t; in `time`, the length of the step, walls change their speed [s].
    """
    constraints = problem.constraints
    margins = np.zeros(constraints.part[-1] + 1)
    if not project_positions:
        return Margins(margins, margins)
    squares = plain_array(constraints.cache.turn_squares)
    write_margins(squares, plain_array(displacement), constraints.part, problem.tolerance, problem.length, margins)
    if not constraints.moving:
        return Margins(margins, margins)
    farther = margins + BENDS * _bends_of_walls(problem, t, q, time)
    return Margins(margins, np.maximum(margins, np.minimum(farther, FARTHEST * problem.length)))


def _bends_of_walls(problem: Problem, t: float, q: Array, time: float) -> Array:
    """Return about how far moving walls leave their tangents in a time, where each part is, shape (parts,) [m]."""
    system, part = problem.system, problem.constraints.part
    bodies, times = np.arange(1, len(system.bodies)), (max(t - time, problem.t0), t, t + time)
    places = system.placements(q, bodies)[:, 3] if len(bodies) else np.zeros((1, 3))
    changes = np.zeros(len(places))
    for family in problem.constraints.families:
        if family.moving:
            # what is not finite is said where it matters
            changes = np.fmax(changes, family.changes_of_walls(times, q, places))
    bends = np.zeros(part[-1] + 1)
    owners = parts_of_bodies(system, part) if len(bodies) else part
    np.maximum.at(bends, owners, 0.5 * time * changes)
    return bends


@kernel("void(f8[:,::1], f8[::1], i8[::1], f8, f8, f8[::1])")
def write_margins(
    squares: Array, displacement: Array, part: Array, tolerance: float, length: float, margins: Array
) -> None:
    """Write the margins of `near_margins`, where the gaps of parts bend as `write_bends` says."""
    write_bends(squares, displacement, part, margins)
    for p in range(len(margins)):
        margins[p] = max((NEAR - 1.0) * tolerance, min(BENDS * margins[p], FARTHEST * length))


@kernel("b1(f8, f8, f8, f8, f8, f8)")
def joins(gap: float, change: float, e: float, lever: float, tolerance: float, by_walls: float) -> bool:
    """Return whether a row within the margin joins the law.

    It does if it is very near, or if it may have opened by the bend of its path alone: then it was closed at the start
    of the step, and `change`, that of a step at the rate of the end, is twice the gap. A good deal less and more is
    allowed, down to bodies that do not move. One with e = 1 must hardly move: to brake it before it bounces would take
    energy. `lever` makes lengths of both. A change of up to `by_walls` [m] is what walls that move explain.
    """
    bent = abs(change - 2.0 * gap) <= 2.5 * gap or lever * abs(change) <= by_walls
    return lever * gap <= NEAR * tolerance or (bent and (e < 1.0 or lever * abs(change) <= tolerance))


def joining(problem: Problem, rows: Rows, margins: Margins, change: Array) -> Array:
    """Return which rows join the law, shape (k,): those within their `near_margins` that `joins` takes.

    `change`, shape (k,), is as of `joins`. At walls that move it may also be what the walls themselves explain: where
    their acceleration changes its sign it is not about twice the gap.
    """
    part, lever = problem.constraints.part, problem.constraints.levers(rows.constraint)
    lengths = lever * rows.gap
    own = largest_of_parts(rows.jacobian, part, margins.still)
    bent = np.abs(change - 2.0 * rows.gap) <= 2.5 * rows.gap
    if rows.rate is not None and margins.largest is not margins.still:
        largest = np.where(rows.rate != 0.0, largest_of_parts(rows.jacobian, part, margins.largest), own)
        # at a constant speed of the wall it is as at rest
        bent |= lever * np.abs(change) <= largest - own
        own = largest
    bent &= (rows.restitution < 1.0) | (lever * np.abs(change) <= problem.tolerance)
    return np.asarray((lengths <= problem.tolerance + own) & (bent | (lengths <= NEAR * problem.tolerance)))


@kernel("b1(f8[::1], f8[::1], f8[::1], f8, f8, f8[::1])")
def write_closing_speeds(gap: Array, lever: Array, change: Array, time: float, tolerance: float, opened: Array) -> bool:
    """Write the speeds of `closing_speeds`, shape (k,); return whether there are any.

    The other arrays have shape (k,) too: gaps, the factors that make lengths of them, and their change.
    """
    some = False
    for a in range(len(gap)):
        there = lever[a] * (gap[a] + change[a])
        opened[a] = max(gap[a], 0.0) / time if there > tolerance else 0.0
        some = some or opened[a] != 0.0
    return some


def closing_speeds(problem: Problem, rows: Rows, time: float, change: Array | float = 0.0) -> Array | None:
    """Return the speeds at which rows above the activation tolerance close within a time [s], 0 for others, shape (k,).

    `change` is that of the gaps to where the tolerance counts. None if there are no such rows, as where
    `near_margins` are 0.
    """
    gap = plain_array(rows.gap)
    lever, opened = np.ones(len(gap)) * problem.constraints.levers(rows.constraint), np.empty(len(gap))
    change = plain_array(change) if isinstance(change, np.ndarray) else np.full(len(gap), change)
    return opened if write_closing_speeds(gap, lever, change, time, problem.tolerance, opened) else None


def bounds(rows: Rows, before: Array, opened: Array | None) -> Array:
    """Return the least J w of Newton's law, shape (k,): -e times the rate before, and less for rows that stay open."""
    lower = -rows.restitution * before
    if opened is not None:
        # what closes within the step by its own speed has its impact now
        lower = np.where((opened > 0.0) & (before > -opened), np.minimum(lower, -opened), lower)
    return lower if rows.rate is None else lower - rows.rate


# closing speed below which a row counts as still [lengths of the scene per second, rad/s]
STILL = 1e-12


def closes(rates: Array, still: Array | float) -> Array:
    """Return which rows close, shape (k,).

    A row closes if it has a percussion and its gap fell before the law, faster than `still` plus twice what the forces
    of the step explain.
    """
    percussion, free, _, before = rates
    return np.asarray((percussion > 0.0) & (before + 2.0 * np.abs(free - before) < -still))


def still_rates(problem: Problem, numbers: Array) -> Array | float:
    """Return the closing speed below which each row counts as still, shape (k,) or one for all [m/s, rad/s]."""
    return STILL * problem.length / problem.constraints.levers(numbers)


def advance_gaps(step: Step, time: float) -> Step:
    """Return the step with its gaps advanced by a time at the rates after the law, to first order."""
    return step._replace(active=step.active._replace(gap=step.active.gap + time * step.after))


def coasted(system: System, step: Step, time: float) -> Step:
    """Return the step with its state moved on for a time; see `System.coast`."""
    displacement, v = system.coast(step.v, time)
    return step._replace(q=system.integrate(step.q, displacement), v=v)


def end_at(system: System, state: Step, steps: list[Step], t: float) -> tuple[list[Step], Step]:
    """Return the steps from a state up to a time, the last of them interpolated along the retraction.

    Parameters
    ----------
    system : System
        The system that moves.
    state : Step
        Where the first step starts.
    steps : list of Step
        Steps of a scheme with `Timing.jump` = 0, the last of which ends at t or later.
    t : float
        Time [s].
    """
    k = next((k for k, step in enumerate(steps) if step.t >= t), len(steps) - 1)
    start, end = steps[k - 1] if k else state, steps[k]
    displacement = system.difference(start.q, end.q)
    q = system.integrate(start.q, min(1.0, (t - start.t) / (end.t - start.t)) * displacement)
    return steps[:k], advance_gaps(end._replace(t=t, q=q), t - end.t)
