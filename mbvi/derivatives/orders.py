"""The orders of single impacts into which variations divide an impact on several constraints."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..problem import Problem
from ..projection import Projector
from ..schemes.event_driven.motion_state import NO_ROWS
from ..schemes.event_driven.runge_kutta import least_percussion
from ..system.system import Array
from .directions import Directions
from .impacts import as_one, cosines_of
from .located_impact import LocatedImpact
from .variation import Variation

# relative percussion above which a row bears one
_BEARS = 1e-12
# contact force, as an acceleration relative to the terms it consists of and to a length of the scene a second squared,
# below which a contact opens
_OPENS = -1e-6
# least share of its conditions that variations of an order have in the middle of them
_OPEN = 1e-9
# rate, and difference of two shifts of time, that count as zero, relative to the largest that the speeds allow
_EQUAL = 1e-7
# most single impacts of an order
_MOST_IMPACTS = 20


@dataclass(frozen=True)
class Order:
    """Single impacts in one order, which follow each other at once.

    Attributes
    ----------
    v : ndarray, shape (nv,)
        Velocity after the last of them.
    closed : ndarray of int
        Rows that are closed then.
    X : ndarray, shape (2 nv, p)
        The variations after it.
    conditions : ndarray, shape (c, p)
        The order is that of the variations x with conditions @ x > 0 [s].
    impacts : tuple of ndarray of int
        The rows of each impact, which act as one.
    """

    v: Array
    closed: Array
    X: Array
    conditions: Array
    impacts: tuple[Array, ...]


class Branching(Variation):
    """Carries variations to the first impact that has derivatives on some sides only, and over it in each order.

    Parameters
    ----------
    problem, tolerance, varied
        As of `Variation`.
    conditions : ndarray, shape (c, p)
        Variations x have conditions @ x > 0; also an attribute.
    """

    def __init__(self, problem: Problem, tolerance: float, varied: Directions, conditions: Array) -> None:
        super().__init__(problem, tolerance, varied)
        self.conditions = conditions

    @property
    def fork(self) -> LocatedImpact | None:
        """The impact that has derivatives on some sides only, if there was one."""
        return self._saltation.fork

    def names(self, rows: Array) -> tuple[str, ...]:
        """Return the names of the constraints of some rows."""
        return tuple(map(self._name, np.unique(self._linear.rows.number[rows]).tolist()))

    def orders(self) -> Iterator[Order]:
        """Yield each order of single impacts that some variations bring about."""
        fork = self._saltation.fork
        assert fork is not None
        was_closed = np.isin(fork.rows, np.union1d(fork.closed_before, fork.held_before))
        found, pending = False, [Order(fork.before, fork.rows[was_closed], self._X, self.conditions, ())]
        while pending:
            order = pending.pop()
            groups = self._closing(fork, order)
            if not groups:
                found = True
                yield order
                continue
            if len(order.impacts) == _MOST_IMPACTS:
                reason = f"several close at once, and more than {_MOST_IMPACTS} single impacts may follow each other"
                self._refuse(reason, fork.rows, fork.t)
            for k, group in enumerate(groups):
                later = [self._later(fork, order, group, other) for j, other in enumerate(groups) if j != k]
                conditions = np.vstack([order.conditions, *later])
                if _some(conditions):
                    pending.append(self._struck(fork, order, group, conditions))
        if not found:
            self._refuse("several close at once, and no variation makes one of them close first", fork.rows, fork.t)

    def _closing(self, fork: LocatedImpact, order: Order) -> list[Array]:
        """Return the rows that close after some single impacts, in groups that act as one."""
        rows = np.setdiff1d(fork.rows, order.closed)
        J = self._linear.rows.gradients(fork.t, fork.q, rows)
        rates, slowest = J @ order.v, self._saltation.slowest(rows, J, order.v)
        if (np.abs(rates) < slowest).any():
            grazes = rows[np.abs(rates) < slowest]
            self._refuse("several close at once, and in some order one of them grazes", grazes, fork.t)
        closing = rates < 0.0
        if not closing.any():
            return []
        held = self._linear.rows.gradients(fork.t, fork.q, order.closed)
        cosines = cosines_of(self._linear.system.metric(fork.q), J[closing], held)
        return [rows[closing][one] for one in as_one(cosines)]

    def _later(self, fork: LocatedImpact, order: Order, group: Array, other: Array) -> Array:
        """Return by how much later variations make another group close than the first one, shape (p,)."""
        both, n = (group[:1], other[:1]), len(order.v)
        first, second = (self._saltation.shift(fork.t, fork.q, order.v, row, order.X) for row in both)
        J = np.concatenate([self._linear.rows.gradients(fork.t, fork.q, row) for row in both])
        # what rounding and the tolerance explain
        longest = ((np.abs(J) @ self._linear.units[:n]) / np.abs(J @ order.v)).max()
        size = np.abs(order.X / self._linear.units[:, None]).max(axis=0)
        later = second - first
        return np.where(np.abs(later) > _EQUAL * longest * size, later, 0.0)

    def _struck(self, fork: LocatedImpact, order: Order, group: Array, conditions: Array) -> Order:
        """Return what follows the next single impact."""
        linear, t, q, v = self._linear, fork.t, fork.q, order.v
        n, touching = len(v), np.union1d(group, order.closed)
        J, metric, hit = linear.rows.gradients(t, q, touching), linear.system.metric(q), np.isin(touching, group)
        e = linear.rows.restitution[touching]
        found = Projector().project(v, metric, J, np.where(hit, -e * (J @ v), 0.0))
        rates = J @ found.velocity
        bears = found.percussion > _BEARS * found.percussion.max()
        still = np.abs(rates) <= _EQUAL * (np.abs(J) @ np.abs(v))
        weak = ~bears & ~still & (rates < self._saltation.slowest(touching, J, v))
        if weak.any():
            self._refuse("a closed contact opens there with hardly any speed", touching[weak], t)
        stays = ~hit & (bears | still)
        closed = touching[stays | (hit & (e == 0.0))]
        rows = touching[stays | (hit & bears)]
        law = linear.law(t, q, v, rows, np.isin(rows, group), linear.rows.restitution[rows])
        if (np.abs(law.after - found.velocity) > _EQUAL * self._linear.units[:n] * self._speed(v)).any():
            self._refuse("a single impact is not that of the rows that bear a percussion", touching, t)
        before_closed = fork.closed_before if not order.impacts else order.closed
        a, b = (
            linear.flow.acceleration(t, q, w, some)[:n] for w, some in ((v, before_closed), (law.after, closed))
        )  # fmt: skip
        self._saltation.check_group(fork, group, alone=not stays.any())
        self._check_forces(fork, order, law.after, closed, np.intersect1d(group, closed))
        ends = bool((e[hit] == 0.0).any())
        X = self._saltation.over(law, rows, group[:1], (t, q, v, a), (law.after, b), order.X, ends=ends)
        return Order(law.after, closed, X, conditions, (*order.impacts, group))

    def _speed(self, v: Array) -> float:
        """Return the largest velocity in lengths of the scene and radians a second."""
        return float(np.abs(v / self._linear.units[: len(v)]).max())

    def _check_forces(self, fork: LocatedImpact, order: Order, v: Array, closed: Array, rests: Array) -> None:
        """Refuse contacts that an impact leaves closed, of which it closes `rests`, and that forces or columns open."""
        struck = np.intersect1d(order.closed, np.concatenate([NO_ROWS, *order.impacts]))
        if self.varied.by_e[self._linear.rows.number[struck]].any():
            self._refuse("by e = 0 it has none where another impact follows at once", struck, fork.t)
        if not closed.size:
            return
        by_e = self.varied.by_e[self._linear.rows.number[rests]].any()
        if rests.size and (by_e or self.varied.by_p.any()):
            self._saltation.check_forces(fork.t, fork.q, v, closed, rests, "e = 0" if by_e else "parameters")
        free, metric, J, wanted, scale = self._linear.flow.contact_equations(fork.t, fork.q, v, closed)
        G = J @ metric.solve_rows(J).T
        scale = scale + np.abs(J) @ self._linear.units[: len(v)]
        pulled = least_percussion(G, wanted - J @ free) * G.diagonal() < _OPENS * scale
        if pulled.any():
            reason = "several close at once, and in some order one lifts off between impacts"
            self._refuse(reason, closed[pulled], fork.t)


def _some(conditions: Array) -> bool:
    """Return whether some x has conditions @ x > 0, in all of them."""
    # imported here because it is slow to import
    from scipy.optimize import linprog

    if not conditions.size:
        return not len(conditions)
    size = np.abs(conditions).max(axis=0)
    scaled = conditions / np.where(size > 0.0, size, 1.0)
    length = np.abs(scaled).sum(axis=1)
    if (length == 0.0).any():
        return False
    # the largest m with conditions @ x >= m for some |x| <= 1
    c, count = len(scaled), scaled.shape[1]
    A = np.hstack([-scaled / length[:, None], np.ones((c, 1))])
    found = linprog(np.eye(count + 1)[-1] * -1.0, A, np.zeros(c), bounds=[(-1.0, 1.0)] * (count + 1))
    return bool(-found.fun > _OPEN)
