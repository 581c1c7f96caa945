"""Parameters of a problem by name, how they act on the motion and on gaps, and problems with other values of them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np

from ...arguments import shown
from ...constraints import GapFunction
from ...constraints.families.given import named_gap_functions
from ...errors import InputError
from ...geometry.shapes.shapes import HalfSpace
from ...problem import Problem
from ...system import System
from ...system.free.bodies import FreeBodies, Spheres
from ...system.mechanisms.articulated import ArticulatedSystem
from ...system.system import Array, Part, located_parts
from .controls import OF_CONTROL, OF_TORQUE, Gain, Torque, has_gain
from .inertial import OF_CENTRE, OF_INERTIA, OF_MASS, BodyInertia, LinkInertia, Regressor
from .parameter import ACCELERATION, Parameter, gravitation, with_gravity

_GRAVITY, _OFFSET, _FRICTION, _FRICTION_OF = "gravity", "offset of ", "friction", "friction of "
# what names of parameters look like
FORMS = (
    "mass of BODY", "centre of mass of BODY", "inertia of BODY", "torque of JOINT", "control stiffness of JOINT",
    "control damping of JOINT", "control target of JOINT", "gravity", "offset of WALL", "friction",
    "friction of CONSTRAINT",
)  # fmt: skip


class Gravity(Parameter):
    """The acceleration of gravity along x, y and z [m/s^2].

    Parameters
    ----------
    problem : Problem
        The problem, whose parts are mechanisms, bodies and spheres.
    """

    def __init__(self, problem: Problem) -> None:
        self._parts = located_parts(problem.system)
        self.sizes = np.full(3, ACCELERATION * problem.length)
        self._weights = [gravitation(part.system) for part in self._parts]

    def add_force(self, t: float, q: Array, v: Array, a: Array, out: Array) -> None:
        for part, weight in zip(self._parts, self._weights, strict=True):
            out[part.v : part.v + part.system.nv] -= weight(q[part.q : part.q + part.system.nq])

    def vary(self, replaced: dict[int, Any], change: Array) -> None:
        for part in self._parts:
            now = replaced.get(id(part.system), part.system)
            replaced[id(part.system)] = with_gravity(now, change)


class Offset(Parameter):
    """The place of a wall along its normal [m].

    Parameters
    ----------
    gaps : ndarray, shape (m, 1)
        By how much it changes each gap: by -1 or not.
    wall : HalfSpace or GapFunction
        The wall.
    moved : callable
        moved(wall, by) -> the wall moved along its normal [m].
    length : float
        That of the scene [m].
    """

    def __init__(self, gaps: Array, wall: Any, moved: Callable[[Any, float], Any], length: float) -> None:
        self.gaps, self._wall, self._moved, self.sizes = gaps, wall, moved, np.array([length])

    def vary(self, replaced: dict[int, Any], change: Array) -> None:
        now = replaced.get(id(self._wall), self._wall)
        replaced[id(self._wall)] = self._moved(now, float(change[0]))


class Friction(Parameter):
    """The coefficient of friction of some constraints.

    Parameters
    ----------
    frictions : ndarray, shape (m, 1)
        By how much it changes that of each constraint: by 1 or not.
    """

    def __init__(self, frictions: Array) -> None:
        self.frictions, self.sizes = frictions, np.ones(1)

    def vary(self, replaced: dict[int, Any], change: Array) -> None:
        """Leave the problem as it is: what integrates it adds to the coefficients."""


class Parameters:
    """Parameters of a problem, whose columns follow each other.

    Parameters
    ----------
    system : System
        The system.
    each : sequence of Parameter
        The parameters.

    Attributes
    ----------
    count : int
        How many columns they have.
    sizes : ndarray, shape (count,)
        See `Parameter`.
    """

    def __init__(self, system: System, each: Sequence[Parameter]) -> None:
        self._system, self._each = system, list(each)
        ends = np.cumsum([0, *(len(one.sizes) for one in self._each)]).tolist()
        self._columns = [slice(*pair) for pair in pairwise(ends)]
        self.count: int = ends[-1]
        self.sizes = np.concatenate([np.zeros(0), *(one.sizes for one in self._each)])

    def accelerations(self, t: float, q: Array, v: Array, a: Array) -> Array:
        """Return the derivatives of the acceleration a without contacts, shape (nv, count), at constant forces."""
        return self._solved(q, lambda one, out: one.add_force(t, q, v, a, out))

    def jumps(self, q: Array, w: Array) -> Array:
        """Return the derivatives of a jump w of velocities, shape (nv, count), at a constant percussion."""
        return self._solved(q, lambda one, out: one.add_percussion(q, w, out))

    def _solved(self, q: Array, add: Callable[[Parameter, Array], None]) -> Array:
        missing = np.zeros((self._system.nv, self.count))
        for one, columns in zip(self._each, self._columns, strict=True):
            add(one, missing[:, columns])
        return -np.asarray(self._system.metric(q).solve_rows(np.ascontiguousarray(missing.T))).T

    def gaps(self, count: int) -> Array:
        """Return the derivatives of the gaps of all constraints, shape (count of constraints, count)."""
        return np.hstack([np.zeros((count, 0)), *(np.zeros((count, len(p.sizes))) + p.gaps for p in self._each)])

    def frictions(self, count: int) -> Array:
        """Return the derivatives of the coefficients of friction of all constraints, shape (count, self.count)."""
        return np.hstack([np.zeros((count, 0)), *(np.zeros((count, len(p.sizes))) + p.frictions for p in self._each)])

    def varied(self, problem: Problem, change: Array) -> Problem:
        """Return a problem of its own with other values of the parameters."""
        replaced: dict[int, Any] = {}
        pairs = zip(self._each, self._columns, strict=True)
        for one, columns in sorted(pairs, key=lambda pair: pair[0].hides_control):
            if change[columns].any():
                one.vary(replaced, change[columns])
        # a copy refers to what is replaced wherever the problem refers to the original
        return deepcopy(problem, replaced)


def parameter(problem: Problem, name: str, regressors: dict[int, Regressor]) -> Parameter | None:
    """Return a parameter by its name, or None if no parameter has such a name; raise `InputError` if it has none such.

    `regressors` keeps those of mechanisms.
    """
    if name == _GRAVITY:
        others = [part.system for part in located_parts(problem.system) if not _is_known(part.system)]
        if others:
            raise InputError(f"wrt holds 'gravity', of which {type(others[0]).__name__} knows nothing")
        return Gravity(problem)
    if name == _FRICTION or name.startswith(_FRICTION_OF):
        return _friction(problem, name)
    if name.startswith(_OFFSET):
        return _offset(problem, name.removeprefix(_OFFSET))
    kind = next((one for one in (OF_MASS, OF_CENTRE, OF_INERTIA, OF_TORQUE, *OF_CONTROL) if name.startswith(one)), None)
    if kind is None:
        return None
    part, body = _found(problem, name.removeprefix(kind), kind)
    if isinstance(part.system, ArticulatedSystem):
        if kind == OF_TORQUE:
            return Torque(problem, part, body)
        if kind in OF_CONTROL:
            return Gain(problem, part, body, kind)
        return LinkInertia(part, body, kind, problem.length, regressors.setdefault(part.v, Regressor(part.system)))
    return BodyInertia(part, body - 1, kind)


def _is_known(system: System) -> bool:
    return isinstance(system, ArticulatedSystem | FreeBodies | Spheres)


def _found(problem: Problem, name: str, kind: str) -> tuple[Part, int]:
    """Return the part of a body, and the body's number in it, of a body that has such a parameter."""
    known: dict[str, tuple[Part, int]] = {}
    for part in located_parts(problem.system):
        own = part.system
        for k, body in enumerate(own.bodies[1:]):
            if (
                (isinstance(own, ArticulatedSystem) and (kind not in OF_CONTROL or has_gain(own, k + 1, kind)))
                or (isinstance(own, FreeBodies) and kind in (OF_MASS, OF_INERTIA))
                or (isinstance(own, Spheres) and kind == OF_MASS)
            ):
                known[body] = part, k + 1
    if name not in known:
        listed = ", ".join(known) or "nothing"
        raise InputError(f"wrt holds {shown(kind + name)}; what has one is {listed}")
    return known[name]


def _offset(problem: Problem, name: str) -> Offset:
    constraints = problem.constraints
    names = [constraints.name(k) for k in range(len(constraints))]
    given = named_gap_functions(constraints.constraints)
    walls = {} if problem.scene is None else problem.scene.walls
    wall: Any
    moved: Callable[[Any, float], Any]
    if name in walls:
        met, wall, moved = [one.endswith(f" | {name}") for one in names], walls[name], _at_offset
    elif name in given:
        met, wall, moved = [one == name for one in names], given[name], GapFunction.behind
    else:
        known = ", ".join([*walls, *given]) or "none"
        raise InputError(f"wrt holds 'offset of {name}'; half-spaces and gap functions with a name are {known}")
    return Offset(-np.array(met, float)[:, None], wall, moved, problem.length)


def _friction(problem: Problem, name: str) -> Friction:
    constraints = problem.constraints
    rough = np.array([constraints.coefficient_of_friction(k) > 0.0 for k in range(len(constraints))])
    named = np.array([name in (_FRICTION, _FRICTION_OF + constraints.name(k)) for k in range(len(constraints))])
    if not (rough & named).any():
        known = ", ".join(constraints.name(k) for k in np.flatnonzero(rough).tolist()) or "none"
        raise InputError(f"wrt holds {shown(name)}; constraints that have friction are {known}")
    return Friction((rough & named).astype(float)[:, None])


def _at_offset(wall: HalfSpace, by: float) -> HalfSpace:
    return replace(wall, offset=wall.offset + by)
