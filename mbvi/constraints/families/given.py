"""The adapter that makes a family of a user's object with `gap` and `gradient`, and checks its numbers."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from ...arguments import all_finite, returned
from ...compiled import plain_array
from ...errors import InputError, MbviError, MbviWarning
from ...system import System
from ...system.given import not_finite, short
from ..family import ConstraintFamily
from ..finite_differences import Slopes, directions_along, random_directions, slopes
from ..rows import Array, Constraint, Rows
from ..tangents import Tangents, none_of
from .gap_function import GapFunction

# a gradient may differ from differences of f by this part of its entry, and by this part of its largest entry
_DIFFERENT, _SMALL = 1e-3, 1e-5
# the active rows of a constraint of one row; nobody writes to them
_ONE, _NONE = np.zeros(1, np.int64), np.zeros(0, np.int64)
# entries of a gradient below this part of the largest may have either sign
_SIGNIFICANT = 1e-3
# largest nv at which a gradient is checked entry by entry; beyond it is checked along some random directions
_ENTRIES = 64


def as_family(
    system: System, constraint: Constraint | ConstraintFamily, restitution: float, name: Callable[[int], str]
) -> ConstraintFamily:
    """Return a constraint as a family: itself if it is one, otherwise an adapter around the user's object.

    This is the only place that looks at which attributes a user's object has.

    Parameters
    ----------
    system : System
        The system whose configurations q are.
    constraint : Constraint or ConstraintFamily
        What the problem was given.
    restitution : float
        The problem's e for it.
    name : callable
        name(k) -> the name of its row k in the problem.
    """
    if isinstance(constraint, ConstraintFamily):
        return constraint
    if hasattr(constraint, "active"):
        return GivenRows(system, constraint, restitution, name)
    return GivenConstraint(system, constraint, restitution, name)


class GivenConstraint(ConstraintFamily):
    """A user's object with `gap` and `gradient`, wrapped as a family whose numbers are checked.

    Parameters
    ----------
    system, constraint, restitution, name
        See `as_family`. The object may also have `names` or `name(k)`, `size`, `restitution`, `rate(t, q)` and
        `tangents(t, q)` of shape (m, 2, nv).

    Notes
    -----
    Gradients are compared with central differences of the gaps along the retraction: every entry at the start and where
    a row first becomes active, then along the gradient itself, at ever fewer of the activations.
    """

    def __init__(self, system: System, constraint: Any, restitution: float, name: Callable[[int], str]) -> None:
        self._system, self._constraint, self._name_of = system, constraint, name
        self.names = getattr(constraint, "names", ())
        size = getattr(constraint, "size", None)
        self.size = int(size) if size is not None else max(1, len(self.names))
        self.restitution: Array = np.asarray(getattr(constraint, "restitution", restitution), dtype=float)
        self._rate = getattr(constraint, "rate", None)
        self.moving = self._rate is not None
        # a GapFunction has the method even where no tangents were given
        self._has_tangents = getattr(constraint, "has_tangents", hasattr(constraint, "tangents"))
        self.friction = np.nan if self._has_tangents else 0.0
        self.functions = (constraint.f,) if isinstance(constraint, GapFunction) else ()
        # how many times rows became active, at how many steps rows were active, and whether they were at the last one
        self._activations, self._active_steps, self._were_active = 0, 0, False
        # the least gap at the last full check: a scheme may activate rows long before they touch, so that a gradient is
        # checked again when the gap is ten times smaller
        self._nearest = np.inf
        # whether the gradient of an active row was zero at the last step
        self._vanishes = False
        self._warned: set[int] = set()
        # the number of gaps; -1 before the first call of `gap`
        self._rows = -1

    def name(self, number: int) -> str:
        """Return the name of one constraint; "" where the user gave none."""
        if hasattr(self._constraint, "name"):
            return str(self._constraint.name(number))
        return super().name(number)

    def gap(self, t: float, q: Array) -> Array:
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
            gap = np.atleast_1d(returned(gap, f"the gap of {self._name_of(0)}"))
            if gap.ndim != 1:
                raise InputError(f"the gap of {self._name_of(0)} has shape {gap.shape}; a number or (m,) is expected")
        if len(gap) != self._rows:
            if self._rows >= 0:
                raise InputError(
                    f"the gap of {self._name_of(0)} has {len(gap)} numbers now, and had {self._rows} before"
                )
            self._rows = len(gap)
        if not all_finite(gap):
            worst = int(np.argmin(np.isfinite(gap)))
            raise not_finite(f"f of {self._name_of(worst)}", gap[worst], t, q)
        return gap

    def gradient(self, t: float, q: Array) -> Array:
        """Return grad f(q) of all rows, shape (m, nv); errors as of `gap`."""
        rows = self._constraint.gradient(t, q)
        if type(rows) is not np.ndarray or rows.dtype != np.float64 or rows.ndim != 2:
            rows = np.atleast_2d(returned(rows, f"the gradient of {self._name_of(0)}"))
        count, nv = self._rows if self._rows >= 0 else len(self.gap(t, q)), self._system.nv
        if rows.shape != (count, nv):
            expected = f"({nv},)" if count == 1 else f"({count}, {nv})"
            found = rows.shape[1:] if len(rows) == 1 else rows.shape
            raise InputError(f"the gradient of {self._name_of(0)} has shape {found}; {expected} is expected")
        if not all_finite(rows):
            worst = int(np.argmin(np.isfinite(rows).all(axis=1)))
            raise not_finite(f"the gradient of {self._name_of(worst)}", rows[worst], t, q)
        return rows

    def rate(self, t: float, q: Array) -> Array | None:
        """Return df/dt as the user's object gives it; None if it has no `rate`."""
        if self._rate is None:
            return None
        return np.atleast_1d(returned(self._rate(t, q), f"df/dt of {self._name_of(0)}"))

    def changes_of_walls(self, times: tuple[float, float, float], q: Array, points: Array) -> Array:
        """Return the largest change of df/dt, the same at all points, shape (k,); see the base class."""
        return np.full(len(points), np.abs(np.diff([self.rate(t, q) for t in times], axis=0)).max(initial=0.0))

    def contacts(self, t: float, q: Array, tolerance: float) -> Rows | None:
        """Return the rows within the tolerance, or None; errors as of `gap`."""
        gap = self.gap(t, q)
        # one row is the usual case: to compare and search by numpy would take microseconds
        index = (gap <= tolerance).nonzero()[0] if gap.size != 1 else _ONE if gap.item() <= tolerance else _NONE
        if not index.size:
            self._were_active = False
            return None
        gradient = self.gradient(t, q)
        self._check_active(t, q, index, gap, gradient)
        rate = self.rate(t, q)
        if rate is not None:
            rate = rate[index]
            if not np.isfinite(rate).all():
                raise not_finite(f"df/dt of {self._name_of(int(index[0]))}", rate, t, q)
        e, nowhere = np.empty(index.size), np.empty((index.size, 3))
        e[:] = self.restitution if self.restitution.ndim == 0 else self.restitution[index]
        nowhere[:] = np.nan
        return Rows(index, gap[index], plain_array(gradient.take(index, 0)), e, nowhere, nowhere, rate)

    def tangents(self, t: float, q: Array, rows: Rows, friction: Array) -> Tangents:
        """Return the tangents of some rows, as the user's object gives them; errors as of `gap`."""
        plain, rows_of_all = none_of(len(friction), self._system.nv, False), self._all_tangents(t, q)
        jacobian = plain_array(rows_of_all[rows.constraint].reshape(-1, self._system.nv))
        return Tangents(friction, plain.axes, jacobian, None)

    def _all_tangents(self, t: float, q: Array) -> Array:
        """Return the tangents of all rows, shape (m, 2, nv), after checking them."""
        found = returned(self._constraint.tangents(t, q), f"the tangents of {self._name_of(0)}")
        shape = (self._rows, 2, self._system.nv)
        if found.shape != shape:
            raise InputError(f"the tangents of {self._name_of(0)} have shape {found.shape}; {shape} is expected")
        if not all_finite(found):
            raise not_finite(f"a tangent of {self._name_of(0)}", found, t, q)
        return found

    def check_rows(self, t: float, q: Array, rows: Array) -> None:
        """Check the gradients of some closed rows, at a few of the calls."""
        self._check_active(t, q, rows, self.gap(t, q), self.gradient(t, q))

    def _check_active(self, t: float, q: Array, index: Array, gap: Array, gradient: Array) -> None:
        """Check the gradients of active rows, at ever fewer of the steps at which they are active.

        All entries are checked at the first activation, when the rows come ten times nearer, and when a gradient
        becomes zero.

        Raises
        ------
        InputError
            If a gradient is of the wrong sign, or zero where f is not stationary.
        """
        count, flat = self._active_steps + 1, gradient.ravel()
        vanishes = not (len(gradient) == 1 and flat.dot(flat) > 0.0) and not gradient[index].any(axis=1).all()
        # the usual step: the rows stay active, and this step is not one of those that are checked
        if self._were_active and self._nearest == 0.0 and count & (count - 1) and not vanishes:
            self._active_steps, self._vanishes = count, False
            return
        activations, much_nearer = self._activations + (not self._were_active), False
        newly_zero = vanishes and not self._vanishes
        if self._nearest > 0.0:
            nearest = max(float(gap[index].min()), 0.0)
            much_nearer = nearest < 0.1 * self._nearest
        # otherwise at the first, second, fourth, eighth ... activation and step
        due = count & (count - 1) == 0 or (activations > self._activations and activations & (activations - 1) == 0)
        if newly_zero or much_nearer or due:
            self.compare(t, q, index, full=newly_zero or much_nearer)
            self._nearest = nearest if much_nearer else self._nearest
        self._activations, self._active_steps, self._were_active, self._vanishes = activations, count, True, vanishes

    def check(self, t: float, q: Array) -> None:
        """Raise `InputError` unless gaps, gradients and rates at the start are numbers that fit each other."""
        try:
            gap = self.gap(t, q)
            if not gap.size:
                return
            self.gradient(t, q)
            if self._has_tangents:
                self._all_tangents(t, q)
        except MbviError as error:
            if isinstance(error, InputError):
                raise
            raise InputError(f"at the start {error}") from error
        rate = np.zeros_like(gap) if self._rate is None else np.atleast_1d(self._rate(t, q))
        if rate.shape != gap.shape or not np.isfinite(rate).all():
            raise InputError(
                f"{self._name_of(0)}: df/dt has shape {rate.shape}; {gap.shape} finite numbers are expected"
            )
        self.compare(t, q, np.arange(len(gap)), full=True)

    def compare(self, t: float, q: Array, index: Array, full: bool) -> None:
        """Compare gradients with differences: all entries if `full`, otherwise the slopes along the gradients.

        Raises
        ------
        InputError
            If f falls where its gradient says that it rises, or changes where it is zero.
        """
        system, nv = self._system, self._system.nv
        gap = self.gap(t, q)
        gradient = self.gradient(t, q)
        along = directions_along(system, q, gradient[index], full)
        if full:
            entries = np.eye(nv) if nv <= _ENTRIES else random_directions(nv)
            along = np.concatenate([entries, along])
        if not len(along):
            return
        found = slopes(lambda w: self._constraint.gap(t, system.integrate(q, w)), gap, along, _scale(q), full)
        for k in index.tolist():
            self._judge(t, q, k, gradient[k], along, found, len(entries) if full else 0)

    def _judge(self, t: float, q: Array, k: int, gradient: Array, along: Array, found: Slopes, entries: int) -> None:
        """Raise, or warn, where the gradient of a row differs from differences along some directions."""
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
            what = f"is {short(gradient)}, and differences of f give {short(middle[:entries])}"
        else:
            worst = int(np.argmax(np.where(opposite if opposite.any() else different, np.abs(given - middle), -1.0)))
            what = f"changes f by {given[worst]:.6g} along {short(along[worst])}, and differences of f give "
            what += f"{middle[worst]:.6g}"
        where = f"the gradient of {self._name_of(k)} at t = {t:.9g} s, q = {short(q)} {what}"
        if not gradient.any():
            raise InputError(f"{where}: no percussion can act on f there; give the gradient that f has")
        if opposite.any():
            raise InputError(f"{where}: f falls where its gradient says that it rises; correct its sign")
        if k not in self._warned:
            self._warned.add(k)
            warnings.warn(f"{where}: impacts go by the gradient that is given", MbviWarning, stacklevel=3)


class GivenRows(GivenConstraint):
    """A user's object that selects its active rows itself, by `active(t, q, tolerance, travel)`; nothing is checked.

    `travel` is always None. `active` returns the fields of `Rows`, or None if no row is active.
    """

    def gap(self, t: float, q: Array) -> Array:
        """Return f(q) as the user's object gives it."""
        return np.atleast_1d(np.asarray(self._constraint.gap(t, q), dtype=float))

    def gradient(self, t: float, q: Array) -> Array:
        """Return grad f(q) as the user's object gives it."""
        return np.atleast_2d(np.asarray(self._constraint.gradient(t, q), dtype=float))

    def contacts(self, t: float, q: Array, tolerance: float) -> Rows | None:
        """Return the rows that the user's object selects, as arrays that kernels take."""
        rows = self._constraint.active(t, q, tolerance, None)
        if rows is None:
            return None
        number, gap, jacobian, own, point, normal, rate = rows[:7]
        e = np.where(np.isnan(own), np.broadcast_to(self.restitution, (self.size,)).take(number, mode="clip"), own)
        return Rows(
            np.asarray(number, dtype=np.int64),
            plain_array(gap),
            plain_array(jacobian) if isinstance(jacobian, np.ndarray) else jacobian,
            plain_array(e),
            plain_array(point),
            plain_array(normal),
            None if rate is None else plain_array(rate),
        )

    def check(self, t: float, q: Array) -> None:
        """Check nothing: the object may be defined near its active rows only."""

    def check_rows(self, t: float, q: Array, rows: Array) -> None:
        """Check nothing, as `check`."""


def _scale(q: Array) -> float:
    return max(1.0, float(np.abs(q).max(initial=0.0)))


def named_gap_functions(constraints: Iterable[Any]) -> dict[str, GapFunction]:
    """Return those of some constraints that are a `GapFunction` with a name."""
    return {one.names[0]: one for one in constraints if isinstance(one, GapFunction) and one.names}
