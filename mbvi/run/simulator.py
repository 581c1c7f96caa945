"""`Simulator`: a problem that is stepped from outside, for control loops and reinforcement learning."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ..arguments import boolean, integer, positive, shown
from ..constraints.contact import Contact
from ..errors import InputError
from ..problem import Problem, check_kept
from ..scene.connected.switched import attached, released, switched
from ..schemes import OwnStepsScheme, Scheme, Step
from ..schemes.observer import contacts_of_step
from ..system.system import Array
from .accuracy import projector_of
from .default_scheme import time_stepping
from .fixed_steps.switching import connected_at
from .loop.loop_scope import is_compiled_on_copies
from .loop.mechanism_run import MechanismRun, OwnProblem
from .own_steps.stepping import OwnStepper
from .simulate import check_problem, checked_for, steps_from
from .start import initial_step

_MOST_STEPS = 10**9


class Simulator:
    """A problem stepped from outside, with the states that `simulate` gives at the same times.

    Parameters
    ----------
    problem : Problem
        The problem; its own controls act.
    scheme : Scheme, EventDriven or Adaptive, optional
        By default that of `simulate` at a given step.
    step : float
        Time step h [s]. `EventDriven` and `Adaptive` take as many steps of their own within it as their tolerance asks
        for, and end one at its end.

    Attributes
    ----------
    q, v : ndarray, shapes (nq,) and (nv,)
        Present configuration and velocity, read-only; the same arrays are written at every step.

    Raises
    ------
    InputError
        If h is not positive and finite.
    UnsuitableError
        If the scheme cannot run the problem.

    Notes
    -----
    Bodies do not sleep here, so that bodies at rest differ from those of `simulate` by rounding. So do scenes with
    given constraints, or a control of the whole scene, that `simulate` takes in compiled code. States of `EventDriven`
    and `Adaptive` differ within the tolerance. What is written to a control between steps acts from then on.
    """

    def __init__(self, problem: Problem, scheme: Scheme | OwnStepsScheme | None = None, *, step: float) -> None:
        check_problem(problem)
        check_kept(problem)
        chosen = time_stepping(problem)[0] if scheme is None else checked_for(problem, scheme)
        h = positive(step, "step")
        self._scheme, self._h, self._first = chosen, h, problem
        self._take(problem, _stepper(problem, chosen, h))
        self.reset()

    def _take(self, problem: Problem, stepper: _PythonStepper | _CompiledStepper | OwnStepper) -> None:
        """Step a problem from now on."""
        self._given, self._stepper = problem, stepper
        self.q, self.v = self._stepper.q.view(), self._stepper.v.view()
        self.q.flags.writeable = self.v.flags.writeable = False

    @property
    def t(self) -> float:
        """Time [s]."""
        return self._t0 + self._stepper.done * self._h

    def reset(
        self, q: Array | Sequence[float] | None = None, v: Array | Sequence[float] | None = None, t: float | None = None
    ) -> tuple[Array, Array]:
        """Go to a state; see `Problem.at`; by default that of the problem. Connections are those of the problem.

        If v is not in T_K(q), the law (8) is applied once.

        Parameters
        ----------
        q, v : array_like, shapes (nq,) and (nv,), optional
            The state.
        t : float, optional
            Time [s].

        Returns
        -------
        q, v : ndarray
            The attributes.

        Raises
        ------
        InputError
            On wrong shapes, numbers that are not finite, an unnormalised quaternion.
        """
        given = self._first
        start = given.at(given.q0 if q is None else q, given.v0 if v is None else v, given.t0 if t is None else t)
        stepper = self._stepper if self._given is given else _stepper(given, self._scheme, self._h)
        stepper.begin(start, start.t0)
        if stepper is not self._stepper:
            self._take(given, stepper)
        self._t0, self._begun = start.t0, 0
        return self.q, self.v

    def step(self, n: int = 1) -> tuple[Array, Array]:
        """Take n steps.

        Parameters
        ----------
        n : int
            Number of steps.

        Returns
        -------
        q, v : ndarray
            The attributes.

        Raises
        ------
        InputError
            If n is no positive integer.
        ProjectionError, DivergedError
            As `simulate`. The state is then that before the step that failed.
        """
        if type(n) is not int or not 0 < n <= _MOST_STEPS:
            n = integer(n, "n", 1)
            if n > _MOST_STEPS:
                raise InputError(f"n must be at most {_MOST_STEPS} steps in one call; got {shown(n)}")
        last = self._stepper.done + n
        while self._stepper.done < last:
            self._stepper.take(last)
        return self.q, self.v

    def attach(
        self,
        first: str,
        second: str,
        at: Sequence[float] | Array | None = None,
        axis: Sequence[float] | Array | None = None,
        name: str | None = None,
    ) -> str:
        """Connect two bodies as they are now, such as a gripper and what it grasps; they no longer collide.

        That is an impact: the velocity becomes the nearest one, in the kinetic metric, that the connection allows. If
        contacts close at that velocity, the law (8) is applied to them.

        Parameters
        ----------
        first, second : str
            See `Scene.connect`.
        at, axis : array_like, shape (3,), optional
            In the world. Without them both bodies are welded; with `at` they share a point, with both they are a hinge.
        name : str, optional
            "weld", "connection" or "hinge", then numbered, by default.

        Returns
        -------
        str
            The name.

        Raises
        ------
        InputError
            As `Scene.weld`, `connect` and `hinge`, or if the problem was not built from a `Scene`.

        Notes
        -----
        The problem is built again, which costs as much as `Scene.build`; `q` and `v` are other arrays afterwards.
        """
        problem, own = attached(self._given, self.q, first, second, at, axis, name)
        self._go_on(problem, attached=True)
        return own

    def detach(self, name: str) -> None:
        """Release a connection, one of the scene or one that was attached.

        The bodies can collide again. Where they overlap, they part as from a penetration.

        Raises
        ------
        InputError
            If there is none of that name, or the problem was not built from a `Scene`.
        """
        self._go_on(released(self._given, self.q, name), attached=False)

    def switch(self, connections: Mapping[str, bool]) -> None:
        """Switch connections and couplings of the scene on, an impact as `attach`, or off, as `detach`.

        What is switched on holds bodies and joints as they are now: point and axis stay where the first body has them,
        a coupling keeps its ratio and has the offset of this moment. The states are those of `simulate(switch=)`.

        Parameters
        ----------
        connections : dict of str to bool
            Whether each is on from now on; the others stay as they are.

        Raises
        ------
        InputError
            If there is none of a name, a value is no bool, or the problem was not built from a `Scene`.

        Notes
        -----
        The problem is built again; see `attach`.
        """
        if not isinstance(connections, Mapping):
            raise InputError(f"connections must be a dict of bool by name; got {shown(connections)}")
        wanted = {name: boolean(on, f"connection {shown(name)}") for name, on in connections.items()}
        scene = self._given.scene
        present = {} if scene is None else scene.items.switchable
        changed = {name: on for name, on in wanted.items() if on is not present.get(name)}
        if changed:
            self._go_on(switched(self._given, self.t, self.q, changed), attached=any(changed.values()))

    def _go_on(self, problem: Problem, *, attached: bool) -> None:
        """Go on with a problem of other connections, from the present state."""
        done = self._stepper.done
        start = connected_at(problem, self.t, self.q.copy(), self.v.copy(), self._scheme, attached=attached)
        # where that fails, the steps go on as before
        stepper = _stepper(start, self._scheme, self._h)
        stepper.begin(start, self._t0, done)
        self._take(start, stepper)
        self._begun = done

    @property
    def contacts(self) -> tuple[Contact, ...]:
        """The contacts with a percussion in the last step, as controls of a scene receive them.

        Of `EventDriven` and `Adaptive` those of all steps and impacts within it are added up.
        """
        stepper = self._stepper
        if isinstance(stepper, OwnStepper):
            return stepper.contacts
        # the law at the start and after a switch takes no time
        h = self._h if stepper.done > self._begun else 0.0
        return contacts_of_step(stepper.last_step(self.t), h, self._given.constraints.name)


class _PythonStepper:
    """Steps of any problem."""

    def __init__(self, problem: Problem, scheme: Scheme, h: float) -> None:
        self._scheme, self._h = scheme, h
        self.q, self.v = problem.q0.copy(), problem.v0.copy()

    def begin(self, problem: Problem, t0: float, done: int = 0) -> None:
        """Go to the initial state of a problem, the one after `done` steps from t0 on."""
        projector = projector_of(problem, self._scheme, None, None, None, self._h)[0]
        self._t0, self._last, self.done = t0, initial_step(problem, projector), done
        stepped = problem.at(problem.q0, problem.v0, t0) if done else problem
        self._steps = steps_from(stepped, self._scheme, self._h, projector, self._last, done)
        self.q[:], self.v[:] = self._last.q, self._last.v

    def take(self, last: int) -> None:
        """Take one step."""
        first = self.done + 1
        # a step may be followed by others, where it was shortened
        state, enough = self._last, self._t0 + (first - 0.5e-6) * self._h
        while state.t < enough:
            state = next(self._steps)
        self._last = state
        self.q[:], self.v[:], self.done = state.q, state.v, first

    def last_step(self, t: float) -> Step:
        """Return the last step."""
        return self._last


class _CompiledStepper:
    """Steps in compiled code."""

    def __init__(self, own: OwnProblem, scheme: Scheme, h: float) -> None:
        self._own, self._run, self._h = own, MechanismRun(own, scheme, h, 1), h
        self.q, self.v = self._run.q, self._run.v
        # no states are recorded
        self._none = np.zeros((1, len(self.q))), np.zeros((1, len(self.v)))

    def begin(self, problem: Problem, t0: float, done: int = 0) -> None:
        """Go to the initial state of a problem, the one after `done` steps from t0 on."""
        self._run.start(self._own.problem.at(problem.q0, problem.v0, problem.t0), done)
        self._run.initial_step()
        if done:
            self._run.problem = self._run.problem.at(problem.q0, problem.v0, t0)

    @property
    def done(self) -> int:
        """Number of the last step taken."""
        return self._run.done

    def take(self, last: int) -> None:
        """Take some steps, at most up to number `last`."""
        self._run.take(self.done + 1, last + 1, *self._none)

    def last_step(self, t: float) -> Step:
        """Return the last step, which ended at t, with what contacts need of its rows."""
        return self._run.last_step(t)


def _stepper(
    problem: Problem, scheme: Scheme | OwnStepsScheme, h: float
) -> _PythonStepper | _CompiledStepper | OwnStepper:
    if isinstance(scheme, OwnStepsScheme):
        return OwnStepper(problem, scheme, h, lambda problem: projector_of(problem, scheme, None, None, None)[0])
    if is_compiled_on_copies(problem, scheme):
        own = OwnProblem(problem)
        if own.mechanism is not None:
            return _CompiledStepper(own, scheme, h)
    return _PythonStepper(problem, scheme, h)
