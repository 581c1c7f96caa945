"""One constraint given by f(q) and its gradient, the setting of the paper."""

from __future__ import annotations

from collections.abc import Callable
from copy import copy

import numpy as np

from ...arguments import Array, function, optional, printable, returned
from ...errors import InputError
from ...system.given import called


class GapFunction:
    """One constraint f(q) >= 0 with its gradient (equation (2) of the paper, see docs/theory/mathematics.md).

    Parameters
    ----------
    f : callable
        f(q) -> float [m or rad]; negative is penetration.
    grad_f : callable
        grad_f(q) -> gradient in the tangent space, shape (nv,).
    name : str, optional
        Its name in impacts; "f" and a number by default.
    tangents : callable, optional
        tangents(q) -> gradients of the tangential displacements at the contact, shape (2, nv), or (1, nv) in a plane;
        needed for friction. Along unit tangents of the contact, as grad_f along its unit normal.

    Notes
    -----
    A problem compares grad_f with differences of f at the start and where f becomes active: `MbviWarning` where they
    differ, `InputError` where a sign is wrong. A value that is not finite raises `DivergedError` at its step.
    """

    def __init__(
        self,
        f: Callable[[Array], float],
        grad_f: Callable[[Array], Array],
        name: str | None = None,
        tangents: Callable[[Array], Array] | None = None,
    ) -> None:
        self.f = function(f, "f", "f(q) -> float")
        self._gradient = function(grad_f, "grad_f", "grad_f(q) -> (nv,)")
        self._tangents = optional(function, tangents, "tangents", "tangents(q) -> (2, nv)")
        self.names = () if name is None else (printable(name, "name"),)

    def __repr__(self) -> str:
        named = "".join(f", name={name!r}" for name in self.names)
        return f"GapFunction({called(self.f)}, {called(self._gradient)}{named})"

    def gap(self, t: float, q: Array) -> Array:
        """Return f(q), shape (1,)."""
        value = self.f(q)
        if not isinstance(value, float):
            number = returned(value, f"f ({called(self.f)})")
            if number.size != 1:
                raise InputError(
                    f"f ({called(self.f)}) returned shape {number.shape}; a GapFunction is one constraint and its f "
                    "returns one number"
                )
            value = number.item()
        return np.array([value])

    def behind(self, length: float) -> GapFunction:
        """Return the constraint of a wall that is farther out along its normal by a length [m]."""
        moved, f = copy(self), self.f
        moved.f = lambda q: f(q) - length
        return moved

    def gradient(self, t: float, q: Array) -> Array:
        """Return grad f(q), shape (1, nv)."""
        gradient = returned(self._gradient(q), f"grad_f ({called(self._gradient)})")
        if gradient.ndim > 2 or (gradient.ndim == 2 and len(gradient) != 1):
            raise InputError(f"grad_f ({called(self._gradient)}) returned shape {gradient.shape}; (nv,) is expected")
        return gradient.reshape(1, -1)

    @property
    def has_tangents(self) -> bool:
        """Whether tangents were given, so that the constraint can have friction."""
        return self._tangents is not None

    def tangents(self, t: float, q: Array) -> Array:
        """Return gradients of the tangential displacements, shape (1, 2, nv); the second is zero where one is given."""
        assert self._tangents is not None
        rows = np.atleast_2d(returned(self._tangents(q), f"tangents ({called(self._tangents)})"))
        if rows.ndim != 2 or len(rows) > 2:
            raise InputError(f"tangents ({called(self._tangents)}) returned shape {rows.shape}; (2, nv) is expected")
        both = np.zeros((2, rows.shape[1]))
        both[: len(rows)] = rows
        return both[None]
