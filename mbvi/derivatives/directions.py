"""What a run is differentiated by: the columns of each name of `wrt`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arguments import shown
from ..errors import InputError
from ..problem import Problem
from ..system.mechanisms.articulated import ArticulatedSystem
from ..system.system import Array, System, located_parts
from .parameters.inertial import Regressor
from .parameters.parameter import Parameter
from .parameters.parameters import FORMS, Parameters, parameter

# the first two names of `wrt`, and what the name of a constraint follows
_STATE, _RESTITUTION, _OF = "state", "restitution", "restitution of "


@dataclass(frozen=True, eq=False)
class Directions:
    """The p columns by which a run is differentiated, those of parameters in multiples of their sizes.

    Attributes
    ----------
    start : ndarray, shape (2 nv, p)
        The variation of the initial state of each.
    by_e : ndarray, shape (m, p)
        Those of the restitution of each constraint.
    by_p : ndarray, shape (n, p)
        Those of the parameters.
    by_gap : ndarray, shape (m, p)
        Those of the gap of each constraint.
    sizes : ndarray, shape (p,)
        The size of one variation of each: a derivative by the parameter itself is that of the column over this.
    columns : dict of str to slice
        The columns of each name.
    parameters : Parameters
        The n parameters.
    """

    start: Array
    by_e: Array
    by_p: Array
    by_gap: Array
    sizes: Array
    columns: dict[str, slice]
    parameters: Parameters

    @property
    def of_parameters(self) -> Array:
        """Which columns vary parameters, shape (p,) of bool."""
        return np.asarray(self.by_p.any(axis=0))


def directions(problem: Problem, names: tuple[str, ...], bodies: tuple[str, ...] | None) -> Directions:
    """Return the columns of names of `wrt`; "state" has those of some joints and bodies only where they are named."""
    n, m = problem.system.nv, len(problem.constraints)
    chosen = _velocities(problem.system, bodies)
    found: list[tuple[str, Array, Array, Parameter | None]] = []
    regressors: dict[int, Regressor] = {}
    for name in names:
        state, e, one = np.zeros((2 * n, 1)), np.zeros((m, 1)), None
        if name == _STATE:
            state = np.eye(2 * n)[:, np.concatenate([chosen, n + chosen])]
        elif name == _RESTITUTION or name.startswith(_OF):
            e = _restitution(problem, name)[:, None]
        else:
            one = parameter(problem, name, regressors)
            if one is None:
                listed = ", ".join(map(repr, (_STATE, _RESTITUTION, _OF + "CONSTRAINT", *FORMS)))
                raise InputError(f"wrt must hold some of {listed}; got {shown(name)}")
        found.append((name, state, e, one))
    parameters = Parameters(problem.system, [one for *_, one in found if one is not None])
    columns, sizes, ends = dict[str, slice](), [], 0
    for name, state, _, one in found:
        sizes.append(np.ones(state.shape[1]) if one is None else one.sizes)
        columns[name] = slice(ends, ends + len(sizes[-1]))
        ends = columns[name].stop
    start, by_e, by_p = np.zeros((2 * n, ends)), np.zeros((m, ends)), np.zeros((parameters.count, ends))
    for name, state, e, _ in found:
        start[:, columns[name]], by_e[:, columns[name]] = state, e
    varied = [k for name, *_, one in found if one is not None for k in range(ends)[columns[name]]]
    by_p[range(parameters.count), varied] = parameters.sizes
    return Directions(start, by_e, by_p, parameters.gaps(m) @ by_p, np.concatenate(sizes), columns, parameters)


def _restitution(problem: Problem, name: str) -> Array:
    """Return how much a name of `wrt` varies the restitution of each constraint, shape (m,)."""
    constraints = problem.constraints
    if name == _RESTITUTION:
        return np.ones(len(constraints))
    known = [constraints.name(k) for k in range(len(constraints))]
    if name.removeprefix(_OF) not in known:
        raise InputError(f"wrt holds {shown(name)}, and no constraint has that name in impacts")
    return np.array([float(one == name.removeprefix(_OF)) for one in known])


def _velocities(system: System, names: tuple[str, ...] | None) -> Array:
    """Return the velocities of some joints and bodies, ascending; all without names."""
    if names is None:
        return np.arange(system.nv)
    known: dict[str, list[int]] = {}
    for part in located_parts(system):
        own = part.system
        for k, name in enumerate(own.bodies[1:]):
            if isinstance(own, ArticulatedSystem):
                first, width = own.model.idx_vs[k + 1], own.model.nvs[k + 1]
            else:
                width = own.nv // own.independent_bodies
                first = k * width
            known[name] = list(range(part.v + first, part.v + first + width))
    unknown = [name for name in names if name not in known]
    if unknown or not names:
        raise InputError(f"bodies must hold names of {', '.join(known) or 'no bodies'}; got {shown(unknown or [])}")
    return np.array(sorted({k for name in names for k in known[name]}))
