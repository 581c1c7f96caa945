"""Derivatives of motions with Coulomb friction: of accelerations within modes, and of the law of an impact."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np

from ...errors import SensitivityError
from ...schemes.event_driven.friction.modes import ContactModes, rows_of_modes
from ...schemes.event_driven.rows.contact_rows import SmoothRows
from ...schemes.event_driven.runge_kutta import DEPENDENT, RungeKuttaStep
from ...system.system import Array, System
from ..parameters.parameters import Parameters
from .differences import along
from .linear_law import LinearLaw
from .point_rows import PointRows

# effect of such forces on derivatives, relative to these, above which they are not determined
_AMBIGUOUS = 1e-6
# a slip begins or stops in a step in which it changes by more than the inverse of this
_BEGINS = 0.1
# first turn, most turns and the last one of the direction in which a slip stops [rad]
_TURN, _MOST_TURNS, _TURNED = 1e-3, 30, 1e-13
# time before a stop and after the begin of a slip in which its direction is not followed [s]: what the friction across
# it takes from variations is taken at the stop
_SHORT = 1e-7
# the same in which rounding of slips is too large to tell whether contacts share their load at will [s]
_BRIEF = 1e-3


class Smooth(Protocol):
    """What is known without friction, as `Linearised` has it."""

    parameters: Parameters
    system: System
    rows: SmoothRows

    def rows_by_q(self, t: float, q: Array, v: Array, index: Array) -> tuple[Array, Array]:
        """Return the derivatives by q of gradients of rows, and of their bias."""

    def at_constant_force(self, t: float, q: Array, v: Array, a: Array, force: Array) -> Array:
        """Return the derivative of the acceleration a under a constant generalised force."""

    def momenta(self, q: Array, w: Array) -> Array:
        """Return the derivative of M w by q at a constant w."""


class ChosenModes(NamedTuple):
    """Modes of closed contacts, see `ContactModes`."""

    rows: Array
    sticks: Array
    way: Array


class Percussions(NamedTuple):
    """An impact on k rows with friction.

    Attributes
    ----------
    after : ndarray, shape (nv,)
        The velocity after it.
    normal, tangential : ndarray, shapes (k,) and (k, 2)
        Percussions along gradients and tangents.
    sticks : ndarray, shape (k,) of bool
        Which rows stick.
    """

    after: Array
    normal: Array
    tangential: Array
    sticks: Array


class FrictionDerivatives:
    """Derivatives with the friction of contacts, by (q, v) and the parameters of a `Linearised`.

    Parameters
    ----------
    linear : Smooth
        What is known without friction.
    modes : ContactModes
        Receives the modes in which the contacts are.
    steps : ndarray, shape (nv,)
        Lengths of differences along each velocity.
    frictions : ndarray, shape (m, parameters.count)
        Derivatives of the coefficient of friction of each constraint by the parameters.
    name : callable
        name(number) -> that of a constraint.
    """

    def __init__(
        self, linear: Smooth, modes: ContactModes, steps: Array, frictions: Array, name: Callable[[int], str]
    ) -> None:
        self._linear, self.modes, self._steps, self._frictions, self._name = linear, modes, steps, frictions, name
        self._hold = self._brief = False
        self._points = PointRows(linear.system)

    def turning(self, step: RungeKuttaStep) -> list[float]:
        """Return the shares of a step up to and from which directions of slip are held, in the present modes."""
        index, slips = self.modes.index, ~self.modes.sticks
        if not slips.any():
            return []
        states = (step.t, step.q0, step.v0), (step.t + step.h, step.q, step.v)
        first, last = (np.linalg.norm(self.modes.equations(*state, index).slip, axis=1)[slips] for state in states)
        begins, stops = (first < _BEGINS * last).any(), (last < _BEGINS * first).any()
        share = min(_SHORT / step.h, 0.5)
        return [share] * bool(begins) + [1.0 - share] * bool(stops)

    def hold_directions(self, t: float, q: Array, v: Array) -> None:
        """Leave out in what follows how directions of slip turn, if one is about to stop or has just begun."""
        equations, found = self.modes.forces(t, q, v, self.modes.index)
        rates = np.linalg.norm(equations.T @ found.acceleration - equations.along, axis=1)
        slips = ~self.modes.sticks & (equations.mu > 0.0)
        size = np.linalg.norm(equations.slip, axis=1)[slips]
        self._hold, self._brief = (bool((size < time * rates[slips]).any()) for time in (_SHORT, _BRIEF))

    def accelerations(self, t: float, q: Array, v: Array, closed: Array) -> Array:
        """Return the derivative of accelerations in the present modes, shape (nv, 2 nv + m)."""
        linear, n = self._linear, len(v)
        equations, found = self.modes.forces(t, q, v, closed)
        (_, metric, J, _, _), T, mu, sticks = equations.normals, equations.T, equations.mu, self.modes.sticks
        way, slips = self.modes.directions(equations), ~sticks & (equations.mu > 0.0)
        kept, forced, held = rows_of_modes(J, T, mu, sticks, way)
        gradients, biases = linear.rows_by_q(t, q, v, closed)
        turned, turned_biases = self._tangents_by_q(t, q, v, closed, bool(held.any()))
        # derivatives at constant contact forces
        force = found.normal @ J + np.einsum("ic,icj->j", found.tangential, T)
        out = linear.at_constant_force(t, q, v, found.acceleration, force)
        # what the same forces do where gradients, tangents, directions of slip and mu vary
        slopes = np.concatenate([np.einsum("icjk,j->ick", turned, v), T], axis=2)
        across = np.einsum("icj,icd,idm->ijm", T, _across(equations.slip, slips & (not self._hold)), slopes)

        def pushing(normal: Array, tangential: Array) -> Array:
            pushed = np.zeros_like(out)
            pushed[:, :n] = np.einsum("ijk,i->jk", gradients, normal) + np.einsum("icjk,ic->jk", turned, tangential)
            load = np.where(slips, normal, 0.0)
            pushed[:, : 2 * n] -= np.einsum("i,ijm->jm", load * mu, across)
            pushed[:, 2 * n :] -= np.einsum("i,icj,ic,im->jm", load, T, way, self._of_rows(closed))
            return pushed

        pushed = pushing(found.normal, found.tangential)
        out += metric.solve_rows(np.ascontiguousarray(pushed.T)).T
        # then of the forces, which keep J a + (dJ/dt) v of all rows and of tangents that stick zero
        second, bias = np.concatenate([gradients, turned[held]]), np.concatenate([biases, turned_biases[held]])
        opening = kept @ out
        opening[:, :n] += np.einsum("ijk,j->ik", second, found.acceleration) + bias
        opening[:, n : 2 * n] += second @ v + np.einsum("ijk,j->ik", second, v)
        response = metric.solve_rows(forced)
        G = kept @ response.T
        by_forces, _, rank, _ = np.linalg.lstsq(G, opening, rcond=DEPENDENT)
        out -= response.T @ by_forces
        shared = not found.unique
        if rank < len(G) and slips.any() and not self._brief:
            # forces that dependent contacts may share at will must not matter where slips turn, either
            size = max(np.abs(found.normal).max(), np.abs(found.tangential).max())
            for loose in np.linalg.svd(G)[2][rank:] * size:
                tangential = -(mu * loose[: len(J)])[:, None] * np.where(slips[:, None], way, 0.0)
                tangential[held] = loose[len(J) :]
                effect = metric.solve_rows(np.ascontiguousarray(pushing(loose[: len(J)], tangential).T)).T
                effect = effect - response.T @ np.linalg.lstsq(G, kept @ effect, rcond=DEPENDENT)[0]
                shared = shared or bool(np.abs(effect).max() > _AMBIGUOUS * np.abs(out).max())
        if shared:
            names = {self._name(number) for number in linear.rows.number[closed].tolist()}
            raise SensitivityError("contacts share their load at will, on which it depends", t, tuple(names))
        return np.asarray(out)

    def law(
        self, t: float, q: Array, v: Array, rows: Array, hit: Array, e: Array, found: Percussions
    ) -> LinearLaw:  # fmt: skip
        """Return the law (8) with Coulomb's law on rows that all bear a percussion, with its derivatives.

        Arguments are those of `Linearised.law`, and the impact on the rows.
        """
        linear, n, k = self._linear, len(v), len(rows)
        J, metric = linear.rows.gradients(t, q, rows), linear.system.metric(q)
        tangents = linear.rows.tangents(t, q, rows)
        T, mu = np.asarray(tangents.jacobian).reshape(k, 2, n), tangents.friction
        slip, slips = T @ found.after, ~found.sticks & (mu > 0.0)
        size = np.linalg.norm(slip, axis=1)
        way = np.where(slips[:, None], slip / np.where(slips, size, 1.0)[:, None], 0.0)
        kept, forced, held = rows_of_modes(J, T, mu, found.sticks, way)
        gradients, _ = linear.rows_by_q(t, q, v, rows)
        turned, _ = self._tangents_by_q(t, q, v, rows)
        inertia, load = metric.dense(), np.where(slips, found.normal, 0.0)
        turning = np.einsum("i,icj,icd->ijd", load * mu, T, _across(slip, slips))
        # M w = J' p + T' r vary together, where r of slipping contacts turns with the slip after the impact
        jump = found.after - v
        by_q = np.einsum("ijk,i->jk", gradients, found.normal) + np.einsum("icjk,ic->jk", turned, found.tangential)
        by_q -= linear.momenta(q, jump) + np.einsum("ijd,idlm,l->jm", turning, turned, found.after)
        by_p = inertia @ linear.parameters.jumps(q, jump)
        by_p -= np.einsum("i,icj,ic,im->jm", load, T, way, self._of_rows(rows))
        loads = np.hstack([by_q, inertia, np.zeros((n, k)), by_p])
        targets = np.zeros((len(kept), loads.shape[1]))
        left, second = np.zeros((len(kept), 1)), np.concatenate([gradients, turned[held]])
        left[:k, 0] = np.where(hit, -e, 0.0)
        targets[:, :n] = np.einsum("ijk,ij->ik", second, left * v - found.after)
        targets[:, n : 2 * n] = left * kept
        targets[range(k), range(2 * n, 2 * n + k)] = np.where(hit, -(J @ v), 0.0)
        inverse = np.linalg.inv(inertia + np.einsum("ijd,idl->jl", turning, T))
        out = inverse @ loads
        response = inverse @ forced.T
        out += response @ np.linalg.lstsq(kept @ response, targets - kept @ out, rcond=DEPENDENT)[0]
        # the velocity itself, with the modes and directions that were found
        plain = metric.solve_rows(forced)
        share = np.linalg.lstsq(kept @ plain.T, left[:, 0] * (kept @ v) - kept @ v, rcond=DEPENDENT)[0]
        return LinearLaw(v + share @ plain, *np.split(out, [n, 2 * n, 2 * n + k], axis=1))

    def by_bounces(self, t: float, q: Array, before: Array, after: Array, closed: Array, rows: Array) -> Array:
        """Return the velocity that the forces of closed contacts spend on ending the bounces of rows, shape (nv, k).

        An e above 0 lets a row that closes open with e times its rate `before`. The forces then end this rate, and
        bear in the present modes: those of contacts that slip along their slip `after` the impact.
        """
        equations = self.modes.equations(t, q, after, closed)
        J, metric, way = equations.normals.J, equations.normals.metric, self.modes.directions(equations)
        kept, forced, _ = rows_of_modes(J, equations.T, equations.mu, self.modes.sticks, way)
        own, opening = np.flatnonzero(np.isin(closed, rows)), np.zeros((len(kept), len(rows)))
        opening[own, rows.searchsorted(closed[own])] = np.minimum(J[own] @ before, 0.0)
        response = metric.solve_rows(forced)
        return np.asarray(-response.T @ np.linalg.lstsq(kept @ response.T, opening, rcond=DEPENDENT)[0])

    def slip(self, t: float, q: Array, v: Array, row: Array) -> tuple[Array, Array, Array]:
        """Return what the slip of one row varies by, T by v and dT v by q, shapes (2, nv), and -(dT/dt) v."""
        tangents = self._linear.rows.tangents(t, q, row)
        turned, _ = self._tangents_by_q(t, q, v, row)
        along = -self._linear.rows.slips(t, q, v, row)[1].ravel()
        return np.asarray(tangents.jacobian), np.einsum("icjk,j->ick", turned, v)[0], along

    def turn_to_stop(self, t: float, q: Array, v: Array, closed: Array, k: int) -> Array:
        """Turn the direction of slip of the closed row number k to the one in which it stops, and return it.

        There its slip does not turn any more: the acceleration of the slip is along it.
        """
        equations, _ = self.modes.forces(t, q, v, closed)
        chosen, T, along = self.modes.directions(equations), equations.T[k], equations.along[k]

        def turning(angle: float) -> float:
            chosen[k] = np.cos(angle), np.sin(angle)
            slip_rate = T @ equations.forces(self.modes.sticks, chosen).acceleration - along
            return float(chosen[k, 0] * slip_rate[1] - chosen[k, 1] * slip_rate[0])

        if not T.any(axis=1).all():
            # a planar motion, whose slip has one direction
            return np.asarray(chosen[k])
        angle = float(np.arctan2(chosen[k, 1], chosen[k, 0]))
        other, value = angle + _TURN, turning(angle)
        for _ in range(_MOST_TURNS):
            next_value = turning(other)
            if next_value == value:
                break
            angle, other, value = other, other - next_value * (other - angle) / (next_value - value), next_value
            if abs(other - angle) < _TURNED:
                break
        chosen[k] = np.cos(other), np.sin(other)
        self.modes.way = np.vecmat(chosen, equations.axes)
        return np.asarray(chosen[k])

    def stopped_across(self, t: float, q: Array, v: Array, closed: Array, k: int, X: Array) -> Array:
        """Return variations X with no slip across the direction in which the closed row number k stops.

        Its friction turns with the slip, faster and faster, until the slip of a variation has the same direction.
        """
        equations, _ = self.modes.forces(t, q, v, closed)
        _, metric, J, _, _ = equations.normals
        way, n = self.modes.directions(equations), len(v)
        kept, forced, held = rows_of_modes(J, equations.T, equations.mu, self.modes.sticks, way)
        gradients, _ = self._linear.rows_by_q(t, q, v, closed)
        turned, _ = self._tangents_by_q(t, q, v, closed)
        across = np.array([-way[k, 1], way[k, 0]])
        kept = np.vstack([kept, across @ equations.T[k]])
        if not kept[-1].any():
            return X
        forced = np.vstack([forced, kept[-1]])
        second = np.concatenate([gradients, turned[held], [np.einsum("c,cjk->jk", across, turned[k])]])
        off = np.einsum("ijk,j->ik", second, v) @ X[:n] + kept @ X[n:]
        response = metric.solve_rows(forced)
        return np.vstack([X[:n], X[n:] - response.T @ np.linalg.lstsq(kept @ response.T, off, rcond=DEPENDENT)[0]])

    def still(self, t: float, q: Array, v: Array, closed: Array) -> Array:
        """Return which closed rows have no slip, shape (k,) of bool."""
        equations = self.modes.equations(t, q, v, closed)
        return np.asarray(np.linalg.norm(equations.slip, axis=1) <= equations.still)

    def with_sticking(
        self, t: float, q: Array, v: Array, closed: Array, J: Array, gradients: Array, starts: bool
    ) -> tuple[Array, Array]:  # fmt: skip
        """Return gradients of closed rows and their derivatives by q, with those of tangents that stick added.

        Where the motion `starts`, these are all tangents without slip.
        """
        T = np.asarray(self._linear.rows.tangents(t, q, closed).jacobian).reshape(len(closed), 2, len(v))
        still = self.still(t, q, v, closed) if starts else self.modes.sticks
        held = still[:, None] & T.any(axis=2)
        turned, _ = self._tangents_by_q(t, q, v, closed)
        return np.concatenate([J, T[held]]), np.concatenate([gradients, turned[held]])

    def _tangents_by_q(
        self, t: float, q: Array, v: Array, index: Array, biased: bool = False
    ) -> tuple[Array, Array]:  # fmt: skip
        """Return the derivatives by q of tangents of rows, shape (k, 2, nv, nv), and of (dT/dt) v, (k, 2, nv).

        The second are zero unless `biased`.
        """
        rows, k, n = self._linear.rows, len(index), len(v)
        gradients, biases = np.zeros((k, 2, n, n)), np.zeros((k, 2, n))
        rough = np.flatnonzero(rows.tangents(t, q, index).friction > 0.0)
        table = rows.body_points(index[rough])
        known = self._points.known(table)
        one, others = rough[known], index[rough[~known]]
        if one.size:
            gradients[one], biases[one] = self._of_points(t, q, v, index[one], table[known])
        if not others.size:
            return gradients, biases

        def both(dq: Array) -> Array:
            there = self._linear.system.integrate(q, dq)
            tangents = np.asarray(rows.tangents(t, there, others).jacobian)
            bias = rows.slips(t, there, v, others)[1].ravel() if biased else np.zeros(len(tangents))
            return np.column_stack([tangents, bias])

        found = along(both, self._steps).reshape(len(others), 2, n + 1, n)
        gradients[rough[~known]], biases[rough[~known]] = found[:, :, :n], found[:, :, n]
        return gradients, biases

    def _of_points(self, t: float, q: Array, v: Array, index: Array, table: Array) -> tuple[Array, Array]:
        """Return `_tangents_by_q` of rows whose contact points stay where they are from points of bodies."""
        rows, n, body = self._linear.rows, len(v), table[:, 0].astype(np.int64)
        axes, (at, _) = rows.tangents(t, q, index).axes, rows.points(t, q, index)
        place = self._linear.system.placements(q, body)
        offset = at - np.einsum("kij,ki->kj", place[:, :3], table[:, 1:4]) - place[:, 3]
        wide = np.column_stack([table[:, :4].repeat(2, axis=0), axes.reshape(-1, 3)])
        arms = np.cross(offset[:, None], axes).reshape(-1, 3)
        moves, turns = self._points.by_q(q, v, wide), self._points.turns_by_q(q, v, wide[:, 0], arms)
        return (moves[0] + turns[0]).reshape(-1, 2, n, n), (moves[1] + turns[1]).reshape(-1, 2, n)

    def _of_rows(self, index: Array) -> Array:
        return self._frictions[self._linear.rows.number[index]]


def _across(slip: Array, slips: Array) -> Array:
    """Return the derivatives of directions of slip by the slip, shape (k, 2, 2); zero where nothing slips."""
    size = np.linalg.norm(slip, axis=1)
    moves = slips & (size > 0.0)
    size = np.where(moves, size, 1.0)
    way = slip / size[:, None]
    across = (np.eye(2) - way[:, :, None] * way[:, None, :]) / size[:, None, None]
    return np.where(moves[:, None, None], across, 0.0)
