"""What contacts with friction do at an event: impacts, and which contacts stay closed, stick and slip."""

from __future__ import annotations

import numpy as np

from ....constraints.rows import Rows
from ....projection import FreeMotion, Metric
from ....system.system import Array
from ...contact_friction import friction_of
from ...step import Step, law
from ..finding.release_events import STAYS
from ..impact_event import ImpactEvent
from ..motion_state import MotionState
from ..runge_kutta import velocity_change
from .decision import decide
from .modes import STILL, ContactModes

# slip that counts as none where no contact has just stopped, relative to the sum of its terms: more than what the
# solver of the law leaves
_STILL = 1e-10


def strike(state: MotionState, rows: Rows, metric: Metric) -> ImpactEvent:
    """Apply the law (8), with friction Coulomb's law, to rows that touch."""
    v = state.v
    applied = law(state.projector, v, FreeMotion(v, metric), rows)
    state.v, state.residual, state.impact_time = applied.velocity, applied.residual, state.t
    used, rates = applied.rows, applied.rates[[0, 3, 2]]
    friction = friction_of(Step(state.t, state.q, state.v, used, applied.rates, applied.residual, applied.slip))
    contacts = used.constraint, rates, used.point, used.normal
    return ImpactEvent(state.t, state.q, v, state.v, *contacts, friction, used.restitution)


def accelerations(state: MotionState, modes: ContactModes, rest: Array) -> Array:
    """Return dv/dt where some rows rest."""
    equations = modes.equations(state.t, state.q, state.v, rest)
    found = decide(equations, np.linalg.norm(equations.slip, axis=1) > _still(state, modes, equations.still))
    return equations.normals.free if found is None else found.acceleration


def settle(state: MotionState, modes: ContactModes, rest: Array) -> Array:
    """Stop what rests, choose the modes of resting rows, and return those that stay closed."""
    equations = modes.equations(state.t, state.q, state.v, rest)
    slides = np.linalg.norm(equations.slip, axis=1) > _still(state, modes, equations.still)
    kept = np.concatenate([equations.normals.J, equations.T[~slides & (equations.mu > 0.0)].reshape(-1, len(state.v))])
    kept = kept[kept.any(axis=1)]
    state.v = state.v + velocity_change(equations.normals.metric, kept, -(kept @ state.v))
    equations = modes.equations(state.t, state.q, state.v, rest)
    found = decide(equations, slides)
    modes.stopped, modes.undecided, modes.begins = -1, found is None, False
    if found is None:
        modes.choose(rest, np.zeros(len(rest), bool), np.zeros((len(rest), 3)))
        return rest
    closed = found.closed | (found.opening <= STAYS)
    modes.begins = bool((closed & ~found.sticks & ~slides & (equations.mu > 0.0)).any())
    modes.choose(rest[closed], found.sticks[closed], np.vecmat(found.way, equations.axes)[closed])
    return rest[closed]


def _still(state: MotionState, modes: ContactModes, rounding: Array) -> Array:
    """Return sizes of slips that count as none, shape (k,) [m/s]."""
    if modes.stopped < 0:
        return _STILL / STILL * rounding
    speed = float(np.abs(state.v / state.units).max(initial=1.0))
    return np.full(len(rounding), 0.5 * state.tolerance * state.problem.length * speed)
