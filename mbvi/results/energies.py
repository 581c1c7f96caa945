"""Kinetic and potential energy of the states of a run."""

from __future__ import annotations

import numpy as np

from ..errors import InputError
from ..problem import Problem
from .run_data import Array, RunData


def energies(problem: Problem, t: Array, q: Array, v: Array, h: float, jump: float = 1.0) -> Array:
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
    """
    system, values = problem.system, np.empty((len(t), 2))
    for i, (ti, qi, vi) in enumerate(zip(t, q, v, strict=True)):
        # nothing moved before the start
        shift = (jump - 0.5) * h if ti > problem.t0 else max(jump - 0.5, 0.0) * h
        middle = system.integrate(qi, shift * vi)
        values[i] = system.kinetic_energy(middle, vi), system.potential_energy(float(ti) + shift, middle)
    return values


def energies_of_run(run: RunData) -> Array:
    """Return kinetic and potential energy of each state of a run, shape (n + 1, 2) [J].

    Raises
    ------
    InputError
        If the run came from a file without its problem or its energies.
    """
    if run.record.energies is not None:
        return run.record.energies.copy()
    if run.problem is None:
        raise InputError("this file holds neither energies nor a problem to compute them from")
    return energies(run.problem, run.t, run.q, run.v, run.step, run.record.timing.jump)


def end_energies(run: RunData) -> tuple[float, float] | None:
    """Return the total energy of the first and the last state [J], None where it is not known; costs two states."""
    ends = [0, -1]
    if run.record.energies is not None:
        both = run.record.energies[ends]
    elif run.problem is not None and len(run.t):
        jump = run.record.timing.jump
        both = energies(run.problem, run.t[ends], run.q[ends], run.v[ends], run.step, jump)
    else:
        return None
    return float(both[0].sum()), float(both[1].sum())
