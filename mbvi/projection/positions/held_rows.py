"""Kernels of displacements that do not move sticking contacts along their tangents, for a few contacts in a row."""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ..dense.orthonormal_rows import append_row, inner
from ..metric import Array
from ..tree import solve

# displacements whose squared slip is below this part of the largest are not held: a body that stands on slightly
# different heights must be able to turn
HARDLY = 1e-4
# a displacement that holds tangents is at most so many times as long as one row by itself needs without
FARTHEST = 100.0
# a tangent of which less than this is left by others depends on them, and a basis without less than that is exact
_DEPENDENT, _EXACT = 1e-4, 1e-13
# a row of which a smaller part of the squared length is left is rounding
_LEAST = 1e-12
# most sweeps of `diagonalise`; about six suffice
_SWEEPS = 50
# entries off the diagonal below this, relative to the diagonal, are rounding
_ROUNDING = 2.0**-52


@kernel("void(f8[:,::1], b1[::1], b1[::1], i8, f8[:,::1], f8[:,::1])")
def turn_basis(W: Array, near: Array, sticks: Array, size: int, L: Array, Q: Array) -> None:
    """Turn a basis towards the displacements of the largest slip, by a step of orthogonal iteration.

    The arguments are those of `held_tangents`, with the size of the basis.
    """
    half, n, row = len(Q) // 2, W.shape[1], Q[size]
    for c in range(size):
        for k in range(n):
            row[k] = 0.0
        for i in range(len(W)):
            if i % 3 > 0 and near[i // 3] and sticks[i // 3]:
                part = 0.0
                for k in range(n):
                    part += Q[c, k] * W[i, k]
                for k in range(n):
                    row[k] += part * W[i, k]
        append_row(row, c, 0.0, L, Q[half:])
    for c in range(size):
        for k in range(n):
            Q[c, k] = Q[half + c, k]


@kernel("void(f8[:,::1], f8[:,::1])")
def diagonalise(A: Array, V: Array) -> None:
    """Turn a symmetric matrix into a diagonal one; write eigenvectors into the columns of V.

    Both have shape (n, n). These are Jacobi's rotations.
    """
    n = len(A)
    for i in range(n):
        for j in range(n):
            V[i, j] = 1.0 if i == j else 0.0
    for _ in range(_SWEEPS):
        turned = False
        for i in range(n - 1):
            for j in range(i + 1, n):
                off = A[i, j]
                if abs(off) <= _ROUNDING * np.sqrt(abs(A[i, i] * A[j, j])):
                    A[i, j] = A[j, i] = 0.0
                    continue
                turned, ratio = True, 0.5 * (A[j, j] - A[i, i]) / off
                t = (1.0 if ratio >= 0.0 else -1.0) / (abs(ratio) + np.sqrt(1.0 + ratio * ratio))
                c = 1.0 / np.sqrt(1.0 + t * t)
                s = t * c
                for k in range(n):
                    a, b = A[k, i], A[k, j]
                    A[k, i], A[k, j] = c * a - s * b, s * a + c * b
                    a, b = V[k, i], V[k, j]
                    V[k, i], V[k, j] = c * a - s * b, s * a + c * b
                for k in range(n):
                    a, b = A[i, k], A[j, k]
                    A[i, k], A[j, k] = c * a - s * b, s * a + c * b
        if not turned:
            return


@kernel("i8(f8[:,::1], b1[::1], b1[::1], f8[:,::1])")
def strongest_tangents(W: Array, near: Array, sticks: Array, Q: Array) -> int:
    """Write an orthonormal basis of the displacements that are held; return its size.

    The arguments are those of `held_tangents`, which knows the basis with less work where no displacement is near
    `HARDLY`.
    """
    m, n = W.shape
    count, size, largest, rows = 0, 0, 0.0, np.empty((m, n))
    for i in range(m):
        if i % 3 > 0 and near[i // 3] and sticks[i // 3]:
            # copied by numbers: numba takes seconds to compile an assignment of arrays
            for k in range(n):
                rows[count, k] = W[i, k]
            count += 1
    # of many rows the products of columns are the smaller matrix of the same eigenvalues
    many = count > n
    G, V = np.empty((min(count, n), min(count, n))), np.empty((min(count, n), min(count, n)))
    for i in range(len(G)):
        for j in range(len(G)):
            if many:
                G[i, j] = 0.0
                for k in range(count):
                    G[i, j] += rows[k, i] * rows[k, j]
            else:
                G[i, j] = inner(rows[i], rows[j])
    diagonalise(G, V)
    for c in range(len(G)):
        largest = max(largest, G[c, c])
    for c in range(len(G)):
        if G[c, c] > HARDLY * largest:
            for k in range(n):
                Q[size, k] = V[k, c] if many else 0.0
                for i in range(0 if many else count):
                    Q[size, k] += V[i, c] * rows[i, k] / np.sqrt(G[c, c])
            size += 1
    return size


@kernel("i8(f8[:,::1], b1[::1], b1[::1], f8[:,::1], f8[:,::1])")
def held_tangents(W: Array, near: Array, sticks: Array, L: Array, Q: Array) -> int:
    """Write an orthonormal basis of the displacements that are held; return its size.

    Parameters
    ----------
    W : ndarray, shape (3 m, nv)
        Whitened rows of contacts, each normal followed by its two tangents.
    near, sticks : ndarray of bool, shape (m,)
        The contacts that take part, and those that stick. Tangents are held of contacts that are both.
    L, Q : ndarray, shapes (k, k) and (2 k, nv), k > 2 m
        Factors as of `append_row`; the second half of Q is overwritten.
    """
    size, squares, largest, lost, n = 0, 0.0, 0.0, 0.0, W.shape[1]
    for i in range(len(W)):
        if i % 3 == 0 or not (near[i // 3] and sticks[i // 3]):
            continue
        square = 0.0
        for k in range(n):
            square += W[i, k] * W[i, k]
        squares, largest = squares + square, max(largest, square)
        rest = append_row(W[i], size, 0.0, L, Q)
        if rest > _DEPENDENT * np.sqrt(square):
            size += 1
        else:
            lost += rest * rest
    # squared slips of the basis are between the inverse of |L^-1|^2 and the sum of the squares of all rows
    inverse, column = 0.0, L[size]
    for c in range(size):
        for i in range(c, size):
            column[i] = 1.0 if i == c else 0.0
            for j in range(c, i):
                column[i] -= L[i, j] * column[j]
            column[i] /= L[i, i]
            inverse += column[i] * column[i]
    # on which side of `HARDLY` each displacement lies is not certain; written so that a NaN counts
    if size > 0 and not (squares * inverse * HARDLY < 1.0 and lost < HARDLY * largest):
        return strongest_tangents(W, near, sticks, Q)
    if lost > _EXACT * _EXACT * squares:
        turn_basis(W, near, sticks, size, L, Q)
    return size


@kernel("i8(f8[:,::1], i8[::1], f8[:,::1], b1[::1], i8, f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1])")
def hold_rows(
    L: Array, parent: Array, W: Array, near: Array, size: int, Q: Array, J: Array, A: Array, left: Array
) -> int:
    """Write normal rows without their parts along a basis; return how many. Those of which nothing is left are zero.

    Parameters
    ----------
    L, parent
        Factor of the mass matrix; see `tree.solve`.
    W, near, Q
        See `held_tangents`.
    size : int
        Size of the basis Q.
    J, A, left : ndarray, shape (m, nv)
        Receive for each contact that takes part, one after the other, what is left of its normal row, M^-1 times that,
        and that whitened.
    """
    count, n = 0, W.shape[1]
    for a in range(len(near)):
        if not near[a]:
            continue
        row, before = left[count], 0.0
        for k in range(n):
            row[k] = W[3 * a, k]
            before += row[k] * row[k]
        for i in range(size):
            part = 0.0
            for k in range(n):
                part += Q[i, k] * row[k]
            for k in range(n):
                row[k] -= part * Q[i, k]
        after = 0.0
        for k in range(n):
            after += row[k] * row[k]
        for k in range(n):
            # written so that a NaN stays
            row[k] = 0.0 if after <= _LEAST * before else row[k]
            J[count, k] = 0.0
        for k in range(n):
            for i in range(k, n):
                J[count, k] += L[i, k] * row[i]
        count += 1
    solve(L, parent, J[:count], left[:count], A[:count])
    return count


@kernel("b1(f8[:,::1], f8[:,::1], f8[:,::1], b1[::1], f8[::1], f8[::1], f8)")
def raises_near(L: Array, J: Array, W: Array, near: Array, moved: Array, lower: Array, tolerance: float) -> bool:
    """Return whether a displacement raises gaps, and is not much longer than one that need not hold tangents.

    Parameters
    ----------
    L : ndarray, shape (nv, nv)
        Factor of the mass matrix.
    J, W : ndarray, shape (3 m, nv)
        Rows of contacts, and whitened, each normal followed by its two tangents.
    near : ndarray of bool, shape (m,)
        The contacts that take part.
    moved : ndarray, shape (nv,)
        The displacement.
    lower : ndarray, shape (k,)
        Of each contact that takes part, by how much its gap must rise.
    tolerance : float
        To which it must.
    """
    least, i, n = 0.0, 0, len(moved)
    for a in range(len(near)):
        if not near[a]:
            continue
        rise = square = 0.0
        for k in range(n):
            rise += J[3 * a, k] * moved[k]
            square += W[3 * a, k] * W[3 * a, k]
        if rise < lower[i] - tolerance:
            return False
        if lower[i] > 0.0 and square > 0.0:
            least = max(least, lower[i] * lower[i] / square)
        i += 1
    length = 0.0
    for i in range(n):
        part = 0.0
        for k in range(i + 1):
            part += L[i, k] * moved[k]
        length += part * part
    return length <= FARTHEST * FARTHEST * least
