"""The kinetic metric |w|_M = (w' M w)^(1/2), factorised block by block as M = L L'."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
from scipy.linalg import blas, lapack
from scipy.sparse import csr_array

from ..arguments import array
from ..errors import InputError
from .sparse.column_blocks import compose, cut
from .sparse.sparse_whitening import whiten_bodies

Array = np.ndarray


class Metric(Protocol):
    """A symmetric positive definite matrix M = L L', used through products and solutions only.

    Every method takes a vector of shape (nv,) or columns of shape (nv, m).
    """

    @property
    def friction(self) -> Array | None:
        """The largest percussions of dry friction of joints in the step, shape (nv,) [N s, N m s]; None without.

        Those of `hinges` follow, shape (nv + k,).
        """

    @property
    def hinges(self) -> Array | None:
        """Further rows with dry friction, the gradients of angles of hinges, shape (k, nv); None without."""

    def apply(self, w: Array) -> Array:
        """Return M w."""
        ...

    def whiten(self, w: Array) -> Array:
        """Return L^-1 w: forces and gradients in the coordinates where M is the identity."""
        ...

    def unwhiten(self, y: Array) -> Array:
        """Return L'^-1 y: velocities back from the coordinates where M is the identity."""
        ...

    def solve_rows(self, rows: Array) -> Array:
        """Return M^-1 r of every row r, shape (m, nv)."""
        ...

    def whiten_rows(self, rows: csr_array) -> csr_array:
        """Return L^-1 r of every row r of a sparse matrix, shape (m, nv)."""
        ...

    def dense(self) -> Array:
        """Return M itself, shape (nv, nv)."""
        ...


class DenseMetric:
    """A dense M, of which only the upper triangle is read.

    Parameters
    ----------
    matrix : ndarray, shape (nv, nv)
        M.

    Raises
    ------
    InputError
        If M is not positive definite.
    """

    friction = hinges = None

    def __init__(self, matrix: Array) -> None:
        self.matrix = matrix
        # LAPACK's U' U with U = L'; only the upper triangle is read and written
        self.upper, info = lapack.dpotrf(matrix, 0, 0)
        if info:
            raise InputError(
                f"the mass matrix is not positive definite (leading minor {info} of {len(matrix)}): "
                "check masses, inertias and the coordinates' redundancy"
            )

    def apply(self, w: Array) -> Array:
        return self.dense() @ w

    def whiten(self, w: Array) -> Array:
        return triangular(self.upper, w, 1)

    def unwhiten(self, y: Array) -> Array:
        return triangular(self.upper, y, 0)

    def solve_rows(self, rows: Array) -> Array:
        return np.ascontiguousarray(self.unwhiten(self.whiten(rows.T)).T)

    def whiten_rows(self, rows: csr_array) -> csr_array:
        return whiten_full(self, rows)

    def dense(self) -> Array:
        upper = np.triu(self.matrix)
        return upper + np.triu(upper, 1).T


def whiten_full(metric: Metric, rows: csr_array) -> csr_array:
    """Return L^-1 r of every sparse row r, computed by a dense matrix of the rows that are not zero."""
    here = np.flatnonzero(np.diff(rows.indptr))
    block = metric.whiten(rows[here].toarray().T).T
    m, n = rows.shape
    starts = np.zeros(m + 1, np.int32)
    starts[1 + here] = n
    columns = np.tile(np.arange(n, dtype=np.int32), len(here))
    return csr_array((np.ascontiguousarray(block).ravel(), columns, np.cumsum(starts, dtype=np.int32)), shape=(m, n))


def like(rows: csr_array, data: Array) -> csr_array:
    """Return a sparse matrix with the sparsity pattern of `rows` and other values."""
    out = csr_array.__new__(csr_array)
    # what `copy` does, in a tenth of its time
    out.__dict__.update(rows.__dict__)
    out.data = data
    return out


def triangular(upper: Array, right: Array, transposed: int) -> Array:
    """Solve U y = right, or U' y = right if `transposed` is 1, by BLAS: LAPACK starts threads even for few columns."""
    if right.ndim == 1:
        return blas.dtrsv(upper, right, 1, 0, 0, transposed)
    return blas.dtrsm(1.0, upper, right, 0, 0, transposed)


class DiagonalMetric:
    """A diagonal M, as of point masses and of spheres without rotation.

    Parameters
    ----------
    diagonal : ndarray, shape (nv,)
        The positive entries.
    """

    friction = hinges = None

    def __init__(self, diagonal: Array) -> None:
        self.diagonal = diagonal
        self.root = np.sqrt(diagonal)

    def apply(self, w: Array) -> Array:
        return (self.diagonal * w.T).T

    def whiten(self, w: Array) -> Array:
        return (w.T / self.root).T

    unwhiten = whiten

    def solve_rows(self, rows: Array) -> Array:
        return rows / self.diagonal

    def whiten_rows(self, rows: csr_array) -> csr_array:
        return like(rows, rows.data / self.root[rows.indices])

    def dense(self) -> Array:
        return np.diag(self.diagonal)


class BodiesMetric:
    """Free bodies side by side: constant blocks of shape (6, 6).

    Parameters
    ----------
    blocks : ndarray, shape (n, 6, 6)
        The mass matrix of each body.
    """

    friction = hinges = None

    def __init__(self, blocks: Array) -> None:
        self.blocks = blocks
        self.inverse_lower = np.linalg.inv(np.linalg.cholesky(blocks))
        self.inverse_upper = np.ascontiguousarray(self.inverse_lower.transpose(0, 2, 1))

    @staticmethod
    def _each(blocks: Array, w: Array) -> Array:
        return (blocks @ w.reshape(len(blocks), 6, -1)).reshape(w.shape)

    def apply(self, w: Array) -> Array:
        return self._each(self.blocks, w)

    def whiten(self, w: Array) -> Array:
        return self._each(self.inverse_lower, w)

    def unwhiten(self, y: Array) -> Array:
        return self._each(self.inverse_upper, y)

    def solve_rows(self, rows: Array) -> Array:
        return np.ascontiguousarray(self.unwhiten(self.whiten(rows.T)).T)

    def whiten_rows(self, rows: csr_array) -> csr_array:
        rows = _with_whole_bodies(rows)
        values = np.empty_like(rows.data)
        whiten_bodies(self.inverse_lower, rows.indices[::6].astype(np.int64) // 6, rows.data, values)
        return like(rows, values)

    def dense(self) -> Array:
        n = 6 * len(self.blocks)
        full = np.zeros((n, n))
        for k, block in enumerate(self.blocks):
            full[6 * k : 6 * k + 6, 6 * k : 6 * k + 6] = block
        return full


def _with_whole_bodies(rows: csr_array) -> csr_array:
    """Return rows with all six entries of each of their bodies, next to each other; some may be zeros."""
    first, last = rows.indices[::6], rows.indices[5::6]
    if not (rows.indptr % 6).any() and not (first % 6).any() and (last == first + 5).all():
        return rows
    # rows that were dense lack the entries that are zero
    m, n = rows.shape
    bodies = np.repeat(np.arange(m), np.diff(rows.indptr)) * (n // 6) + rows.indices // 6
    held, place = np.unique(bodies, return_inverse=True)
    data = np.zeros((len(held), 6))
    data[place, rows.indices % 6] = rows.data
    starts = 6 * np.searchsorted(held, np.arange(m + 1) * (n // 6))
    columns = 6 * (held % (n // 6))[:, None] + np.arange(6)
    return csr_array((data.ravel(), columns.ravel(), starts), shape=rows.shape)


class BlockMetric:
    """Several metrics side by side.

    Parameters
    ----------
    parts : sequence of Metric
        The diagonal blocks.
    slices : sequence of slice
        Where each of them stands in w.
    """

    hinges = None

    def __init__(self, parts: Sequence[Metric], slices: Sequence[slice]) -> None:
        self.parts = parts
        self.slices = slices

    @property
    def friction(self) -> Array | None:
        if all(part.friction is None for part in self.parts):
            return None
        found = np.zeros(self.slices[-1].stop)
        for part, where in zip(self.parts, self.slices, strict=True):
            found[where] = 0.0 if part.friction is None else part.friction
        return found

    def apply(self, w: Array) -> Array:
        return np.concatenate([p.apply(w[s]) for p, s in zip(self.parts, self.slices, strict=True)])

    def whiten(self, w: Array) -> Array:
        return np.concatenate([p.whiten(w[s]) for p, s in zip(self.parts, self.slices, strict=True)])

    def unwhiten(self, y: Array) -> Array:
        return np.concatenate([p.unwhiten(y[s]) for p, s in zip(self.parts, self.slices, strict=True)])

    def solve_rows(self, rows: Array) -> Array:
        pieces = [np.ascontiguousarray(rows[:, s]) for s in self.slices]
        return np.concatenate([p.solve_rows(r) for p, r in zip(self.parts, pieces, strict=True)], axis=1)

    def whiten_rows(self, rows: csr_array) -> csr_array:
        every, parts = np.arange(rows.shape[0]), []
        for metric, columns in zip(self.parts, self.slices, strict=True):
            parts.append((every, columns.start, metric.whiten_rows(cut(rows, columns))))
        return csr_array(compose(parts, rows.shape), shape=rows.shape)

    def dense(self) -> Array:
        n = self.slices[-1].stop
        full = np.zeros((n, n))
        for p, s in zip(self.parts, self.slices, strict=True):
            full[s, s] = p.dense()
        return full


def as_metric(M: Array | Metric, nv: int) -> Metric:
    """Return M as a `Metric`.

    Parameters
    ----------
    M : ndarray, shape (nv, nv), or Metric
        Symmetric positive definite.
    nv : int
        The size it must have.

    Raises
    ------
    InputError
        If the shape is wrong, an entry is not finite, or M is not symmetric positive definite.
    """
    if not isinstance(M, type) and all(hasattr(M, name) for name in ("apply", "whiten", "unwhiten", "dense")):
        given: Metric = M  # type: ignore[assignment]
        if given.dense().shape != (nv, nv):
            raise InputError(f"M has shape {given.dense().shape}; it must have ({nv}, {nv})")
        return given
    matrix = array(M, "M")
    if matrix.shape != (nv, nv):
        raise InputError(f"M has shape {matrix.shape}; it must have ({nv}, {nv})")
    if np.abs(matrix - matrix.T).max(initial=0.0) > 1e-9 * np.abs(matrix).max(initial=0.0):
        raise InputError("M is not symmetric")
    return DenseMetric(matrix)
