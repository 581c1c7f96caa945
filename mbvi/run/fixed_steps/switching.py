"""Connections that are switched on and off between the steps of a run."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any

import numpy as np

from ...arguments import function, shown
from ...errors import InputError
from ...problem import Problem
from ...projection import Projector
from ...results.run_data import Array, Impact, Switch
from ...scene.connected.switched import connected, switched
from ...scene.model import SceneModel
from ...scene.state import Place, State, Values
from ...schemes import OwnStepsScheme, Scheme, Step
from ...schemes.observer import Contacts, contacts_of_step
from ...system.given import called
from ..recording.recorder import Recorder
from ..start import initial_step
from .attaching import attaching

# least room that arrays of states grow by, and most notes of switches
_ROOM, _MOST_NOTES = 16, 20

# switch(state) -> {connection: bool}
SwitchFunction = Callable[[State], Mapping[str, bool] | None]


class Switching:
    """A user's function that says which connections are on.

    Parameters
    ----------
    problem : Problem
        At the start.
    switch : callable
        switch(state) -> {connection: bool}, see `simulate`.

    Raises
    ------
    InputError
        If it is no function, or the problem has no scene.
    """

    def __init__(self, problem: Problem, switch: SwitchFunction) -> None:
        self._function = function(switch, "switch", "switch(state) -> {connection: bool}")
        if not isinstance(problem.scene, SceneModel):
            raise InputError("switch needs connections with names: build the problem from a Scene")
        self._on = problem.scene.items.switchable
        self._places = problem.scene.places()

    def asked(self, problem: Problem, step: Step, h: float) -> dict[str, bool]:
        """Return the connections that change after a step of the length h [s]."""
        return self.asked_at(step.t, step.q, step.v, partial(contacts_of_step, step, h, problem.constraints.name))

    def asked_at(self, t: float, q: Array, v: Array, contacts: Contacts) -> dict[str, bool]:
        """Return the connections that change at a state; `contacts` returns the contacts there."""
        changed = self.wanted(t, q, v, contacts)
        self.switched(changed)
        return changed

    def switched(self, changed: dict[str, bool]) -> None:
        """Take connections as switched."""
        self._on |= changed

    def wanted(self, t: float, q: Array, v: Array, contacts: Contacts) -> dict[str, bool]:
        """Return what `asked_at` does, without taking it as done."""
        configuration, velocity = (
            Values(self._places, take, values.view())
            for take, values in ((Place.configuration, q), (Place.velocity, v))
        )
        found = self._function(State(t, configuration, velocity, contacts))
        return {name: on for name, on in self._checked(found, t) if on != self._on[name]}

    def _checked(self, found: Any, t: float) -> Iterable[tuple[str, bool]]:
        """Yield what the function has returned, or raise `InputError`."""
        who = f"switch {called(self._function)} at t = {t:.6g} s returned"
        if found is None:
            return
        if not isinstance(found, Mapping):
            raise InputError(f"{who} {shown(found)}; a dict of bool by connection, or None, is expected")
        for name, on in found.items():
            if not isinstance(name, str) or name not in self._on:
                raise InputError(f"{who} {shown(name)}; connections are {', '.join(self._on) or 'none'}")
            if not isinstance(on, bool | np.bool_):
                raise InputError(f"{who} {shown(on)} for {name}; True or False is expected")
            yield name, bool(on)


class Switches:
    """What a run records of its switches.

    Parameters
    ----------
    problem : Problem
        That of the run.

    Attributes
    ----------
    made : list of Switch
        Those so far.
    """

    def __init__(self, problem: Problem) -> None:
        self.made = list[Switch]()
        self._problems, self._starts = [problem], [0]

    def name(self, constraint: int) -> str:
        """Return the name of a constraint; those of each problem follow those of the one before."""
        k = bisect_right(self._starts, constraint) - 1
        return self._problems[k].constraints.name(constraint - self._starts[k])

    def add(
        self, problem: Problem, connections: dict[str, bool], before: Step, after: Array, notes: list[str]
    ) -> tuple[int, list[Impact]]:
        """Add a switch at a state, and a note of it.

        Parameters
        ----------
        problem : Problem
            With its connections, at the velocity that they allow.
        connections : dict of str to bool
            Those that are switched.
        before : Step
            The state before.
        after : ndarray, shape (nv,)
            The velocity that is recorded.
        notes : list of str
            Receives the note.

        Returns
        -------
        offset : int
            What is added to the numbers of the problem's constraints.
        impacts : list of Impact
            The impact, if something is attached.
        """
        self._starts.append(self._starts[-1] + len(self._problems[-1].constraints))
        self._problems.append(problem)
        one = Switch(before.t, connections, before.q.copy(), before.v.copy(), after.copy(), problem)
        self.made.append(one)
        if len(self.made) <= _MOST_NOTES:
            notes.append(f"connections were switched at {one}")
        on = [name for name, is_on in connections.items() if is_on]
        impact = attaching(problem, on, before, problem.v0)
        return self._starts[-1], [] if impact is None else [impact]


class SwitchedRecorder(Recorder):
    """A recorder of a run in which connections are switched."""

    def __init__(self, problem: Problem, *arguments: Any) -> None:
        super().__init__(problem, *arguments)
        # how many states more there is room for
        self._made, self._room = Switches(problem), 0
        self.switches = self._made.made

    def name(self, constraint: int) -> str:
        """Return the name of a constraint; see `Switches.name`."""
        return self._made.name(constraint)

    def add_state(self, state: Step) -> None:
        """Record a state whose step is recorded already."""
        k = self.count
        if not self._room:
            self._room = max(_ROOM, k // 2)
            for name in ("t", "q", "v", "penetration", "limit_violation", "residual"):
                old = getattr(self, name)
                setattr(self, name, np.concatenate([old, np.zeros((self._room, *old.shape[1:]))]))
        self._room -= 1
        if self.contacts is not None:
            self.contacts.close()
        self.t[k], self.q[k], self.v[k], self.count = state.t, state.q, state.v, k + 1

    def switched(self, problem: Problem, connections: dict[str, bool], before: Step, after: Step) -> None:
        """Go on with a problem whose connections were switched at the last recorded state.

        `before` is that state, and `after` the same after the percussions of connections and contacts.
        """
        last = self.count - 1
        at = before._replace(t=float(self.t[last]))
        offset, impacts = self._made.add(problem, connections, at, after.v, self.notes)
        self.impacts += impacts
        self.begin(problem)
        # percussions at one instant belong to no interval of time
        log, self.contacts = self.contacts, None
        self.step(after, False)
        self.contacts = log
        if log is not None:
            log.offset = offset
        self.v[last] = after.v


def connected_at(
    problem: Problem, t: float, q: Array, v: Array, scheme: Scheme | OwnStepsScheme, *, attached: bool
) -> Problem:
    """Return what `connected` does, if the scheme can run it."""
    start = connected(problem, t, q, v, attached=attached)
    scheme.check(start)
    return start


def switch_connections(
    problem: Problem, connections: dict[str, bool], t: float, state: Step, scheme: Scheme | OwnStepsScheme,
    projector_for: Callable[[Problem], Projector], recorder: SwitchedRecorder,
) -> tuple[Problem, Projector, Step]:  # fmt: skip
    """Return what a run goes on with after connections were switched at a state, the last one recorded, at t [s].

    What is attached is an impact: v becomes the nearest velocity, in the kinetic metric, that the connections allow;
    then the law (8) is applied to contacts that close.

    Returns
    -------
    problem : Problem
        With its connections, and the initial time of the given one.
    projector : Projector
        For it.
    state : Step
        After all percussions.
    """
    start = connected_at(
        switched(problem, t, state.q, connections), t, state.q, state.v, scheme, attached=any(connections.values())
    )
    projector = projector_for(start)
    after = initial_step(start, projector)._replace(t=state.t)
    recorder.switched(start, connections, state, after)
    return start.at(start.q0, start.v0, problem.t0), projector, after
