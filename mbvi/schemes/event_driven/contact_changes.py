"""Events of the event-driven integrator: which contacts touch, bounce, come to rest and stay closed."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...projection import FreeMotion, Metric
from ...system.system import Array
from .finding.release_events import STAYS, complementarity
from .friction import changes
from .impact_event import ImpactEvent
from .motion_state import NO_ROWS, MotionState, certain_rates
from .rows.few_rows import few_rows, held_rows
from .rows.row_sets import members, union, without
from .runge_kutta import velocity_change

# height of a bounce that is put to rest, in lengths of the scene, and of features in roundings of the gap: landings of
# these are found so late that they land as fast again
_BOUNCE, _ROUNDED = 1e-14, 10.0
# impacts accumulate if less than this time lies between them [s], and if no gap opens in between by more than this many
# times `MotionState.touching`; they are then followed as single impacts
_MOST_TIME_BETWEEN, _MOST_OPENING = 1e-5, 1e3
# most impacts of the same rows at one time
_MOST_REPEATED = 20
# single impacts after which their limit counts as reached
_MOST_SINGLE = 10_000


def touching_rows(state: MotionState, known: Array, changed: Array) -> Array:
    """Return the rows that touch, among all near rows and those `known` to take part in the event.

    Features are also sought of those pairs with closed ones that have `changed`.

    Of many points of one shape few are returned; `state.all_touching` receives all of them.
    """
    near = state.closing.within(state.t, state.q, 10 * state.touching)
    near = union(near, known)
    gaps = state.rows.gaps(state.t, state.q, near) * state.rows.lever[near]
    near, gaps = near[gaps <= 10 * state.touching], gaps[gaps <= 10 * state.touching]
    touches = (gaps <= state.touching) | members(near, known)
    kept = state.closed[~members(state.rows.pair[state.closed], changed)]
    near, gaps = near[touches], gaps[touches]
    featured = state.rows.with_features(state.q, near, kept, state.touching)
    if featured is not near:
        near, gaps = featured, state.rows.gaps(state.t, state.q, featured) * state.rows.lever[featured]
    # a gap above rounding that rises belongs to a later event, if to any
    opening = (gaps > state.rows.rounding[near] * state.rows.lever[near]) & ~members(near, state.closed)
    if opening.any():
        J = state.rows.gradients(state.t, state.q, near[opening])
        opening[opening] = J @ state.v > certain_rates(J, state.v, state.slow(near[opening]))
    state.all_touching = near[~opening]
    # at the start all rows are known, but none closes
    closing = without(known, state.closed) if len(known) <= len(state.closed) + 1 else NO_ROWS
    return few_rows(state.rows, state.t, state.q, state.all_touching, closing)


def change_contacts(state: MotionState, touching: Array, lasting: Array = NO_ROWS) -> Iterator[ImpactEvent]:
    """Apply the law (8) if a touching row closes, then find the contacts that stay closed.

    Parameters
    ----------
    state : MotionState
        Receives the velocity and the closed rows.
    touching : ndarray of int, shape (k,)
        Rows that touch.
    lasting : ndarray of int
        The pairs that were closed up to the event.

    Yields
    ------
    ImpactEvent
        The impacts: none, or one, and others that follow at once.
    """
    was_closed, state.closed, state.held = members(touching, state.closed), NO_ROWS, NO_ROWS
    if state.modes is not None:
        state.modes.undecided = False
    if not touching.size:
        return
    state.rows.check(state.t, state.q, touching)
    state.event_rows = touching
    J, metric = state.rows.gradients(state.t, state.q, touching), state.system.metric(state.q)
    e, before = state.rows.restitution[touching], J @ state.v
    still = certain_rates(J, state.v, state.slow(touching))
    closes = before < -still
    if closes.any() and lasting.size:
        # where the nearest point of a pair moves without jumps, a change of its features is no impact
        pairs = state.rows.pair[touching]
        closes &= (pairs == touching) | ~state.rows.smooth[pairs] | ~members(pairs, lasting)
    for _ in range(_MOST_REPEATED):
        if not closes.any():
            break
        if state.modes is not None:
            rows = state.rows.rows(state.t, state.q, touching)
            yield state.observed.impact(changes.strike(state, rows, metric))
        else:
            yield state.observed.impact(_impact(state, touching, was_closed, J, metric, still))
        # the law lets rows that opened close at up to e times their speed: they strike next
        opened, before = before > still, J @ state.v
        closes = opened & (before < -still)
    rest = _resting(state, touching, J, metric, e, still)
    if not rest.size:
        return
    if state.modes is not None:
        state.closed = changes.settle(state, state.modes, rest)
    else:
        kept = J[members(touching, rest)]
        state.v = state.v + velocity_change(metric, kept, -(kept @ state.v))
        forces, opening = complementarity(state.flow, state.projector, state.t, state.q, state.v, rest)
        # a contact that other contacts keep closed without its own force stays closed too: it cannot open on its own
        state.closed = rest[(forces > 0.0) | (opening <= STAYS)]
    held = held_rows(state.rows, state.t, state.q, state.all_touching, state.closed)
    # of a pair whose features are closed the gap is watched by `first_feature_change`
    state.held = union(held, state.feature_pairs())


def _impact(
    state: MotionState, touching: Array, was_closed: Array, J: Array, metric: Metric, still: Array
) -> ImpactEvent:
    """Apply the law (8) to the touching rows, or single impacts where impacts accumulate."""
    v, e = state.v, state.rows.restitution[touching]
    before = J @ v
    # the largest distance that a gap has opened since the last impact; if it is tiny, impacts accumulate
    since = state.t - state.impact_time
    opened = since * float((state.rows.lever[touching] * np.abs(before)).max())
    one_by_one = len(touching) > 1 and not was_closed.any() and 0.0 < since < _MOST_TIME_BETWEEN
    if one_by_one and opened < _MOST_OPENING * state.touching:
        state.v, percussion = _single_impacts(v, J, metric.solve_rows(J), e, still)
    else:
        state.v, rates, residual = state.projector.law(v, FreeMotion(v, metric), J, e)
        percussion, state.residual = rates[0], residual
    state.impact_time = state.t
    point, normal = state.rows.points(state.t, state.q, touching)
    rates = np.array([percussion, before, J @ state.v])
    event = ImpactEvent(state.t, state.q, v, state.v, state.rows.number[touching], rates, point, normal)
    return event


def _resting(state: MotionState, touching: Array, J: Array, metric: Metric, e: Array, still: Array) -> Array:
    """Return the touching rows that rest: their rate is zero or negative, or their bounces are too small to follow."""
    rates = J @ state.v
    free, _, _, wanted, _ = state.flow.contact_equations(state.t, state.q, state.v, touching)
    smooth = state.rows.smooth[touching]
    sure = (rates <= still) & smooth
    features = touching >= len(state.rows.all)
    least = np.maximum(_BOUNCE * state.problem.length, _ROUNDED * features * state.rows.rounding[touching])
    flat = state.rows.lever[touching] * rates**2, 2.0 * least
    rest = sure
    # the contact forces of rows that rest act on the others, so that more of them may rest
    while True:
        acceleration = free
        if rest.any() and state.modes is not None:
            acceleration = changes.accelerations(state, state.modes, touching[rest])
        elif rest.any():
            acceleration = state.projector.project(free, metric, J[rest], wanted[rest]).velocity
        pull = np.minimum(J @ acceleration - wanted, 0.0)
        # a contact that the forces close rests if all its bounces last less time than the tolerance, or rise less than
        # `_BOUNCE` or `_ROUNDED` says
        brief = 2.0 * rates <= state.tolerance * -pull * (1.0 - e)
        low = (pull < 0.0) & (brief | (flat[0] <= flat[1] * -pull)) & smooth
        if not (low & ~rest).any():
            return np.asarray(touching[rest])
        rest = rest | low


def _single_impacts(v: Array, J: Array, inverse_mass_rows: Array, e: Array, still: Array) -> tuple[Array, Array]:
    """Return the velocity after single impacts until no row closes, and the sums of their percussions.

    Each single impact is that of the row that closes fastest in the kinetic metric.

    `inverse_mass_rows` are the rows J M^-1, shape (k, nv).
    """
    diagonal, percussion = np.einsum("ij,ij->i", J, inverse_mass_rows), np.zeros(len(e))
    scaled = still / np.sqrt(diagonal)
    for _ in range(_MOST_SINGLE):
        rates = J @ v
        normal = rates / np.sqrt(diagonal) + scaled
        a = int(normal.argmin())
        if normal[a] >= 0.0:
            break
        p = -(1.0 + e[a]) * rates[a] / diagonal[a]
        percussion[a] += p
        v = v + p * inverse_mass_rows[a]
    return v, percussion
