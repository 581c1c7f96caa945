"""A constraint given as a function, the paper's own setting."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..errors import InputError

Array = np.ndarray


class GapFunction:
    """One constraint f(q) >= 0 with its gradient (equation 2).

    Parameters
    ----------
    f : callable
        f(q) -> float [m or rad]; negative is penetration.
    grad_f : callable
        grad_f(q) -> gradient in the tangent space, shape (nv,).
    name : str, optional
        What impacts call it; "f", then numbered, by default.
    """

    def __init__(self, f: Callable[[Array], float], grad_f: Callable[[Array], Array], name: str | None = None) -> None:
        if not callable(f) or not callable(grad_f):
            raise InputError("GapFunction takes two functions: f(q) -> float and grad_f(q) -> (nv,)")
        self._f, self._gradient = f, grad_f
        self.names = (name,) if name else ()

    def gap(self, t: float, q: Array) -> Array:
        """Return f(q), shape (1,)."""
        value = np.asarray(self._f(q), dtype=float)
        if value.size != 1:
            raise InputError(f"f(q) has shape {value.shape}; a GapFunction is one constraint and returns one number")
        return value.reshape(1)

    def gradient(self, t: float, q: Array) -> Array:
        """Return grad f(q), shape (1, nv)."""
        gradient = np.asarray(self._gradient(q), dtype=float)
        if gradient.ndim > 2 or (gradient.ndim == 2 and len(gradient) != 1):
            raise InputError(f"grad_f(q) has shape {gradient.shape}; (nv,) is asked for")
        return gradient.reshape(1, -1)
