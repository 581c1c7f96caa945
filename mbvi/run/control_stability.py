"""Names controls whose gains are unstable at the step of a run."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import numpy as np

from ..errors import DivergedError, InfeasibleError, MbviError, ProjectionError
from ..problem import Problem
from ..schemes import Step
from ..system import ArticulatedSystem, located_parts
from ..system.control_table import TRACKING
from ..system.controls import LoopControl
from ..system.system import Array
from .opened_loops import opened_loop

# h d + (h w)^2 / 2 below which explicit steps are stable, and its value at the gains and steps that are suggested: in
# other poses it is up to 4 times larger
_BOUND, _SUGGESTED = 2.0, 0.4
# turn of a joint in a step above which its gains are looked at [rad]
TURN = 2.0 * np.pi
# length of the differences that give the gains of a function [m, rad]
_DIFFERENCE = 1e-6


def unstable_gains(
    problem: Problem, h: float, states: Sequence[tuple[float, Array, Array]], *, functions: bool
) -> str | None:
    """Return in words the control that is least stable at a step, with gains and a step that are stable.

    Parameters
    ----------
    problem : Problem
        The problem with its controls.
    h : float
        Time step [s].
    states : sequence of (float, ndarray, ndarray)
        Times, configurations and velocities where controls and mass matrices are linearised.
    functions : bool
        Whether controls that are functions of the user are called for their slope; else only `PDControl` is looked at.

    Returns
    -------
    str or None
        None if all controls are stable there.

    Notes
    -----
    With stiffness K and damping D of a control, an explicit step is stable if all eigenvalues of
    (M + h B)^-1 (h D + h^2 K / 2) are below 2, where B is the damping of the joints, which is implicit.
    """
    worst, words = _BOUND, None
    for part in located_parts(problem.system):
        system = part.system
        if not isinstance(system, ArticulatedSystem) or system.control is None:
            continue
        for t, q, v in states:
            own_q, own_v = q[part.q : part.q + system.nq], v[part.v : part.v + system.nv]
            gains = _gains(system, t, own_q, own_v, functions)
            if gains is None or not all(np.isfinite(one).all() for one in gains):
                continue
            value, found = _least_stable_joint(system, own_q, h, *gains)
            if value >= worst:
                worst, words = value, found
    return words


def _gains(system: ArticulatedSystem, t: float, q: Array, v: Array, functions: bool) -> tuple[Array, Array] | None:
    """Return stiffness and damping of a control, shape (nv, nv); None if it is a function that may not be called."""
    control = system.control
    if isinstance(control, LoopControl) and control.table.kind == TRACKING:
        gains, rows = [], control.table.actuators
        free = np.zeros(system.nv - len(control.table.stiffness))
        for k, one in ((2, control.table.stiffness), (3, control.table.damping)):
            gains.append(np.diag(np.concatenate([free, one])))
            gains[-1][len(free) :, len(free) :] -= rows.moment.T @ (rows.law[:, k : k + 1] * rows.moment)
        return gains[0], gains[1]
    if not functions or control is None:
        return None
    shifts, torque = _DIFFERENCE * np.eye(system.nv), control
    try:
        moved, faster = (
            np.transpose([np.subtract(torque(t, *at(-s)), torque(t, *at(s))) / (2.0 * _DIFFERENCE) for s in shifts])
            for at in (lambda s: (system.integrate(q, s), v), lambda s: (q, v + s))
        )
    except (MbviError, ValueError, ArithmeticError):
        return None
    return moved, faster


def _least_stable_joint(
    system: ArticulatedSystem, q: Array, h: float, stiffness: Array, damping: Array
) -> tuple[float, str]:
    """Return the largest of the eigenvalues, and in words the joint that moves most in its mode."""

    def modes(h: float) -> tuple[Array, Array]:
        mass = system.metric(q).dense() + h * np.diag(system.damping)
        return np.linalg.eig(np.linalg.solve(mass, h * damping + 0.5 * h * h * stiffness))

    values, vectors = modes(h)
    fastest = int(np.argmax(values.real))
    value = float(values.real[fastest])
    if not value >= _BOUND:
        return value, ""
    k, model, shorter = int(np.argmax(np.abs(vectors[:, fastest]))), system.model, 0.5 * h
    while modes(shorter)[0].real.max() > _SUGGESTED:
        shorter *= 0.5
    joint = next(n for n, first in enumerate(model.idx_vs) if n and first <= k < first + model.nvs[n])
    s, d, share = float(stiffness[k, k]), float(damping[k, k]), _SUGGESTED / value
    return value, (
        f"the control of {system.name} is unstable at h = {h:g} s: joint {model.names[joint]} has a stiffness of "
        f"{s:.3g} and a damping of {d:.3g}, and h d + (h w)^2 / 2 = {value:.3g} must be below 2; it is stable with a "
        f"stiffness of {share * s:.2g} and a damping of {share * d:.2g} (all gains times {share:.2g}), or at h = "
        f"{shorter:.1g} s"
    )


def gain_notes(problem: Problem, h: float) -> list[str]:
    """Return a note on a `PDControl` that is unstable in flight at a step of h [s]; none if there is none."""
    # no warning: a robot that stands may bear such gains
    words = unstable_gains(problem, h, [(problem.t0, problem.q0, problem.v0)], functions=False)
    return [] if words is None else [words]


def turned_by_gains(problem: Problem, h: float, t: float, q: Array, v: Array) -> bool:
    """Return whether a joint turns more than once in a step of h [s], and a control is unstable there."""
    swift = any(
        isinstance(part.system, ArticulatedSystem)
        and part.system.control is not None
        and h * np.abs(v[part.v : part.v + part.system.nv]).max(initial=0.0) > TURN
        for part in located_parts(problem.system)
    )
    return swift and unstable_gains(problem, h, [(t, q, v)], functions=True) is not None


@contextmanager
def failures_with_time(problem: Problem, h: float, state: Callable[[], Step]) -> Iterator[None]:
    """Give errors of steps their time, and name the control where its gains are what made the run diverge.

    Parameters
    ----------
    problem : Problem
        The problem that runs.
    h : float
        Time step [s].
    state : callable
        Returns the last state.
    """
    try:
        yield
    except (ProjectionError, DivergedError) as error:
        if isinstance(error, DivergedError) and error.returned:
            raise
        last = state()
        states = (last.t, last.q, last.v), (problem.t0, problem.q0, problem.v0)
        words = unstable_gains(problem, h, states, functions=True)
        if words is not None:
            raise DivergedError(f"the run diverges at t = {last.t:.6g} s: {words} ({error})") from error
        if isinstance(error, ProjectionError):
            error.args = (f"in the step from t = {last.t:.6g} s{_what_to_change(problem, h, last.q, error)}",)
        raise


def _what_to_change(problem: Problem, h: float, q: Array, error: ProjectionError) -> str:
    """Return what a projection that failed concerns, why it failed, and what to change, in words."""
    at = "" if error.constraint is None else f", at {problem.constraints.name(error.constraint)}"
    if isinstance(error, InfeasibleError):
        return f"{at}: {error}{opened_loop(problem, q, h, error)}"
    friction = "a smaller friction or restitution, " if problem.constraints.frictional else ""
    return (
        f"{at}: {error}; shorter parts of the step are not solved either: take a step below {h:g} s, {friction}"
        "or a larger residual"
    )
