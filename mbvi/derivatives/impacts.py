"""The saltation of variations at a located impact, and the refusal of impacts that have no derivative."""

from __future__ import annotations

from collections.abc import Callable
from typing import NoReturn

import numpy as np

from ..projection.metric import Metric
from ..schemes.event_driven.motion_state import certain_rates
from ..schemes.event_driven.runge_kutta import least_percussion
from ..system.system import Array
from .directions import Directions
from .located_impact import ImpactFriction, LocatedImpact
from .motion.friction import Percussions
from .motion.linear_law import LinearLaw
from .motion.linearised import Linearised

# cosines of kinetic angles below this count as zero, and above one less this as one
_COSINE = 1e-9
# relative percussion above which a row bears one
_BEARS = 1e-12
# largest difference of velocities, and of the matrices of two orders, that rounding explains; relative
_ROUNDING = 1e-7

# how near to the edge of the cone, relative to it, a contact that sticks in an impact may be
_EDGE = 1e-7
# contact force, as an acceleration relative to the terms it consists of, that keeps a contact closed
_PRESSED = 1e-6

Refuse = Callable[[str, Array, float], NoReturn]


class Saltation:
    """Carries variations over impacts.

    Parameters
    ----------
    linear : Linearised
        The derivatives of the motion.
    varied : Directions
        The columns of the variations.
    length : float
        That of the scene [m].
    slowest : float
        Impacts slower than this are refused as grazing: relative to the largest speed that the row could have at this
        speed of its bodies plus one length of the scene a second.
    refuse : callable
        refuse(reason, rows, time) raises `SensitivityError`.

    Attributes
    ----------
    fork : LocatedImpact or None
        The impact that was refused because the order of single impacts matters.

    Notes
    -----
    One row closes, at the rate J v- < 0: a variation x = (dq, dv) shifts the time by s = -(J dq + df) / (J v-), with
    df that of the gap by the place of its wall, and what
    follows is R (x + F- s) - F+ s with the fields F = (v, dv/dt) before and after, and R the derivative of the law on
    the rows that bear a percussion. Rows that close together are taken one after the other; if the order matters there
    is no derivative.
    """

    def __init__(self, linear: Linearised, varied: Directions, length: float, slowest: float, refuse: Refuse) -> None:
        self._linear, self._length, self._slowest, self._refuse = linear, length, slowest, refuse
        self._varied = varied
        # the rows that have had impacts
        self._struck: set[int] = set()
        self.fork: LocatedImpact | None = None

    def slowest(self, rows: Array, J: Array, v: Array) -> Array:
        """Return the rates of rows [m/s, rad/s] below which an impact is refused as grazing."""
        return np.asarray(self._slowest * (np.abs(J) @ np.abs(v) + self._length / self._linear.rows.lever[rows]))

    def carried(self, impact: LocatedImpact, X: Array) -> Array:
        """Return variations X, shape (2 nv, p), after an impact."""
        rows, q, v = impact.rows, impact.q, impact.before
        J = self._linear.rows.gradients(impact.t, q, rows)
        before = J @ v
        was_closed = np.isin(rows, np.union1d(impact.closed_before, impact.held_before))
        hit = ~was_closed & (before < -certain_rates(J, v, 0.0))
        self._check_rows(impact, J, before, hit, was_closed)
        rests = np.intersect1d(impact.closed_after, rows[hit])
        by_e = self._varied.by_e[self._linear.rows.number[rests]].any()
        if rests.size and (by_e or self._varied.by_p.any()):
            by = "e = 0" if by_e else "parameters"
            self._linear.choose(None if impact.friction is None else impact.friction.after)
            self.check_forces(impact.t, impact.q, impact.after, impact.closed_after, rests, by)
            if by_e and impact.friction is not None:
                self._check_slip_after(impact, impact.friction)
        bears = impact.percussion > _BEARS * impact.percussion.max(initial=0.0)
        stays = was_closed & (bears | np.isin(rows, impact.closed_after))
        weak = was_closed & ~stays & (J @ impact.after < self.slowest(rows, J, v))
        if weak.any():
            self._refuse("a closed contact opens there with hardly any speed", rows[weak], impact.t)
        if impact.friction is not None:
            self._check_friction(impact, impact.friction, hit)
        groups = self._groups(impact, J, hit, stays)
        found = self._one_by_one(impact, groups, rows[stays], bears, X)
        for order in _other_orders(groups):
            other = self._one_by_one(impact, order, rows[stays], bears, X)
            scale = max(np.abs(one / self._linear.units[:, None]).max() for one in (X, found))
            if np.abs((other - found) / self._linear.units[:, None]).max() > _ROUNDING * scale:
                self.fork = impact
                self._refuse("several close at once, and the order in which they do matters", rows[hit], impact.t)
        return found

    def _check_friction(self, impact: LocatedImpact, friction: ImpactFriction, hit: Array) -> None:
        """Refuse impacts with friction whose derivative is not known, or does not exist."""
        rows, linear = impact.rows, self._linear
        if hit.sum() > 1:
            self._refuse("several close at once where there is friction", rows[hit], impact.t)
        changed = hit & (np.abs(friction.restitution - linear.rows.restitution[rows]) > _ROUNDING)
        if changed.any():
            self._refuse("friction lowers its restitution, so that no energy is gained", rows[changed], impact.t)
        tangents = linear.rows.tangents(impact.t, impact.q, rows)
        edge = tangents.friction * impact.percussion
        pull = np.linalg.norm(friction.tangential, axis=1)
        loose = friction.sticks & (pull > (1.0 - _EDGE) * edge)
        slip = np.asarray(tangents.jacobian).reshape(len(rows), 2, -1)
        size = np.linalg.norm(slip @ impact.after, axis=1)
        slow = (edge > 0.0) & ~friction.sticks & (size < self._slowest * self._length)
        if (loose | slow).any():
            self._refuse("it is about to stick or to slip in the impact", rows[loose | slow], impact.t)

    def _check_slip_after(self, impact: LocatedImpact, friction: ImpactFriction) -> None:
        """Refuse contacts that stick in an impact with e = 0 and slip on at once.

        The impact of a small e sticks with more of the percussion that the contact force has while it slips at e = 0.
        """
        slips = friction.after.rows[~friction.after.sticks]
        begins = friction.sticks & (impact.percussion > 0.0) & np.isin(impact.rows, slips)
        if begins.any():
            reason = "by e = 0 it has none where a contact sticks in the impact and slips after it"
            self._refuse(reason, impact.rows[begins], impact.t)

    def _check_rows(self, impact: LocatedImpact, J: Array, before: Array, hit: Array, was_closed: Array) -> None:
        """Refuse grazing, and rows that bounce without end or come to rest in another way than by e = 0."""
        rows, linear = impact.rows, self._linear
        slowest = self.slowest(rows, J, impact.before)
        still = ~was_closed & (np.abs(before) < slowest)
        e = linear.rows.restitution
        rests = np.setdiff1d(impact.closed_after, np.union1d(impact.closed_before, impact.held_before))
        endless = np.union1d(rests[e[rests] > 0.0], rows[still & (e[rows] > 0.0) & np.isin(rows, list(self._struck))])
        if endless.size:
            self._refuse("its impacts accumulate: it comes to rest after bounces without end", endless, impact.t)
        self._struck.update(rows[hit].tolist())
        if still.any():
            self._refuse(
                f"it grazes: the rate of the gap is {before[still].min():.2g}, and below {slowest[still].max():.2g} in "
                "size no derivative is given",
                rows[still],
                impact.t,
            )
        unknown = np.setdiff1d(rests, rows[hit])
        if unknown.size:
            self._refuse("it comes to rest without an impact", unknown, impact.t)

    def check_forces(self, t: float, q: Array, v: Array, closed: Array, rests: Array, by: str) -> None:
        """Refuse rows among those kept closed that carry no force: a varied motion may leave them."""
        free, metric, J, wanted, scale = self._linear.flow.contact_equations(t, q, v, closed)
        G = J @ metric.solve_rows(J).T
        if self._linear.friction is None:
            forces = least_percussion(G, wanted - J @ free) * G.diagonal()
        else:
            forces = self._linear.friction.modes.forces(t, q, v, closed)[1].normal * G.diagonal()
        loose = np.isin(closed, rests) & (forces <= _PRESSED * scale)
        if loose.any():
            self._refuse(f"by {by} it has none where no force keeps the contact closed", closed[loose], t)

    def _groups(self, impact: LocatedImpact, J: Array, hit: Array, stays: Array) -> list[Array]:
        """Return the rows that close, in groups that act as one; refuse groups that are not orthogonal.

        Orthogonal in the kinetic metric, on the velocities that keep the contacts closed that stay so.
        """
        if hit.sum() == 1:
            return [impact.rows[hit]]
        cosines = cosines_of(self._linear.system.metric(impact.q), J[hit], J[stays])
        groups = []
        for one in as_one(cosines):
            between = np.delete(cosines[one], one, axis=1).ravel()
            if np.abs(between).max(initial=0.0) > _COSINE:
                self.fork = impact
                self._refuse(
                    f"{hit.sum()} rows close at once that are not orthogonal in the kinetic metric (cosine "
                    f"{between[np.abs(between).argmax()]:.3g}): the order of impacts matters, see mbvi.forks",
                    impact.rows[hit],
                    impact.t,
                )
            groups.append(impact.rows[hit][one])
        opens = np.setdiff1d(impact.closed_before, np.concatenate([impact.rows[stays], impact.closed_after]))
        if len(groups) > 1 and opens.size:
            involved = np.union1d(impact.rows[hit], opens)
            self._refuse("several close at once, and a closed contact opens", involved, impact.t)
        for group in groups:
            self.check_group(impact, group, alone=not stays.any())
        return groups

    def check_group(self, impact: LocatedImpact, group: Array, *, alone: bool) -> None:
        """Refuse rows that act as one, but not for all variations; alone: no contact stays closed."""
        if len(group) > 1:
            self._check_gaps(impact, group)
        if len(group) > 1 and alone:
            self._check_one(impact, group)

    def _check_gaps(self, impact: LocatedImpact, group: Array) -> None:
        """Refuse rows that act as one and that a wall, moved along its normal, takes apart."""
        linear = self._linear
        length = np.linalg.norm(linear.rows.gradients(impact.t, impact.q, group), axis=1)
        by_gap = self._varied.by_gap[linear.rows.number[group]] / length[:, None]
        if np.abs(by_gap - by_gap[0]).max() > _ROUNDING * np.abs(by_gap).max():
            self._refuse("several close at once, and a moved wall takes them apart", group, impact.t)

    def _check_one(self, impact: LocatedImpact, group: Array) -> None:
        """Refuse rows of e = 0 that act as one at this configuration only."""
        linear = self._linear
        if linear.rows.restitution[group].any():
            return
        gradients, _ = linear.rows_by_q(impact.t, impact.q, impact.before, group)
        J = linear.rows.gradients(impact.t, impact.q, group)
        ratio = np.linalg.norm(J, axis=1) / np.linalg.norm(J[0])
        away = gradients - ratio[:, None, None] * gradients[0]
        if np.abs(away).max() > _ROUNDING * np.abs(J).max():
            self._refuse("several close at once, which act as one at this configuration only", group, impact.t)

    def _one_by_one(self, impact: LocatedImpact, groups: list[Array], staying: Array, bears: Array, X: Array) -> Array:
        """Return the variations after the impacts of groups of rows, one group after the other."""
        linear, t, q, v = self._linear, impact.t, impact.q, impact.before
        n, closed, bearing = len(v), impact.closed_before, impact.rows[bears]
        linear.choose(None if impact.friction is None else impact.friction.before)
        a = linear.flow.acceleration(t, q, v, closed)[:n]
        for k, group in enumerate(groups):
            rows = np.union1d(np.intersect1d(group, bearing), staying)
            hit = np.isin(rows, group)
            law = self._law(impact, v, rows, hit)
            last = k == len(groups) - 1
            kept = np.union1d(closed, np.intersect1d(group, impact.closed_after))
            closed = impact.closed_after if last else kept
            after = impact.after if last else law.after
            if last:
                self._check_velocity(impact, law.after)
            linear.choose(None if impact.friction is None else impact.friction.after)
            next_a = linear.flow.acceleration(t, q, after, closed)[:n]
            # where bounces of an e above 0 would end at once, they change nothing in the end to first order
            ends = bool(np.isin(group, impact.closed_after).any())
            if ends and linear.friction is not None:
                # but the friction of the impact itself has turned with its slip
                by_bounces = linear.friction.by_bounces(t, q, v, after, closed, rows)
                law, ends = law._replace(by_e=law.by_e - by_bounces), False
            X = self.over(law, rows, group[:1], (t, q, v, a), (after, next_a), X, ends=ends)
            v, a = after, next_a
        return X

    def _law(self, impact: LocatedImpact, v: Array, rows: Array, hit: Array) -> LinearLaw:
        """Return the law on some rows of an impact, of which some close."""
        linear, t, q, friction = self._linear, impact.t, impact.q, impact.friction
        e = linear.rows.restitution[rows]
        if friction is None or linear.friction is None:
            return linear.law(t, q, v, rows, hit, e)
        own = np.searchsorted(impact.rows, rows)
        along = np.einsum("kci,ki->kc", linear.rows.tangents(t, q, rows).axes, friction.tangential[own])
        found = Percussions(impact.after, impact.percussion[own], along, friction.sticks[own])
        return linear.friction.law(t, q, v, rows, hit, e, found)

    def over(
        self,
        law: LinearLaw,
        rows: Array,
        first: Array,
        before: tuple[float, Array, Array, Array],
        after: tuple[Array, Array],
        X: Array,
        *,
        ends: bool,
    ) -> Array:
        """Return variations X after a single impact.

        Parameters
        ----------
        law : LinearLaw
            Its law, of `rows`.
        rows, first : ndarray of int
            The rows that bear a percussion, and one of those that close, alone.
        before, after : tuple
            (t, q, v, dv/dt) and (v, dv/dt).
        X : ndarray, shape (2 nv, p)
            Variations before.
        ends : bool
            Whether the contact stays closed: by e nothing then varies.
        """
        varied, (t, q, v, a), (w, b) = self._varied, before, after
        n, shift = len(v), self.shift(t, q, v, first, X)
        of_e = law.by_e @ varied.by_e[self._linear.rows.number[rows]] * (not ends)
        dq, dv = X[:n] + np.outer(v, shift), X[n:] + np.outer(a, shift)
        return np.vstack([
            dq - np.outer(w, shift),
            law.by_q @ dq + law.by_v @ dv + of_e + law.by_p @ varied.by_p - np.outer(b, shift),
        ])  # fmt: skip

    def shift(self, t: float, q: Array, v: Array, first: Array, X: Array) -> Array:
        """Return by how much variations shift the time at which one row closes, shape (p,)."""
        J = self._linear.rows.gradients(t, q, first)
        gap = J @ X[: len(v)] + self._varied.by_gap[self._linear.rows.number[first]]
        return np.asarray(-gap[0] / float((J @ v)[0]))

    def _check_velocity(self, impact: LocatedImpact, after: Array) -> None:
        """Refuse an impact whose law is not the one that was differentiated."""
        units = self._linear.units[: len(after)]
        scale = np.abs(impact.before / units).max() + np.abs(impact.after / units).max()
        if np.abs((after - impact.after) / units).max() > _ROUNDING * scale:
            self._refuse("the impact is not that of its rows one by one", impact.rows, impact.t)


def cosines_of(metric: Metric, J: Array, held: Array) -> Array:
    """Return the cosines of the kinetic angles between rows J, on the velocities that keep others held."""
    closing = metric.whiten(np.asfortranarray(J.T))
    if held.size:
        basis, size, _ = np.linalg.svd(metric.whiten(np.asfortranarray(held.T)), full_matrices=False)
        basis = basis[:, size > _COSINE * size[0]]
        closing = closing - basis @ (basis.T @ closing)
    closing = closing / np.linalg.norm(closing, axis=0)
    return np.asarray(closing.T @ closing)


def as_one(cosines: Array) -> list[list[int]]:
    """Return the numbers of rows in groups that act as one, by the cosines of their kinetic angles."""
    left, groups = list(range(len(cosines))), []
    while left:
        groups.append([k for k in left if cosines[left[0], k] > 1.0 - _COSINE])
        left = [k for k in left if k not in groups[-1]]
    return groups


def _other_orders(groups: list[Array]) -> list[list[Array]]:
    """Return orders of some groups to compare with the given one: with two neighbours swapped, and the reverse."""
    orders = [[*groups[:k], groups[k + 1], groups[k], *groups[k + 2 :]] for k in range(len(groups) - 1)]
    return [*orders, groups[::-1]] if len(groups) > 2 else orders
