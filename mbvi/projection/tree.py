"""M = L'L on the tree of a mechanism's joints: L has an entry only where one joint carries the other."""

from __future__ import annotations

from copy import copy

import numpy as np
from scipy.sparse import csr_array

from ..compiled import kernel, plain_array
from ..errors import InputError
from .metric import Array, BlockMetric, Metric, triangular, whiten_full
from .tree_factor import (
    DEPENDENT,
    factor_mass,
    keep_equalities,
    solve_keeping,
    span_equalities,
    take_off,
    unwhiten,
    unwhiten_four,
    whiten,
)


@kernel("i8(f8[:,::1], f8, f8[::1], i8[::1], f8[:,::1])")
def factor(mass: Array, h: float, damping: Array, parent: Array, L: Array) -> int:
    """Write the factor of M + h D and the basis of the equalities behind it; as `factor_mass`. See `tree_factor`."""
    bad = factor_mass(mass, h, damping, parent, L)
    if not bad and len(mass) > len(parent):
        span_equalities(mass, parent, DEPENDENT, L, np.empty((0, 0)))
    return bad


@kernel("void(f8[:,::1], i8[::1], f8[:,::1], f8[:,::1], f8[:,::1])")
def solve(L: Array, parent: Array, rows: Array, whitened: Array, out: Array) -> None:
    """Write L'^-1 r and (L'L)^-1 r for every row r, shapes (m, nv); without their parts along equalities."""
    m, n = rows.shape
    for a in range(m):
        for k in range(n):
            whitened[a, k] = rows[a, k]
        whiten(L, parent, whitened[a])
        if len(L) > n:
            take_off(L, whitened[a])
        for k in range(n):
            out[a, k] = whitened[a, k]
    fours, moved = m - m % 4, np.empty(n, np.bool_)
    for a in range(0, fours, 4):
        unwhiten_four(L, parent, moved, out[a : a + 4])
    for a in range(fours, m):
        unwhiten(L, parent, out[a])


@kernel("b1(f8[::1])")
def is_damped(damping: Array) -> bool:
    """Return whether some coefficient, shape (nv,), is not zero."""
    for d in damping:
        if d != 0.0:
            return True
    return False


@kernel("i8(f8[:,::1], f8[::1], i8[::1], f8[::1], f8, f8[::1], f8[::1], f8[:,::1], f8[:,::1], f8[:,::1], f8[::1])")
def advance_keeping(
    mass: Array, damping: Array, parent: Array, v: Array, h: float, torque: Array, effects: Array, known: Array,
    L: Array, changes: Array, out: Array,
) -> int:  # fmt: skip
    """Do what `advance_by` does at order 2 with damping and equalities: each E keeps these."""
    n, time, change, loss, damped = len(v), 0.5 * h, changes[0], changes[1], known
    bad = factor(mass, 0.0, damping, parent, L)
    if bad:
        return bad
    for k in range(n):
        out[k] = v[k]
    # E acts on the part of v that keeps the equalities, and of the other the mean over the step is zero
    keep_equalities(L, parent, out)
    if len(known) == 0:
        damped = np.empty(mass.shape)
        bad = factor(mass, time, damping, parent, damped)
        if bad:
            return bad
    for k in range(n):
        change[k] = time * (torque[k] - effects[k] - damping[k] * out[k])
        out[k] = 2.0 * out[k] - v[k]
    solve_keeping(damped, parent, change)
    for i in range(4):
        for k in range(n):
            out[k] += change[k] if i < 3 else -change[k]
            loss[k] = time * damping[k] * change[k]
        if i < 3:
            solve_keeping(damped, parent, loss)
            for k in range(n):
                change[k] -= loss[k]
    return 0


@kernel("i8(f8[:,::1], f8[::1], i8[::1], f8[::1], f8, f8[::1], f8[::1], b1, f8[:,::1], f8[:,::1], f8[:,::1], f8[::1])")
def advance_by(
    mass: Array, damping: Array, parent: Array, v: Array, h: float, torque: Array, effects: Array, twice: bool,
    known: Array, L: Array, changes: Array, out: Array,
) -> int:  # fmt: skip
    """Write the velocity after a time h under forces alone; return as `factor`.

    Parameters
    ----------
    mass, parent
        See `factor`.
    damping, v, torque, effects, out : ndarray, shape (nv,)
        The diagonal of D, velocity, torques and nonlinear effects, and the result.
    h : float
        Time step [s].
    twice : bool
        Whether D acts at order 2 instead of 1; see Notes.
    known : ndarray, shape (nv + m, nv) or (0, 0)
        The factor of M + h D / 2, if it is known; it is used at order 2 with equalities.
    L : ndarray, shape (nv + m, nv)
        Receives the factor of M + h D, at order 2 of M + h D / 2, and that of M at order 2 with equalities; see
        `factor_again`.
    changes : ndarray, shape (2, nv)
        Room.

    Notes
    -----
    With F = torque - effects, order 1 is the implicit E_h(v) = v + (M + h D)^-1 h (F - D v). Order 2 is
    2 E^3(v) - E^4(v) with E = E_{h/2}, whose decay under D alone is (1 + z) / (1 + z / 2)^4 for z = h d / M: between
    exp(-z) and that of order 1, 1 / (1 + z). Where D is zero both are v + h M^-1 F to the last digit.

    With equalities the result w has J_e w = 0, at order 2 J_e (v + w) = 0: then the mean velocity of the step keeps
    them, and a step without forces keeps the energy. Each E keeps them as well.
    """
    n, time, damped = len(v), h, is_damped(damping)
    if twice and damped and len(L) > n:
        return advance_keeping(mass, damping, parent, v, h, torque, effects, known, L, changes, out)
    if twice and damped:
        time = 0.5 * h
    bad = factor(mass, time, damping, parent, L)
    if bad:
        return bad
    for k in range(n):
        out[k] = h * (torque[k] - effects[k] - damping[k] * v[k])
    whiten(L, parent, out)
    unwhiten(L, parent, out)
    if twice and damped:
        # out is twice the change of the first of four half steps; each of the others is the one before less `loss`
        change, loss = changes[0], changes[1]
        for k in range(n):
            change[k] = out[k]
        for i in range(3):
            for k in range(n):
                loss[k] = time * damping[k] * change[k]
            solve_keeping(L, parent, loss)
            for k in range(n):
                change[k] -= loss[k]
                # half the sum of the first three less the fourth
                if i == 0:
                    out[k] -= 0.5 * loss[k]
                elif i == 2:
                    out[k] += 0.5 * loss[k]
    for k in range(n):
        out[k] += v[k]
    if len(L) > n:
        for k in range(n if twice else 0):
            out[k] += v[k]
        keep_equalities(L, parent, out)
        for k in range(n if twice else 0):
            out[k] -= v[k]
    return 0


@kernel("void(f8[::1], f8[::1], f8[::1], f8[::1])")
def damp_slowed(damping: Array, free: Array, slowed: Array, out: Array) -> None:
    """Write the damping of a step in which dry friction slows joints, shape (nv,).

    The law adds the percussion of dry friction to a velocity after all damping: of order one where both act. What
    damping takes follows the mean speeds, which are nearly those in the middle of the step: d is multiplied by the
    ratio of these with and without friction, `slowed` and `free`, between a half and three halves. As any damping it
    raises no energy.
    """
    for k in range(len(out)):
        ratio = slowed[k] / free[k] if free[k] != 0.0 else 1.0
        out[k] = damping[k] * min(max(ratio, 0.5), 1.5)


@kernel("i8(f8[:,::1], f8[::1], i8[::1], b1, f8[:,::1])")
def factor_again(mass: Array, damping: Array, parent: Array, twice: bool, L: Array) -> int:
    """Write the factor of M where `advance_by` with the same arguments has left another one; return as `factor`."""
    if not is_damped(damping) or (twice and len(L) > len(parent)):
        return 0
    return factor(mass, 0.0, damping, parent, L)


def advance(
    mass: Array, damping: Array, parent: Array, v: Array, h: float, torque: Array, effects: Array, twice: bool
) -> Array:
    """Return the velocity after a time h under forces alone, shape (nv,); see `advance_by`.

    Raises
    ------
    InputError
        If the matrix that is factored is not positive definite.
    """
    out, L = np.empty(len(v)), np.empty(mass.shape)
    bad = advance_by(mass, damping, parent, v, h, torque, effects, twice, L[:0], L, np.empty((2, len(v))), out)
    if bad:
        raise _indefinite(bad, len(parent))
    return out


def _indefinite(bad: int, size: int) -> InputError:
    return InputError(
        f"the mass matrix is not positive definite (row {bad - 1} of {size}): "
        "check masses, inertias and the coordinates' redundancy"
    )


class TreeFreeMotion:
    """Free motion of one mechanism within a step, computed when it is needed.

    Parameters
    ----------
    mass, damping, parent, v, h, torque, effects, twice
        See `advance_by`.
    friction : ndarray, shape (nv,), optional
        Largest torques of the dry friction of joints, which the free motion leaves out [N, N m].

    Attributes
    ----------
    friction : ndarray, shape (nv,), or None
        Their largest percussions; see `Metric`.
    """

    __slots__ = ("friction", "kernel_arguments")

    def __init__(
        self, mass: Array, damping: Array, parent: Array, v: Array, h: float, torque: Array, effects: Array,
        twice: bool = False, friction: Array | None = None,
    ) -> None:  # fmt: skip
        self.kernel_arguments = mass, damping, parent, v, h, torque, effects, twice
        self.friction = None if friction is None else h * friction

    @property
    def free(self) -> Array:
        """The velocity after the step under forces alone, shape (nv,)."""
        return advance(*self.kernel_arguments)

    @property
    def metric(self) -> TreeMetric:
        """M."""
        mass, _, parent, *_ = self.kernel_arguments
        return TreeMetric(mass, parent, self.friction)


class TreeMetric:
    """The mass matrix of one mechanism.

    Parameters
    ----------
    mass : ndarray, shape (nv + m, nv)
        M, of which the lower triangle is read, and the rows of the equalities, if there are any. Forces and gradients
        then lose their parts along these: the metric is M on the velocities that keep the equalities.
    parent : ndarray of int, shape (nv,)
        The velocity that carries each one, -1 where there is none.
    friction : ndarray, shape (nv,), optional
        See `Metric`.

    Attributes
    ----------
    hinges : ndarray, shape (k, nv), or None
        See `Metric`.

    Raises
    ------
    InputError
        If M is not positive definite.
    """

    hinges: Array | None = None

    def __init__(self, mass: Array, parent: Array, friction: Array | None = None) -> None:
        self.lower, self.parent, self.friction = np.zeros(mass.shape), parent, friction
        bad = factor_mass(mass, 0.0, np.zeros(len(parent)), parent, self.lower)
        if bad:
            raise _indefinite(bad, len(parent))
        rows = len(mass) - len(parent)
        # that of `span_equalities`
        self.triangle = np.empty((rows, rows))
        if rows:
            span_equalities(mass, parent, DEPENDENT, self.lower, self.triangle)
        # the factor itself, and the basis of the equalities
        self._factor, self._basis = self.lower[: len(parent)], self.lower[len(parent) :]

    def with_friction(self, friction: Array | None, hinges: Array | None = None) -> TreeMetric:
        """Return the metric with other percussions of dry friction; see `Metric`."""
        other = copy(self)
        other.friction, other.hinges = friction, hinges
        return other

    def keeping(self, rows: Array) -> TreeMetric:
        """Return the same metric on the velocities that keep other equalities, with J_e of the shape (m, nv)."""
        other, n = copy(self), len(self.parent)
        other.lower, other.triangle = self.lower.copy(), np.empty(self.triangle.shape)
        span_equalities(np.concatenate([np.empty((n, n)), rows]), self.parent, DEPENDENT, other.lower, other.triangle)
        other._factor, other._basis = other.lower[:n], other.lower[n:]
        return other

    def apply(self, w: Array) -> Array:
        return self._factor.T @ (self._factor @ w)

    def whiten(self, w: Array) -> Array:
        whitened = triangular(self._factor.T, w, 0)
        if len(self._basis):
            whitened = np.array(whitened.T, order="C").reshape(-1, len(w))
            for row in whitened:
                take_off(self.lower, row)
            whitened = whitened.T.reshape(w.shape)
        return whitened

    def unwhiten(self, y: Array) -> Array:
        return triangular(self._factor.T, y, 1)

    def tangent(self, v: Array) -> Array:
        """Return the nearest velocity that keeps the equalities, shape (nv,)."""
        kept = v.copy()
        keep_equalities(self.lower, self.parent, kept)
        return kept

    def solve_rows(self, rows: Array) -> Array:
        out = np.empty(rows.shape)
        solve(self.lower, self.parent, plain_array(rows), np.empty(rows.shape), out)
        return out

    def whiten_rows(self, rows: csr_array) -> csr_array:
        return whiten_full(self, rows)

    def dense(self) -> Array:
        return self._factor.T @ self._factor


def tangent(metric: Metric, v: Array) -> Array:
    """Return the nearest velocity that keeps the equalities of a metric, shape (nv,); v itself where there are none."""
    if isinstance(metric, BlockMetric):
        return np.concatenate([tangent(part, v[s]) for part, s in zip(metric.parts, metric.slices, strict=True)])
    return metric.tangent(v) if isinstance(metric, TreeMetric) and len(metric.lower) > len(v) else v
