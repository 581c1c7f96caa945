"""Prevents tunnelling: a step within which a body would pass through another is shortened to where they touch."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache
from typing import NamedTuple

import numpy as np

from ..constraints import ConstraintFamily
from ..constraints.relative_ways import Approach, pair_approach, shared_lengths, steady_approach
from ..errors import DivergedError
from ..problem import Problem
from ..projection import Projector
from ..schemes import Scheme, Step
from ..schemes.observer import observer
from ..system.parts import first_components
from ..system.system import Array, System
from .control_stability import turned_by_gains
from .loop.moving_walls import with_walls
from .meeting import Meeting

# v . v at and above which a run has diverged
RUNAWAY = 1e16
# most shortened steps within one step, and the remaining part of a step that is not shortened again
_MOST_SHORTENED, _LEAST_REST = 1000, 1e-9
# most times that a shortened step is shortened again because its law leads elsewhere than that of the whole one
_MOST_AGAIN = 20
# part of a step that counts as all of it: a shortened step ends just after bodies touch
_ALL = 0.99
# length of a vector of a displacement up to which it is taken as the difference of its ends [rad, m]
HALF_TURN = 3.0


class _Way(NamedTuple):
    """How bodies move within a step: where they are at a share of it, and the displacement at their velocity there."""

    place: Callable[[float], Array]
    pace: Callable[[float], Array]


class TunnellingGuard:
    """Detects bodies that travel further within a step than their thickness, and shortens steps before they pass.

    Parameters
    ----------
    problem : Problem
        System and constraints.
    scheme : Scheme
        Takes the steps. Within a step configurations move with v_i before the velocity jumps, with v_{i+1} after.
    h : float
        Time step [s].

    Attributes
    ----------
    limit, limit_with_walls : float
        v . v below which no body can pass through another, and no velocity diverges; the second one of velocities with
        those of the joints of walls that move.
    observe : callable or None
        `observer` of the problem. The guard passes it shortened steps; the loop passes it the last part of each step.
    """

    def __init__(self, problem: Problem, scheme: Scheme, h: float) -> None:
        self._problem, self._scheme, self._h = problem, scheme, h
        self._jump = scheme.timing.jump
        self.observe = observer(problem)
        # walls that move are bodies here
        self._walls = with_walls(problem)
        self._system: System = problem.system if self._walls is None else self._walls.system
        constraints = problem.constraints if self._walls is None else self._walls.constraints
        # the families whose bodies can pass through each other
        least = {family: family.least_displacement() for family in constraints.families}
        self._watched = [family for family in constraints.families if np.isfinite(least[family])]
        self.limit_with_walls = RUNAWAY
        # for each velocity, the largest displacement of any pair in a step relative to its thickness
        self._per_velocity = np.zeros(self._system.nv)
        # the same for each pair, one array a family
        self._displacements: list[Array] = []
        # with many bodies there are no bounds of each pair, but an entry of v below which no body travels its thickness
        self.slow_speed = 0.0
        # for each velocity the square root of how many components its vector has
        vectors = first_components(self._system)
        self._roots = np.sqrt(np.bincount(vectors, minlength=1))[vectors]
        for family in self._watched:
            share = family.passed_share()
            if share is None:
                self._per_velocity, self._displacements = np.full(self._system.nv, np.inf), []
                self.slow_speed = min(least[one] for one in self._watched) / h
                break
            np.maximum(self._per_velocity, h * share.max(axis=1), out=self._per_velocity)
            self._displacements.append(h * share)
        reach = float(self._per_velocity.dot(self._per_velocity))
        if reach > 0.0:
            self.limit_with_walls = min(self.limit_with_walls, 1.0 / reach)
        own = 0.0 if self._walls is None else float(self._walls.speeds.dot(self._walls.speeds))
        self.limit = self.limit_with_walls - own

    @property
    def shares(self) -> tuple[Array, Array]:
        """For each velocity the largest travel of a pair in a step, relative to its thickness; and that of each pair.

        Shapes (nv,) and (nv, n). Where pairs are too many to be listed, the second has no columns.
        """
        none = np.zeros((len(self._per_velocity), 0))
        return self._per_velocity, np.ascontiguousarray(np.concatenate([none, *self._displacements], axis=1))

    @property
    def watched(self) -> list[ConstraintFamily]:
        """The families whose pairs are in `shares`, in this order."""
        return self._watched[: len(self._displacements)]

    def followed(self, t: float, state: Step, new: Step, h: float, projector: Projector) -> Iterator[Step]:
        """Yield the steps from a state at t to t + h: only `new` if no body passes through another in between."""
        # bodies that are slow at both ends cannot pass; written so that a NaN is checked further
        if new.v.dot(new.v) < self.limit and state.v.dot(state.v) < self.limit:
            yield new
            return
        rest = h
        for _ in range(_MOST_SHORTENED):
            self._check(new, h)
            if self._none_passes(*self._fastest(state, new)):
                break
            part = self._part(state, new, rest)
            if part == 1.0 or rest <= _LEAST_REST * h:
                break
            length, shortened = self._until_touching(t + h - rest, state, part * rest, projector)
            self._check(shortened, h)
            if self.observe is not None:
                self.observe(shortened, length)
            yield shortened
            state, rest = shortened, rest - length
            new = self._shortened(t + h - rest, state, rest, projector)
        yield new

    def _shortened(self, t: float, state: Step, h: float, projector: Projector) -> Step:
        """Return the state at t + h, where h differs from the length of the other steps."""
        return self._scheme.shortened(self._problem, t, state, h, projector)

    def _until_touching(self, t: float, state: Step, h: float, projector: Projector) -> tuple[float, Step]:
        """Return a step of at most the length h within which no body passes through another, and its length [s].

        A law that acts from the start on may lead elsewhere in a shorter step than in the whole one.
        """
        shortened = self._shortened(t, state, h, projector)
        for _ in range(_MOST_AGAIN):
            part = self._part(state, shortened, h)
            if part > _ALL:
                break
            h *= part
            shortened = self._shortened(t, state, h, projector)
        return h, shortened

    def passed(self, state: Step, new: Step, h: float) -> float:
        """Return the part of one step of any length h after which a body would pass through another, 1 if none does."""
        if self._none_passes(*(h / self._h * self._fastest(state, new))):
            return 1.0
        return self._part(state, new, h)

    def _fastest(self, state: Step, new: Step) -> Array:
        """Return the larger ones of the velocities before and after a step, with those of walls, shape (2, nv).

        In the first row are their absolute values, in the second one `shared_lengths`.
        """
        both = state.v, new.v
        if self._walls is not None:
            both = np.append(state.v, self._walls.speeds), np.append(new.v, self._walls.speeds)
        before, after = (np.stack([np.abs(v), shared_lengths(self._system, v)]) for v in both)
        return np.maximum(before, after)

    def _none_passes(self, fastest: Array, shared: Array) -> bool:
        """Return whether no pair travels its thickness in a step if no velocity exceeds those of `_fastest`."""
        if not self._displacements:
            # these bounds are those of the root of the mean square, if all are isotropic
            most = self._roots * shared if all(family.isotropic for family in self._watched) else fastest
            return float(most.max(initial=0.0)) < self.slow_speed
        return float(self._per_velocity.dot(fastest)) < 1.0 or all(
            ((shared if family.isotropic else fastest).dot(displacements) < 1.0).all()
            for family, displacements in zip(self._watched, self._displacements, strict=True)
        )

    def _check(self, state: Step, h: float) -> None:
        """Raise `DivergedError` if velocities are too large or not finite, or gains let a robot run away.

        Each step of such a robot has more contacts than the one before, and takes longer.
        """
        # written so that a NaN raises too
        runaway = not state.v.dot(state.v) < RUNAWAY
        if runaway or turned_by_gains(self._problem, h, state.t, state.q, state.v):
            raise DivergedError(
                f"the velocity runs away at t = {state.t:.6g} s, to {np.abs(state.v).max():.3g}: the forces change too "
                f"fast for h = {h:g} s; take a smaller step, or give light links damping or more inertia"
            )

    def _part(self, state: Step, new: Step, h: float) -> float:
        """Return the part of a step after which a body would pass through another, 1 if none does."""
        jump = self._jump
        if self._walls is not None:
            state, new = self._walls.at_time(state), self._walls.at_time(new)
        for way, start, length in zip(self._ways(state, new, h), (0.0, jump), (jump, 1.0 - jump), strict=True):
            share = self._first(way, length) if length > 0.0 else 1.0
            if share < 1.0:
                # a root is a numpy scalar, and so would be the times of steps and impacts
                return float(start + share * length)
        return 1.0

    def _ways(self, state: Step, new: Step, h: float) -> tuple[_Way, _Way]:
        """Return how bodies move before the velocity jumps, and after that."""
        system, before, after = self._system, self._jump * h, (1.0 - self._jump) * h
        if self._scheme.timing.coasts:
            # the second one ends with the step, where its velocity is known
            first, second = self._coasting(state.q, state.v, before, 0.0), self._coasting(new.q, new.v, after, 1.0)
            if not self._scheme.project_positions:
                return first, second
            # it begins where the first one ends: meanwhile the projection pushes bodies
            push = system.difference(first.place(1.0), second.place(0.0))
            return first, _Way(
                lambda x: system.integrate(second.place(x), (x - 1.0) * push), lambda x: second.pace(x) + push
            )
        middle, onward = system.integrate(state.q, before * state.v), after * new.v
        # of bodies that turn further the difference of two configurations does not know how far
        if (self._roots * self._roots * shared_lengths(system, onward)).max(initial=0.0) < HALF_TURN:
            onward = system.difference(middle, new.q)
        return (
            _Way(lambda x: system.integrate(state.q, x * before * state.v), lambda _: before * state.v),
            _Way(lambda x: system.integrate(middle, x * onward), lambda _: onward),
        )

    def _coasting(self, q: Array, v: Array, h: float, at: float) -> _Way:
        """Return the way of a time h through q with the velocity v, at that share of it."""
        integrate, coast = self._system.integrate, self._system.coast
        return _Way(lambda x: integrate(q, coast(v, (x - at) * h)[0]), lambda x: h * coast(v, (x - at) * h)[1])

    def _first(self, way: _Way, length: float) -> float:
        """Return the share of a way at which the first pair meets that would pass through each other.

        `length` is that of the way in steps: pairs pass through each other in a whole one.
        """
        first, q, displacement = 1.0, way.place(0.0), way.pace(0.0)
        for family in self._watched:
            for k, travel, thickness in zip(*family.passable(q, displacement / length), strict=True):
                first = min(first, self._meets(family, way, np.array([k]), length * travel, thickness))
        return first

    def _meets(self, family: ConstraintFamily, way: _Way, pair: Array, travel: float, thickness: float) -> float:
        """Return the share of a way just after a pair meets, or may meet as far as is known; 1 if it does not."""
        both = cache(lambda: (family.balls_of(pair), family.reach_of(pair)))

        def approach(x: float, close: bool) -> Approach:
            q = way.place(x)
            gap, normal = family.nearest_of(self._problem.t0, q, pair)
            balls, reach = both() if close and normal is not None else (None, None)
            if balls is None or reach is None or normal is None:
                return steady_approach(float(gap[0]), travel)
            # the first ball need not be that of the first body
            sign = 1.0 if family.bodies_of(pair)[0][0] == balls.bodies[0, 0] else -1.0
            return pair_approach(
                self._system, balls, reach[0], q, way.pace(x), float(gap[0]), sign * normal[0]
            )  # fmt: skip

        meeting = Meeting(approach, self._problem.tolerance, travel, thickness)
        return meeting.entering() if family.hollow else meeting.touching()
