"""K = {q : f_a(q) >= 0}: all constraint families of a problem, and the active rows at a configuration."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from functools import partial
from itertools import takewhile
from typing import Any, NamedTuple

import numpy as np

from ..errors import InputError
from ..system import System
from ..system.free.sparse_rows import dense
from .cache import ClearanceCache
from .families.given import as_family
from .family import ConstraintFamily
from .family_tangents import FamilyTangents
from .rebuilt import Rebuilt
from .rotations import Resistances, with_rotations
from .rows import Array, Constraint, Rows, concatenate, take
from .tangents import Tangents
from .tangents import concatenate as concatenate_tangents

# number of constraints up to which each has its lever in an array
_MOST_LEVERS = 100_000


class _Memory(NamedTuple):
    """What caches hold: that of clearances, and of each family copies of `memory`, and `kept`."""

    cache: Any
    families: list[tuple[list[Array], Any]]


def _memory_of(family: ConstraintFamily) -> tuple[list[Array], Any]:
    return [array.copy() for array in family.memory()], family.kept


class AdmissibleSet(Rebuilt):
    """The stack of constraint families.

    Parameters
    ----------
    system : System
        The system whose configurations q are.
    constraints : sequence of Constraint or ConstraintFamily
        Families, and a user's objects with `gap(t, q)` and `gradient(t, q)`.
    restitution : ndarray, shape (len(constraints),)
        e of each constraint; it applies where a constraint has none of its own.
    friction : ndarray, shape (len(constraints),), optional
        Coefficient of friction of each, in the same way; 0 by default.

    Attributes
    ----------
    constraints : tuple
        As given.
    families : tuple of ConstraintFamily
        The same, each user's object in its adapter.
    lever : ndarray, shape (k,)
        Factors by which gaps and rates of the first k constraints become lengths and speeds: the scene's length for
        angles, otherwise 1. All further constraints have lengths as gaps.
    limits : int
        How many constraints, the first ones, are limits of joints.
    frictional : bool
        Whether a constraint has friction.
    resistance : Resistances or None
        Torsional and rolling friction; None without any, as at first.

    Notes
    -----
    Constraints of all families are numbered one after the other; `name(k)` is the name of number k in impacts. The
    cache saves time only: the rows are the same as without it.
    """

    def __init__(
        self,
        system: System,
        constraints: Sequence[Constraint | ConstraintFamily],
        restitution: Array,
        friction: Array | None = None,
    ) -> None:
        self.system = system
        self.constraints = tuple(constraints)
        self._e = [float(e) for e in restitution]
        self._names: dict[int, str] = {}
        self._starts = [0]
        families = []
        for constraint, e in zip(self.constraints, self._e, strict=True):
            family = as_family(system, constraint, e, partial(self._name_from, self._starts[-1]))
            families.append(family)
            self._starts.append(self._starts[-1] + family.size)
        self.families = tuple(families)
        mu = np.zeros(len(families)) if friction is None else friction
        self._mu = [float(one) for one in mu]
        self.frictional = False
        for k, family in enumerate(families):
            own = np.asarray(family.friction, dtype=float)
            self.frictional |= bool(np.where(np.isnan(own), self._mu[k], own).max(initial=0.0) > 0.0)
            if self._mu[k] > 0.0 and not np.isnan(own).any() and not own.any():
                self._refuse(self.name(self._starts[k]), self._mu[k])
        self.limits = sum(family.size for family in takewhile(lambda one: one.of_joints, self.families))
        self.lever = np.zeros(0)
        for family, start, _ in self.numbered():
            if np.any(family.lever != 1.0):
                before = np.ones(start - len(self.lever))
                self.lever = np.concatenate([self.lever, before, np.full(family.size, family.lever)])
        if self.lever.size and len(self) <= _MOST_LEVERS:
            self.lever = np.concatenate([self.lever, np.ones(len(self) - len(self.lever))])
        self.empty = Rows(
            np.zeros(0, dtype=np.intp), np.zeros(0), np.zeros((0, system.nv)), np.zeros(0), *np.zeros((2, 0, 3))
        )
        self.resistance: Resistances | None = None
        self._tangents = FamilyTangents(system, self.families, self._starts, self._mu)
        self.cache = ClearanceCache(system, self.numbered())
        self._built: _Memory | None = None

    def __reduce__(self) -> tuple[Any, ...]:
        """Let copies keep what scenes set after the constructor."""
        return *super().__reduce__(), {"resistance": self.resistance}

    def renew(self) -> None:
        """Go back to what the caches held at the first call, which `Problem` makes when it is built.

        A run then gives the same bytes whatever ran before. Families that list near pairs keep their lists.
        """
        if self._built is None:
            self._built = _Memory(self.cache.save(), [_memory_of(family) for family in self.families])
            return
        self.cache.restore(self._built.cache)
        for family, (arrays, kept) in zip(self.families, self._built.families, strict=True):
            for array, saved in zip(family.memory(), arrays, strict=True):
                array[:] = saved
            family.kept = kept

    @property
    def kept(self) -> list[Any]:
        """The contacts that families keep while nothing moves."""
        return [family.kept for family in self.families]

    @kept.setter
    def kept(self, kept: list[Any]) -> None:
        for family, one in zip(self.families, kept, strict=True):
            family.kept = one

    def moved_by(self, system: System) -> AdmissibleSet:
        """Return the same constraints on a copy of the system, with caches of their own, as `renew` leaves them."""
        parts: list[Any] = []
        layers: list[tuple[Any, Any]] = [(self.system, system)]
        # families take their rows from the systems within those that add forces and connections
        while hasattr(layers[-1][0], "inner"):
            layers.append((layers[-1][0].inner, layers[-1][1].inner))
        for one in self.constraints:
            for old, other in layers:
                assert isinstance(one, Rebuilt)
                one = one.rebuilt_with(old, other)
            parts.append(one)
        new = AdmissibleSet(system, parts, np.array(self._e), np.array(self._mu))
        new._built, new.resistance = self._built, self.resistance
        new.renew()
        return new

    def __len__(self) -> int:
        return self._starts[-1]

    def name(self, number: int) -> str:
        """Return the name of a constraint: "hopper/foot | floor", "hopper/knee lower limit", "f 0"."""
        known = self._names.get(number)
        if known is None:
            k = bisect_right(self._starts, number) - 1
            known = self.families[k].name(number - self._starts[k]) or f"f {number}"
            self._names[number] = known
        return known

    def _name_from(self, start: int, row: int) -> str:
        return self.name(start + row)

    @property
    def moving(self) -> bool:
        """Whether some constraint changes with time at a fixed q."""
        return any(family.moving for family in self.families)

    @property
    def largest_restitution(self) -> float:
        """The largest e of all constraints; pairs of a `BroadPhasePairs`, which are not listed yet, are not counted."""
        e = [np.where(np.isnan(family.restitution), e, family.restitution) for family, _, e in self.numbered()]
        return max((float(np.max(own, initial=0.0)) for own in e), default=0.0)

    def depths(self, numbers: Array, gaps: Array) -> Array:
        """Return the greatest depths of contacts and of joint limits among some rows, shape (2,), 0 without any."""
        of_limits = numbers < self.limits
        found = [gaps[~of_limits].min(initial=0.0), gaps[of_limits].min(initial=0.0)]
        # without a negative zero
        return 0.0 - np.array(found)

    def levers(self, numbers: Array) -> Array | float:
        """Return the factors by which gaps of some constraints become lengths, shape (k,), or 1 for all."""
        if not self.lever.size:
            return 1.0
        if len(self.lever) == len(self):
            levers: Array = self.lever.take(numbers)
            return levers
        return np.where(numbers < len(self.lever), self.lever.take(numbers, mode="clip"), 1.0)

    def numbered(self) -> list[tuple[ConstraintFamily, int, float]]:
        """Return families, the number of the first constraint of each, and the e that applies where it has none."""
        return list(zip(self.families, self._starts[:-1], self._e, strict=True))

    def active(
        self, t: float, q: Array, tolerance: float, origin: Array | None = None, moved: Array | None = None
    ) -> Rows:
        """Return J(q): the rows with f_a(q) <= tolerance.

        Parameters
        ----------
        t : float
            Time [s].
        q : ndarray, shape (nq,)
            Configuration.
        tolerance : float
            The greatest gap of a row [m]; gaps of angles are multiplied by their lever. Calls may differ in it.
        origin, moved : ndarray, shapes (nq,) and (nv,), optional
            Another configuration and the tangent vector from it to q. If `origin` is the configuration of the last
            call, the cache uses `moved` and need not compute the difference.
        """
        found = self.cache.contacts(t, q, tolerance, origin, moved)
        rows = concatenate(found) if found else self.empty
        return Rows(*rows[:7], self._tangents_with(t, q, rows, found or [rows])) if self.frictional else rows

    def rows_of(self, k: int, t: float, q: Array, tolerance: float) -> Rows | None:
        """Return the rows of family number k, one that is queried at every step; see `active`."""
        rows = self.cache.rows_of(k, t, q, tolerance)
        return rows._replace(tangents=self.tangents_of(t, q, rows)) if rows is not None and self.frictional else rows

    def at_places(self, t: float, q: Array, rows: Rows) -> Rows:
        """Return rows with the gradients that contacts at the same points and normals have at q.

        Rows of constraints that have no bodies are not changed.
        """
        which, parts = np.searchsorted(self._starts, rows.constraint, side="right") - 1, []
        order = np.argsort(which, kind="stable")
        for f in np.unique(which).tolist():
            part, family = take(rows, which == f), self.families[f]
            if family.frame is not None:
                bodies = family.at_rest.bodies_of(part.constraint - self._starts[f])
                part = family.frame.at_place(t, q, part, bodies)
            elif type(family).bodies_of is not ConstraintFamily.bodies_of:
                first, second = family.bodies_of(part.constraint - self._starts[f])
                there = self.system.separation_rows(q, first, second, part.point, part.normal)
                part = part._replace(jacobian=there)
            parts.append(part)
        rows = take(concatenate(parts), np.argsort(order, kind="stable"))
        return rows._replace(tangents=self.tangents_of(t, q, rows)) if self.frictional else rows

    def tangents_of(self, t: float, q: Array, rows: Rows) -> Tangents:
        """Return the tangents of rows, with axes of rotation where problems have torsional or rolling friction."""
        return self._tangents_with(t, q, rows, [rows])

    def _tangents_with(self, t: float, q: Array, rows: Rows, parts: list[Rows]) -> Tangents:
        """Return `tangents_of` rows, given also as the parts that they consist of."""
        plain = [self._tangents.of(t, q, part) for part in parts]
        tangents = plain[0] if len(plain) == 1 else concatenate_tangents(plain)
        if self.resistance is None:
            return tangents
        resistance = self.resistance.of(rows.constraint, self.name)
        return with_rotations(self.families, self._starts, t, q, rows, tangents, resistance)

    def friction_of(self, f: int, own: Array) -> Array:
        """Return the coefficients of friction of some constraints of family number f, shape (k,)."""
        return self._tangents.friction_of(f, own)

    def friction_where_none(self, f: int) -> float:
        """Return the coefficient of friction of the constraints of family number f that have none of their own."""
        return self._mu[f]

    def coefficient_of_friction(self, number: int) -> float:
        """Return the coefficient of friction of a constraint."""
        f = bisect_right(self._starts, number) - 1
        return float(self.friction_of(f, np.array([number - self._starts[f]]))[0])

    @staticmethod
    def _refuse(name: str, mu: float) -> None:
        raise InputError(
            f"{name} has friction {mu:g} and no tangents: give GapFunction(f, grad_f, tangents=...), or an object with "
            "tangents(t, q) of shape (m, 2, nv)"
        )

    def travel(self, displacement: Array) -> float:
        """Return about how far a displacement, shape (nv,), moves the bodies of the constraints [m].

        Constraints that move `searched` velocities may be left out.
        """
        return self.cache.travel(displacement)

    @property
    def part(self) -> Array:
        """Which mechanism, free body or group of these each velocity belongs to; see `independent_parts`."""
        return self.cache.part

    @property
    def searched(self) -> Array:
        """Velocities that move bodies of constraints which are searched at every step, shape (nv,) of bool."""
        return self.cache.searched

    def gap(self, t: float, q: Array) -> Array:
        """Return every f_a(q), stacked, shape (m,) [m or rad]."""
        return np.concatenate([np.zeros(0), *(family.gap(t, q) for family in self.families)])

    def gradient(self, t: float, q: Array) -> Array:
        """Return every grad f_a(q) in the tangent space, stacked, shape (m, nv)."""
        rows = [dense(family.gradient(t, q)) for family in self.families]
        return np.concatenate([np.zeros((0, self.system.nv)), *rows])

    def check(self, t: float, q: Array) -> None:
        """Check a user's functions at the start of a run.

        Raises
        ------
        InputError
            If gaps are not finite, or gradients not of shape (nv,), not finite or of the wrong sign.
        """
        for family in self.families:
            family.check(t, q)
