"""Collocation at Gauss's nodes, which follows variations where a slip begins or stops and their equations are stiff."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...system.system import Array

# (matrix, X) -> dX/dt
Applied = Callable[[Array, Array], Array]


class Collocation:
    """A step of Gauss's implicit method, of order twice the number of nodes and stable at any length.

    Parameters
    ----------
    nodes : ndarray, shape (s,)
        The nodes in (0, 1).
    """

    def __init__(self, nodes: Array) -> None:
        powers = np.arange(len(nodes))
        # integrals of the polynomials through the nodes, up to each node and to the end
        inverse = np.linalg.inv(nodes[:, None] ** powers)
        self._to_nodes = nodes[:, None] ** (powers + 1) / (powers + 1) @ inverse
        self._to_end = 1.0 / (powers + 1) @ inverse

    def step(self, h: float, matrices: Array, applied: Applied, X: Array, size: int) -> Array:
        """Return X after a step of length h.

        Parameters
        ----------
        h : float
            Its length.
        matrices : ndarray, shape (s, a, b)
            What depends on the time, at the nodes.
        applied : callable
            applied(matrix, X) -> dX/dt, linear in X apart from a constant.
        X : ndarray, shape (n, p)
            X at its start.
        size : int
            Rates depend on so many first rows of X, and those of these rows by the first columns of the matrices.
        """
        s = len(matrices)
        coupled = h * self._to_nodes[:, None, :, None] * matrices[:, :size, None, :size]
        system = np.eye(s * size) - coupled.reshape(s * size, s * size)
        start = np.stack([applied(matrix, X)[:size] for matrix in matrices])
        rates = np.linalg.solve(system, start.reshape(s * size, -1)).reshape(s, size, -1)
        at_nodes = np.repeat(X[None], s, axis=0)
        at_nodes[:, :size] += h * np.einsum("ij,jkl->ikl", self._to_nodes, rates)
        return X + h * np.einsum("i,ikl->kl", self._to_end, np.stack(list(map(applied, matrices, at_nodes))))
