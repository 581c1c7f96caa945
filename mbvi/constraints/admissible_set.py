"""K = {q : f_a(q) >= 0}: all constraints of a problem stacked, and the active ones at a configuration."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from ..errors import InputError
from ..system import System
from .active import NOWHERE, Array, Constraint, Rows


class AdmissibleSet:
    """The stack of constraints.

    Parameters
    ----------
    system : System
        What q belongs to.
    constraints : sequence of Constraint
        Objects with `gap(t, q)` and `gradient(t, q)`; those with `active(t, q, tolerance, travel)` are asked for
        their near rows only.
    restitution : ndarray, shape (len(constraints),)
        e of those constraints that carry none of their own.

    Notes
    -----
    Constraints are numbered through; `name(k)` is what impacts call number k. The last configuration is remembered so
    that far pairs need not be asked again: answers do not depend on it.
    """

    def __init__(self, system: System, constraints: Sequence[Constraint], restitution: Array) -> None:
        self.system = system
        self.constraints = tuple(constraints)
        self._sizes = [_size(c) for c in self.constraints]
        self._starts = [int(s) for s in np.concatenate([[0], np.cumsum(self._sizes)])]
        ask = [getattr(c, "active", None) or partial(_plain, c) for c in self.constraints]
        self._asked = list(zip(ask, self._starts[:-1], restitution, strict=True))
        self._last: Array | None = None
        self._remembering: list[Any] = [c for c in self.constraints if hasattr(c, "asked_by")]
        self.empty = Rows(
            np.zeros(0, dtype=np.intp), np.zeros(0), np.zeros((0, system.nv)), np.zeros(0), *np.zeros((2, 0, 3))
        )

    def __len__(self) -> int:
        return self._starts[-1]

    def name(self, number: int) -> str:
        """Return the name of a constraint: "hopper/foot | floor", "hopper/knee lower limit", "f 0"."""
        k = bisect_right(self._starts, number) - 1
        constraint, inner = self.constraints[k], number - self._starts[k]
        if hasattr(constraint, "name"):
            return str(constraint.name(inner))
        names: Any = getattr(constraint, "names", ())
        return str(names[inner]) if inner < len(names) else f"f {number}"

    def active(self, t: float, q: Array, tolerance: float) -> Rows:
        """Return J(q): the rows with f_a(q) <= tolerance.

        Parameters
        ----------
        t : float
            Time [s].
        q : ndarray, shape (nq,)
            Configuration.
        tolerance : float
            Activation tolerance [m or rad].
        """
        travel = None if self._last is None else np.abs(self.system.difference(self._last, q))
        for constraint in self._remembering:
            # constraints may be shared: what they remember belongs to whoever asked last
            if constraint.asked_by is not self:
                constraint.asked_by, travel = self, None
        self._last = q.copy()
        found = []
        for ask, start, e in self._asked:
            rows = ask(t, q, tolerance, travel)
            if rows is not None:
                constraint, gap, jacobian, restitution, point, normal = rows
                # a constraint's own restitution is never NaN
                if restitution[0] != restitution[0]:
                    restitution = np.full(len(gap), e)
                found.append(
                    Rows(constraint + start if start else constraint, gap, jacobian, restitution, point, normal)
                )
        if not found:
            return self.empty
        return found[0] if len(found) == 1 else Rows(*map(np.concatenate, zip(*found, strict=True)))

    def gap(self, t: float, q: Array) -> Array:
        """Return every f_a(q), stacked, shape (m,) [m or rad]."""
        return np.concatenate([np.zeros(0), *(np.atleast_1d(c.gap(t, q)) for c in self.constraints)])

    def gradient(self, t: float, q: Array) -> Array:
        """Return every grad f_a(q) in the tangent space, stacked, shape (m, nv)."""
        rows = [np.atleast_2d(c.gradient(t, q)) for c in self.constraints]
        return np.concatenate([np.zeros((0, self.system.nv)), *rows])

    def check(self, t: float, q: Array) -> None:
        """Raise `InputError` unless the gaps given by a user are finite and their gradients have shape (nv,)."""
        for k, constraint in enumerate(self.constraints):
            # those that choose their rows are the library's own, and may have too many to list
            if hasattr(constraint, "active"):
                continue
            gap = np.atleast_1d(np.asarray(constraint.gap(t, q), dtype=float))
            name = self.name(self._starts[k]) if gap.size else "constraint"
            if not np.isfinite(gap).all():
                raise InputError(f"{name}: f(q0) is not finite")
            gradient = np.atleast_2d(np.asarray(constraint.gradient(t, q), dtype=float))
            if gap.size and gradient.shape != (gap.size, self.system.nv):
                raise InputError(
                    f"{name}: the gradient has shape {gradient.shape[-1:]}; the velocity asks for ({self.system.nv},)"
                )
            if not np.isfinite(gradient).all():
                raise InputError(f"{name}: the gradient at q0 is not finite")


def _size(constraint: Constraint) -> int:
    size = getattr(constraint, "size", None)
    return int(size) if size is not None else max(1, len(getattr(constraint, "names", ())))


def _plain(constraint: Constraint, t: float, q: Array, tolerance: float, travel: Array | None) -> Rows | None:
    """Return the active rows of a constraint that gives no more than gaps and gradients."""
    gap = np.atleast_1d(np.asarray(constraint.gap(t, q), dtype=float))
    index = np.flatnonzero(gap <= tolerance)
    if not index.size:
        return None
    rows = np.atleast_2d(np.asarray(constraint.gradient(t, q), dtype=float))[index]
    nowhere = np.broadcast_to(NOWHERE, (index.size, 3))
    return Rows(index, gap[index], rows, np.full(index.size, np.nan), nowhere, nowhere)
