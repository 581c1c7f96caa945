"""Steps of linear equations dX/dt = A X + B, whose matrices are known along the dense output of a run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...system.system import Array

# nodes at which the matrices of a step, or of a part of one, are computed, and the most parts that are tried in a step
_NODES, _MOST_PARTS = 5, 300


class LinearMethod:
    """The tableau of order eight that made the steps of the run.

    Parameters
    ----------
    tolerance : float
        Largest error of a part of a step, relative to the largest entry of a column.

    Notes
    -----
    Matrices are polynomials through Gauss's nodes, which is of order ten; what their leading terms change estimates
    its error. A part whose error is too large is divided.
    """

    def __init__(self, tolerance: float) -> None:
        # imported here because it is slow to import
        from scipy.integrate import DOP853

        self.tolerance = tolerance
        self.A, self.b, self.c = DOP853.A[:12, :12], DOP853.B, DOP853.C[:12]
        self.nodes, self.interpolation = _interpolation(self.c)
        self.errors = np.array([DOP853.E5[:12], DOP853.E3[:12]])


@dataclass(frozen=True)
class LinearSteps:
    """Steps over parts of one step of the run.

    Attributes
    ----------
    method : LinearMethod
        The method.
    h : float
        Length of the step [s].
    matrices : callable
        matrices(shares) -> array, shape (k, a, b): what depends on the time, at shares of the step.
    applied : callable
        applied(matrix, X) -> dX/dt, for matrices and X with any leading axes.
    least : ndarray, shape (p,), or float
        Entries of each column of X up to this are small.
    """

    method: LinearMethod
    h: float
    matrices: Callable[[Array], Array]
    applied: Callable[[Array, Array], Array]
    least: Array | float

    def rough(self, first: float, last: float, X: Array) -> Array:
        """Return X after the part from one share of the step to another, by one step of order two."""
        length = last - first
        h, middle = length * self.h, self.matrices(np.array([first + 0.5 * length]))[0]
        return X + h * self.applied(middle, X + 0.5 * h * self.applied(middle, X))

    def taken(self, first: float, last: float, X: Array) -> Array | None:
        """Return X after the part from one share of the step to another; None if it changes too fast."""
        left, count = [(first, last - first)], 0
        while left:
            start, length = left.pop()
            found = self._once(start, length, X)
            count += 1
            if found is not None:
                X = found
            elif count > _MOST_PARTS:
                return None
            else:
                left += [(start + 0.5 * length, 0.5 * length), (start, 0.5 * length)]
        return X

    def _once(self, start: float, length: float, X: Array) -> Array | None:
        """Return X after a part, by the explicit method; None if its error is too large."""
        method, h = self.method, length * self.h
        at_nodes, both = self.matrices(start + length * method.nodes), np.stack([X, X])
        # twice the same: with the matrices, and with those without the leading terms of their polynomials
        K = np.empty((len(method.c), 2, *X.shape))
        # the same numbers, one stage a row
        flat = K.reshape(len(K), -1)
        M = (method.interpolation @ at_nodes.reshape(_NODES, -1)).reshape(2, -1, *at_nodes.shape[1:])
        for i in range(len(K)):
            change = h * (method.A[i, :i] @ flat[:i]).reshape(both.shape) if i else 0.0
            K[i] = self.applied(M[:, i], both + change)
        fifth, third = np.abs(h * (method.errors @ flat)).reshape(2, *both.shape)[:, 0].max(axis=1)
        X, rough = both + h * (method.b @ flat).reshape(both.shape)
        scale = np.sqrt(fifth**2 + 0.01 * third**2)
        error = fifth * np.divide(fifth, scale, out=np.zeros_like(scale), where=scale != 0.0)
        return X if self._small(np.maximum(error, np.abs(X - rough).max(axis=0)), X) else None

    def _small(self, error: Array, X: Array) -> bool:
        # written so that a NaN is refused too
        return bool((error <= self.method.tolerance * np.maximum(np.abs(X).max(axis=0), self.least)).all())


def _interpolation(shares: Array) -> tuple[Array, Array]:
    """Return Gauss's nodes in (0, 1), and what makes values at some shares of those at the nodes.

    The second, shape (2, k, nodes), has the polynomial through the nodes, then the one without its leading term, which
    is the nearest of its degree.
    """
    from numpy.polynomial import legendre

    nodes, weights = legendre.leggauss(_NODES)
    terms = (np.arange(_NODES) + 0.5)[:, None] * legendre.legvander(nodes, _NODES - 1).T * weights
    there = legendre.legvander(2.0 * shares - 1.0, _NODES - 1)
    return 0.5 * (nodes + 1.0), np.stack([there @ terms, there[:, :-1] @ terms[:-1]])
