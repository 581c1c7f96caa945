"""The tangents of rows, those of each constraint family in turn."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ..projection.coulomb.friction import LARGEST_FRICTION
from ..system import System
from .family import ConstraintFamily
from .rows import Array, Rows, take
from .tangents import Tangents, concatenate, none_of, tangents_of_mechanism


class _SingleFamily(NamedTuple):
    """Rows of one family with friction.

    Attributes
    ----------
    numbers, own : ndarray of int, shape (k,)
        Their constraints, numbered in the problem and in the family.
    family : ConstraintFamily or None
        The family; None before the first rows.
    friction : ndarray, shape (k,)
        Coefficients.
    bodies : tuple of ndarray, or None
        The first and the second body of each, where tangents follow from them and one mechanism moves all bodies.
    """

    numbers: Array | None
    family: Any
    own: Array
    friction: Array
    bodies: tuple[Array, Array] | None


class FamilyTangents:
    """The tangents and coefficients of friction of constraints that are numbered family after family.

    Parameters
    ----------
    system : System
        What moves the bodies.
    families : sequence of ConstraintFamily
        The families.
    starts : sequence of int
        The number of the first constraint of each, then how many there are.
    friction : sequence of float
        Coefficient of friction that applies where a constraint has none of its own, one for each family.
    """

    def __init__(
        self, system: System, families: Sequence[ConstraintFamily], starts: Sequence[int], friction: Sequence[float]
    ) -> None:
        self._system, self._families, self._starts, self._mu = system, families, starts, friction
        self._none = none_of(0, system.nv, False), none_of(0, system.nv, True)
        # the last rows that were all of one family
        self._single = _SingleFamily(None, None, np.zeros(0, np.int64), np.zeros(0), None)

    def of(self, t: float, q: Array, rows: Rows) -> Tangents:
        """Return the tangents of rows, numbered in the problem."""
        numbers = rows.constraint
        if numbers is self._single.numbers:
            # the same array means the same numbers: nobody writes to it
            _, family, own, mu, bodies = self._single
            if bodies is not None:
                return tangents_of_mechanism(self._system.kinematics(q), bodies, rows.point, rows.normal, mu)
            return family.tangents(t, q, Rows(own, *rows[1:]), mu)
        if not numbers.size:
            return self._none[not isinstance(rows.jacobian, np.ndarray)]
        f = bisect_right(self._starts, numbers.item(0)) - 1
        # most often all rows are of one family
        if numbers.min() >= self._starts[f] and numbers.max() < self._starts[f + 1]:
            return self._tangents_of(f, t, q, rows)
        which = np.searchsorted(self._starts, numbers, side="right") - 1
        order, parts = np.argsort(which, kind="stable"), []
        for f in np.unique(which).tolist():
            parts.append(self._tangents_of(f, t, q, take(rows, which == f)))
        together = concatenate(parts)
        # most often rows come family by family
        sorted_already = (which[:-1] <= which[1:]).all()
        return together if sorted_already else together.take(np.argsort(order, kind="stable"))

    def _tangents_of(self, f: int, t: float, q: Array, rows: Rows) -> Tangents:
        """Return the tangents of rows that are all of family number f."""
        family = self._families[f]
        own = rows.constraint - self._starts[f]
        mu = self.friction_of(f, own)
        if mu.any():
            plain = self._system.single_mechanism and type(family).tangents is ConstraintFamily.tangents
            self._single = _SingleFamily(rows.constraint, family, own, mu, family.bodies_of(own) if plain else None)
            return family.tangents(t, q, Rows(own, *rows[1:]), mu)
        return none_of(len(mu), self._system.nv, not isinstance(rows.jacobian, np.ndarray))

    def friction_of(self, f: int, own: Array) -> Array:
        """Return the coefficients of friction of some constraints of family number f, shape (k,)."""
        family = self._families[f]
        mu = family.friction_of(own)
        if np.isnan(family.friction).any():
            mu = np.where(np.isnan(mu), self._mu[f], mu)
        return np.minimum(mu, LARGEST_FRICTION)
