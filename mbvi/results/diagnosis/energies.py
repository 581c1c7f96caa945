"""Kinetic and potential energy of the states of a run."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...arguments import watched
from ...errors import InputError
from ...problem import Problem
from ..run_data import Array, RunData, Switch, arriving, by_problem

# differences of configurations that count as rounding; a longer interval than this many steps holds several of them
_ROUNDING, _SAME_STEP = 1e-12, 1.5
# difference of times that counts as zero, in steps
_INSTANT = 1e-6


def energies(
    problem: Problem, t: Array, q: Array, v: Array, h: float, jump: float = 1.0, switches: Sequence[Switch] = ()
) -> Array:
    """Return kinetic and potential energy of each state, shape (n, 2) [J]; see `Trajectory.energies`.

    Parameters
    ----------
    problem : Problem
        System and initial time.
    t, q, v : ndarray, shapes (n,), (n, nq) and (n, nv)
        States.
    h : float
        Time step [s].
    jump : float
        Share of the step after which the velocity jumps.
    switches : sequence of Switch
        Those of the run.
    """
    values = np.empty((len(t), 2))
    # nothing moved with the velocity of a state before the start, and before bodies were attached there
    begins = [problem.t0, *(one.time for one in switches)]
    for part, which in by_problem(problem, switches, t):
        system = part.system
        for i in watched(which.tolist(), "energies"):
            ti, qi, vi = float(t[i]), q[i], v[i]
            shift = max(jump - 0.5, 0.0) * h if ti <= begins[0] or ti in begins else (jump - 0.5) * h
            middle = system.integrate(qi, shift * vi)
            values[i] = system.kinetic_energy(middle, vi), system.potential_energy(ti + shift, middle)
    return values


def energies_of_states(run: RunData) -> Array:
    """Return kinetic and potential energy of each state of a run, shape (n + 1, 2) [J], each by its own q and v.

    Raises
    ------
    InputError
        If the run came from a file without its problem or its energies.
    """
    if run.record.energies is not None:
        return run.record.energies.copy()
    if run.problem is None:
        raise InputError("this file holds neither energies nor a problem to compute them from")
    return energies(run.problem, run.t, run.q, run.v, run.step, run.record.timing.jump, run.record.switches)


def energies_of_run(run: RunData) -> Array:
    """Return the same; where an impact has begun in the last step of a state and goes on, those after it."""
    values = energies_of_states(run)
    return _after_impacts(run, values) if run.record.timing.whole_steps else values


def _after_impacts(run: RunData, values: Array) -> Array:
    """Return energies, shape (n + 1, 2), with those after the impacts that begin in the step before a state.

    Impacts of schemes with `Timing.whole_steps` take two steps, and the mean velocity of the first one lies between
    those before and after: its energy would be that of neither.
    """
    ends = np.array([impact.time for impact in run.impacts])
    changes = np.array([impact.energy_change for impact in run.impacts])
    for i in np.unique(np.searchsorted(run.t, ends - _INSTANT * run.step)).tolist():
        if i < len(run.t) and (np.abs(ends - run.t[i]) < _INSTANT * run.step).any():
            since = (ends > run.t[i - 1] + _INSTANT * run.step) & (ends < run.t[i] + _INSTANT * run.step)
            values[i, 0] = values[i - 1].sum() + changes[since].sum() - values[i, 1]
    return values


def energy_of_projection(problem: Problem, t: float, acted: Array, q: Array, v: Array, rest: float) -> float:
    """Return the energy that a displacement by position projection adds at the end of a step [J].

    Its potential energy, and the change of the kinetic energy at the same velocity: M changes along it.

    Parameters
    ----------
    problem : Problem
        The system.
    t, q, v : float and ndarray, shapes (nq,) and (nv,)
        Time, configuration and velocity after the step.
    acted : ndarray, shape (nq,)
        Configuration where the law was applied.
    rest : float
        Time from there to the end of the step [s].
    """
    reached = problem.system.integrate(acted, rest * v)
    if np.abs(q - reached).max(initial=0.0) <= _ROUNDING * max(1.0, np.abs(q).max(initial=0.0)):
        return 0.0
    system = problem.system
    kinetic = system.kinetic_energy(q, v) - system.kinetic_energy(reached, v)
    return kinetic + system.potential_energy(t, q) - system.potential_energy(t, reached)


def projection_energies(run: RunData) -> Array:
    """Return the energy that position projection added in the step to each state; see `Trajectory.projection_energy`.

    Raises
    ------
    InputError
        If states between the recorded ones are missing, or the run came from a file without its problem.
    """
    added, scheme = np.zeros(len(run.t)), run.record.scheme
    if scheme is None or not getattr(scheme, "project_positions", False):
        return added
    if run.problem is None:
        raise InputError("this file holds no problem, which the energy of position projections needs")
    if (np.diff(run.t) > _SAME_STEP * run.step).any():
        raise InputError("the energy of position projections needs every step: simulate without every=")
    jump, reached = run.record.timing.jump, arriving(run)
    for problem, which in by_problem(run.problem, run.record.switches, run.t[:-1]):
        for i in (which + 1).tolist():
            h = float(run.t[i] - run.t[i - 1])
            acted = problem.system.integrate(run.q[i - 1], jump * h * run.v[i - 1])
            added[i] = energy_of_projection(problem, float(run.t[i]), acted, run.q[i], reached[i], (1.0 - jump) * h)
    return added


def end_energies(run: RunData) -> tuple[float, float] | None:
    """Return the total energy of the first and the last state [J], None where it is not known; costs two states."""
    ends = [0, -1]
    if run.record.energies is not None:
        both = run.record.energies[ends]
    elif run.problem is not None and len(run.t):
        jump = run.record.timing.jump
        both = energies(run.problem, run.t[ends], run.q[ends], run.v[ends], run.step, jump, run.record.switches)
    else:
        return None
    return float(both[0].sum()), float(both[1].sum())
