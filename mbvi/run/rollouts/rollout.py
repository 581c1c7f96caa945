"""`rollout`: many runs of one problem from given states, in arrays and on several threads."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...arguments import array, function, integer, positive
from ...errors import InputError, UnsuitableError
from ...problem import Problem, check_kept
from ...schemes import OwnStepsScheme, Scheme
from ...system.actuators import Actuators
from ...system.controls import HeldTorque, LoopControl
from ...system.mechanisms.articulated import ArticulatedSystem, Control
from ...system.system import Array
from ..default_scheme import time_stepping
from ..loop.loop_scope import has_user_forces, is_compiled_on_copies
from ..loop.mechanism_run import controlled_copy
from ..simulate import check_problem, checked_for
from .rollout_job import Job


@dataclass(frozen=True)
class Rollouts:
    """States of many runs; those after an error are NaN.

    Attributes
    ----------
    q : ndarray, shape (n, steps + 1, nq)
        Configurations, the initial ones first.
    v : ndarray, shape (n, steps + 1, nv)
        Velocities.
    status : ndarray of int, shape (n,)
        How each ended; see `RolloutStatus`; 0 where all went well.
    errors : tuple
        Of each rollout the error that ended it, or None.
    """

    q: Array
    v: Array
    status: Array
    errors: tuple[Exception | None, ...]


def rollout(
    problem: Problem,
    q0: Array,
    v0: Array,
    *,
    steps: int = 100,
    step: float = 1e-3,
    scheme: Scheme | None = None,
    control: Control | Array | None = None,
    ctrl: Array | None = None,
    threads: int = 1,
) -> Rollouts:
    """Simulate a problem from many initial states.

    Each rollout has the bytes of `simulate(problem.at(q0[i], v0[i], problem.t0), scheme, step=step,
    duration=steps * step)`, whatever the number of threads. Robots and a few bodies run in compiled code.
    Scenes of many bodies, with given constraints or with a control of the whole scene run by `simulate`, one at a time,
    and so does a rollout once more in which all bodies of a scene without robots come to rest.

    Parameters
    ----------
    problem : Problem
        The problem.
    q0, v0 : ndarray, shapes (n, nq) and (n, nv)
        Initial states; see `Problem.at`.
    steps : int
        Number of steps.
    step : float
        Time step h [s].
    scheme : Scheme, optional
        By default that of `simulate` at a given step.
    control : control or ndarray, shape (steps, nv) or (n, steps, nv), optional
        In the place of the robot's own control, where the problem is one robot: `ConstantTorque`, `PDControl`,
        `CompiledControl`, a function control(t, q, v) -> tau, which is slow, or torques that are constant during each
        step, for all rollouts or for each [N, N m].
    ctrl : ndarray, shape (steps, nu) or (n, steps, nu), optional
        Inputs of the robot's actuators that are constant during each step, in the place of those of `Problem.ctrl`.
    threads : int
        Number of threads.

    Returns
    -------
    Rollouts
        States, and how each rollout ended.

    Raises
    ------
    InputError
        If shapes do not fit, numbers of a control are not finite, or step, steps or threads is not positive. An invalid
        initial state fails its own rollout only: one that is not finite, has a quaternion that is not of unit length,
        or a contact deeper than the size of its bodies.
    UnsuitableError
        If the scheme chooses its own steps or cannot run the problem, or a control is given and the problem is more
        than one robot.
    """
    check_problem(problem)
    check_kept(problem)
    steps, threads, h = integer(steps, "steps", 1), integer(threads, "threads", 1), positive(step, "step")
    q0, v0 = _states(q0, "q0", problem.system.nq), _states(v0, "v0", problem.system.nv)
    if len(q0) != len(v0):
        raise InputError(f"q0 has {len(q0)} states and v0 has {len(v0)}; they must be as many")
    chosen = time_stepping(problem)[0] if scheme is None else checked_for(problem, scheme)
    if isinstance(chosen, OwnStepsScheme):
        raise UnsuitableError(f"{chosen.name} chooses its own steps: take a scheme of fixed steps")
    given = _checked(problem, control, ctrl, len(q0), steps)
    acting = problem if given is None else controlled_copy(problem, given)
    # a function of the user may have a memory of its own
    threads = 1 if has_user_forces(acting.system) else threads
    job = Job(problem, acting, chosen, q0, v0, steps, h)
    # the caches of walls that move are not those that jobs save
    still = not acting.constraints.moving
    compiled = still and is_compiled_on_copies(acting, chosen) and job.run_compiled(threads)
    left = job.resting() if compiled else job.valid()
    if left.size:
        job.run_by_simulate(left)
    return Rollouts(job.q, job.v, job.status, tuple(job.errors))


def _states(value: Array, name: str, size: int) -> Array:
    """Return states as an array; their numbers are checked one rollout after the other."""
    try:
        with np.errstate(all="ignore"):
            states = np.array(value, dtype=float)
    except Exception as error:
        raise InputError(f"{name} must be an array of numbers") from error
    if states.ndim != 2 or states.shape[1] != size:
        raise InputError(f"{name} has shape {states.shape}; it must have (n, {size}), one row for each rollout")
    return states


def _checked(
    problem: Problem, control: Control | Array | None, ctrl: Array | None, n: int, steps: int
) -> Control | None:
    """Return the control of all rollouts, which may be given as torques or inputs in each step; None if none is."""
    if control is None and ctrl is None:
        return None
    system = problem.system
    if type(system) is not ArticulatedSystem:
        raise UnsuitableError(
            "rollout takes a control only where the problem is one robot: give that of another scene to add_urdf"
        )
    if ctrl is not None:
        if control is not None or not isinstance(system.control, Actuators):
            raise InputError(
                "ctrl is for a robot whose actuators act: add_mjcf without a control, or a function, of it"
            )
        return system.control.held(_each_step(ctrl, "ctrl", n, steps, len(system.control.names)), steps)
    if isinstance(control, LoopControl):
        return control
    if callable(control):
        return function(control, "control", "control(t, q, v) -> tau")
    return HeldTorque(_each_step(control, "control", n, steps, system.nv), steps)


def _each_step(value: Any, name: str, n: int, steps: int, size: int) -> Array:
    """Return what is given for each step, of all rollouts or of each, one below the other, shape (k, size)."""
    given = array(value, name)
    if given.shape not in ((steps, size), (n, steps, size)):
        what = ("inputs", "nu") if name == "ctrl" else ("torques", "nv")
        raise InputError(
            f"{name} has shape {given.shape}; {what[0]} have ({steps}, {size}) or ({n}, {steps}, {size}): "
            f"(steps, {what[1]}) or (n, steps, {what[1]})"
        )
    return given.reshape(-1, size)
