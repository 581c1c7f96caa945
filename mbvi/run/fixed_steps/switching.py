"""Connections that are switched on and off between the steps of a run."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Any

import numpy as np

from ...arguments import function, shown
from ...constraints import AdmissibleSet
from ...errors import InputError
from ...problem import Problem
from ...projection import Projector
from ...results.run_data import Array, Switch
from ...scene.connected.switched import connected, switched
from ...scene.model import SceneModel
from ...scene.state import Place, State, Values
from ...schemes import Scheme, Step
from ...schemes.observer import contacts_of_step
from ...system.given import called
from ..recorder import Recorder
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
        configuration, velocity = (
            Values(self._places, take, values.view())
            for take, values in ((Place.configuration, step.q), (Place.velocity, step.v))
        )
        contacts = partial(contacts_of_step, step, h, problem.constraints.name)
        found = self._function(State(step.t, configuration, velocity, contacts))
        changed = {name: on for name, on in self._checked(found, step.t) if on != self._on[name]}
        self._on |= changed
        return changed

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


class SwitchedRecorder(Recorder):
    """A recorder of a run in which connections are switched."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        # the ends of the numbers of constraints before each switch, and how many states more there is room for
        self._before, self._room = list[tuple[int, AdmissibleSet]](), 0

    def name(self, constraint: int) -> str:
        """Return the name of a constraint; those of each problem follow those of the one before."""
        start = 0
        for end, constraints in self._before:
            if constraint < end:
                return constraints.name(constraint - start)
            start = end
        return self.problem.constraints.name(constraint - start)

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
        offset = len(self.problem.constraints) + (self._before[-1][0] if self._before else 0)
        self._before.append((offset, self.problem.constraints))
        when = float(self.t[last])
        made = Switch(when, connections, before.q.copy(), before.v.copy(), after.v.copy(), problem)
        self.switches.append(made)
        if len(self.switches) <= _MOST_NOTES:
            self.notes.append(f"connections were switched at {made}")
        on = [name for name, is_on in connections.items() if is_on]
        impact = attaching(problem, on, before, problem.v0)
        self.impacts += [] if impact is None else [impact]
        self.begin(problem)
        # percussions at one instant belong to no interval of time
        log, self.contacts = self.contacts, None
        self.step(after, False)
        self.contacts = log
        if log is not None:
            log.offset = offset
        self.v[last] = after.v


def connected_at(problem: Problem, t: float, q: Array, v: Array, scheme: Scheme, *, attached: bool) -> Problem:
    """Return what `connected` does, if the scheme can run it."""
    start = connected(problem, t, q, v, attached=attached)
    scheme.check(start)
    return start


def switch_connections(
    problem: Problem, connections: dict[str, bool], t: float, state: Step, scheme: Scheme,
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
