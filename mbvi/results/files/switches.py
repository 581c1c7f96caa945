"""Connections that were switched in a run, as a file keeps them: one text each, as JSON."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ...errors import InputError, TrajectoryFileError
from ...scene.connected.switched import connected, switched
from ..run_data import Array, Switch

if TYPE_CHECKING:
    from ...problem import Problem

_ARRAYS = "q", "before", "after"


def texts_of(switches: Sequence[Switch]) -> tuple[str, ...]:
    """Return switches as texts, numbers to the last bit."""
    return tuple(
        json.dumps(
            {"time": one.time, "connections": one.connections} | {name: getattr(one, name).tolist() for name in _ARRAYS}
        )
        for one in switches
    )


def switches_of(texts: Sequence[str], t: Array, sizes: tuple[int, int], complete: bool) -> tuple[Switch, ...]:
    """Return the switches of a run with states at t, without their problems; `sizes` are nq and nv.

    The file of a run that is not complete may have switches after its last state: they are left out.

    Raises
    ------
    TrajectoryFileError
        If they are not of such a run.
    """
    found = []
    for text in texts:
        data = json.loads(text)
        q, before, after = (np.array(data[name], dtype=np.float64) for name in _ARRAYS)
        time, connections = data["time"], data["connections"]
        whole = (q.shape, before.shape, after.shape) == (sizes[:1], sizes[1:], sizes[1:])
        named = isinstance(connections, dict) and all(isinstance(on, bool) for on in connections.values())
        if not whole or not named or not all(np.isfinite(values).all() for values in (q, before, after)):
            raise TrajectoryFileError("its switches have wrong shapes, or numbers that are not finite")
        if complete or not len(t) or time <= t[-1]:
            found.append(Switch(time, connections, q, before, after))
    times = [one.time for one in found]
    if (np.diff(times) <= 0.0).any() or not np.isin(times, t).all():
        raise TrajectoryFileError("the times of its switches do not ascend within those of its states")
    return tuple(found)


def with_problems(problem: Problem, switches: Sequence[Switch]) -> tuple[Switch, ...]:
    """Return switches with the problems that they lead to, from that of the run on.

    Raises
    ------
    TrajectoryFileError
        If the problem has other connections.
    """
    found = list[Switch]()
    for one in switches:
        try:
            other = switched(problem, one.time, one.q, one.connections)
        except InputError as error:
            raise TrajectoryFileError(f"its switches are not of its problem: {error}") from error
        problem = connected(other, one.time, one.q, one.before, attached=any(one.connections.values()))
        found.append(replace(one, problem=problem))
    return tuple(found)
