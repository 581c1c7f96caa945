"""Constraints given by a user: numbers are checked wherever they are used, gradients against differences."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

from ..arguments import all_finite, returned
from ..errors import InputError, MbviError, MbviWarning
from ..system import System
from ..system.given import not_finite, short
from .finite_differences import Slopes, slopes
from .rows import NO_POINT, Array, Constraint, Rows

# relative difference of a gradient and of differences that a user is warned of, and the part of a gradient that counts
_DIFFERENT, _SMALL = 1e-3, 1e-5
# the part of a gradient whose sign counts
_SIGNIFICANT = 1e-3
# velocities up to which a gradient is checked entry by entry; beyond along so many directions
_ENTRIES, _DIRECTIONS = 64, 8


class Given:
    """One constraint that a user gives by gaps and gradients, as an admissible set asks for it.

    Parameters
    ----------
    system : System
        What q belongs to.
    constraint : Constraint
        What the user gives.
    name : callable
        name(k) -> what its row k is called.

    Notes
    -----
    Gradients are held against central differences of the gaps along the retraction: every entry at the start and where
    a row first becomes active, then along the gradient itself, at ever fewer of the activations.
    """

    def __init__(self, system: System, constraint: Constraint, name: Callable[[int], str]) -> None:
        self._system, self._constraint, self._name = system, constraint, name
        # how often rows became active, and how often they were, both up to the last check that was passed
        self._starts, self._count, self._touching = 0, 0, False
        # the nearest that a row was then: a scheme may count rows as active long before they touch
        self._nearest = np.inf
        # whether a gradient of an active row was zero then
        self._vanishes = False
        self._warned: set[int] = set()
        # how many rows there are, once that is known
        self._size = -1

    def gaps(self, t: float, q: Array) -> Array:
        """Return f(q), shape (m,) [m or rad].

        Raises
        ------
        InputError
            If it holds anything but real numbers, or more or fewer of them than before.
        DivergedError
            If it is not finite.
        """
        gap = self._constraint.gap(t, q)
        if type(gap) is not np.ndarray or gap.dtype != np.float64 or gap.ndim != 1:
            gap = np.atleast_1d(returned(gap, f"the gap of {self._name(0)}"))
            if gap.ndim != 1:
                raise InputError(f"the gap of {self._name(0)} has shape {gap.shape}; a number or (m,) is expected")
        if len(gap) != self._size:
            if self._size >= 0:
                raise InputError(f"the gap of {self._name(0)} has {len(gap)} numbers now, and had {self._size} before")
            self._size = len(gap)
        if not all_finite(gap):
            worst = int(np.argmin(np.isfinite(gap)))
            raise not_finite(f"f of {self._name(worst)}", gap[worst], t, q)
        return gap

    def gradients(self, t: float, q: Array) -> Array:
        """Return grad f(q) of all rows, shape (m, nv), once `gaps` was asked; errors as there."""
        rows = self._constraint.gradient(t, q)
        if type(rows) is not np.ndarray or rows.dtype != np.float64 or rows.ndim != 2:
            rows = np.atleast_2d(returned(rows, f"the gradient of {self._name(0)}"))
        count, nv = self._size, self._system.nv
        if rows.shape != (count, nv):
            expected = f"({nv},)" if count == 1 else f"({count}, {nv})"
            found = rows.shape[1:] if len(rows) == 1 else rows.shape
            raise InputError(f"the gradient of {self._name(0)} has shape {found}; {expected} is expected")
        if not all_finite(rows):
            worst = int(np.argmin(np.isfinite(rows).all(axis=1)))
            raise not_finite(f"the gradient of {self._name(worst)}", rows[worst], t, q)
        return rows

    def active(self, t: float, q: Array, tolerance: float, travel: Array | None) -> Rows | None:
        """Return the rows within the tolerance, or None."""
        gap = self.gaps(t, q)
        index = (gap <= tolerance).nonzero()[0]
        if not index.size:
            self._touching = False
            return None
        gradient = self.gradients(t, q)
        self.touch(t, q, index, gap, gradient)
        nowhere = np.broadcast_to(NO_POINT, (index.size, 3))
        constraint: Any = self._constraint
        rate = None
        if hasattr(constraint, "rate"):
            rate = np.atleast_1d(returned(constraint.rate(t, q), f"df/dt of {self._name(0)}"))[index]
            if not np.isfinite(rate).all():
                raise not_finite(f"df/dt of {self._name(int(index[0]))}", rate, t, q)
        return Rows(index, gap[index], gradient[index], np.full(index.size, np.nan), nowhere, nowhere, rate)

    def touch(self, t: float, q: Array, index: Array, gap: Array, gradient: Array) -> None:
        """Check the gradients of rows that are active, at a few of the times that they are.

        Raises
        ------
        InputError
            If a gradient is of the wrong sign, or zero where f is not stationary.
        """
        count, flat = self._count + 1, gradient.ravel()
        vanishes = not (len(gradient) == 1 and flat.dot(flat) > 0.0) and not gradient[index].any(axis=1).all()
        if self._touching and self._nearest == 0.0 and count & (count - 1) and not vanishes:
            self._count, self._vanishes = count, False
            return
        starts, nearer, at_once = self._starts + (not self._touching), False, vanishes and not self._vanishes
        if self._nearest > 0.0:
            nearest = max(float(gap[index].min()), 0.0)
            nearer = nearest < 0.1 * self._nearest
        # at powers of two
        if at_once or nearer or (starts & (starts - 1) == 0 and starts > self._starts) or count & (count - 1) == 0:
            self.compare(t, q, index, full=at_once or nearer)
            self._nearest = nearest if nearer else self._nearest
        self._starts, self._count, self._touching, self._vanishes = starts, count, True, vanishes

    def check(self, t: float, q: Array) -> None:
        """Raise `InputError` unless gaps and gradients at the start are numbers that fit each other."""
        constraint: Any = self._constraint
        try:
            gap = self.gaps(t, q)
            if not gap.size:
                return
            self.gradients(t, q)
        except MbviError as error:
            if isinstance(error, InputError):
                raise
            raise InputError(f"at the start {error}") from error
        rate = np.atleast_1d(constraint.rate(t, q)) if hasattr(constraint, "rate") else np.zeros_like(gap)
        if rate.shape != gap.shape or not np.isfinite(rate).all():
            raise InputError(f"{self._name(0)}: df/dt has shape {rate.shape}; {gap.shape} finite numbers are asked for")
        self.compare(t, q, np.arange(len(gap)), full=True)

    def compare(self, t: float, q: Array, index: Array, full: bool) -> None:
        """Hold the gradients of some rows against differences; all entries if `full`, else along each gradient.

        Raises
        ------
        InputError
            If f falls where its gradient says that it rises, or changes where it is zero.
        """
        system, nv = self._system, self._system.nv
        gap = self.gaps(t, q)
        gradient = self.gradients(t, q)
        along = _directions(system, q, gradient[index], full)
        if full:
            entries = np.eye(nv) if nv <= _ENTRIES else _random_directions(nv)
            along = np.concatenate([entries, along])
        if not len(along):
            return
        found = slopes(lambda way: self._constraint.gap(t, system.integrate(q, way)), gap, along, _scale(q), full)
        for k in index.tolist():
            self._judge(t, q, k, gradient[k], along, found, len(entries) if full else 0)

    def _judge(self, t: float, q: Array, k: int, gradient: Array, along: Array, found: Slopes, entries: int) -> None:
        """Raise, or warn, where the gradient of a row is not what differences along some directions say."""
        given = along @ gradient
        low, high, middle = found.low[:, k], found.high[:, k], found.middle[:, k]
        size = max(float(np.abs(given).max()), float(np.abs(middle[np.isfinite(middle)]).max(initial=0.0)))
        known = np.isfinite(middle) & np.isfinite(low) & np.isfinite(high)
        opposite = known & (np.abs(given) > _SIGNIFICANT * size) & (np.abs(middle) > _SIGNIFICANT * size)
        opposite &= np.where(given > 0.0, high < 0.0, low > 0.0)
        margin = _DIFFERENT * np.maximum(np.abs(given), np.abs(middle)) + _SMALL * size
        different = known & ((given < low - margin) | (given > high + margin))
        if not (opposite | different).any():
            return
        if entries == len(gradient):
            told, measured = gradient, middle[:entries]
            what = f"is {short(told)}, and differences of f give {short(measured)}"
        else:
            worst = int(np.argmax(np.where(opposite if opposite.any() else different, np.abs(given - middle), -1.0)))
            what = f"changes f by {given[worst]:.6g} along {short(along[worst])}, and differences of f give "
            what += f"{middle[worst]:.6g}"
        where = f"the gradient of {self._name(k)} at t = {t:.9g} s, q = {short(q)} {what}"
        if not gradient.any():
            raise InputError(f"{where}: no percussion can act on f there; give the gradient that f has")
        if opposite.any():
            raise InputError(f"{where}: f falls where its gradient says that it rises; correct its sign")
        if k not in self._warned:
            self._warned.add(k)
            warnings.warn(f"{where}: impacts go by the gradient that is given", MbviWarning, stacklevel=3)


def _scale(q: Array) -> float:
    return max(1.0, float(np.abs(q).max(initial=0.0)))


def _directions(system: System, q: Array, gradient: Array, full: bool) -> Array:
    """Return the directions of gradients and, if `full`, of what percussions along them do, shape (k, nv)."""
    along = gradient
    if full:
        try:
            along = np.concatenate([along, system.metric(q).solve_rows(gradient)])
        except MbviError:
            # that is said where M is needed
            pass
    lengths = np.linalg.norm(along, axis=1)
    usable = np.isfinite(lengths) & (lengths > 0.0)
    return np.asarray(along[usable] / lengths[usable, None])


def _random_directions(nv: int) -> Array:
    ways = np.random.default_rng(0).normal(size=(_DIRECTIONS, nv))
    return np.asarray(ways / np.linalg.norm(ways, axis=1)[:, None])
