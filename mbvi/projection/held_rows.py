"""Kernels of displacements that do not move sticking contacts along their tangents, for a few contacts in a row."""

from __future__ import annotations

import numpy as np

from ..compiled import kernel
from .metric import Array
from .orthonormal_rows import append_row
from .tree import solve

# displacements whose squared slip is below this part of the largest are not held: a body that stands on slightly
# different heights must be able to turn
HARDLY = 1e-4
# a displacement that holds tangents is at most so many times as long as one row by itself needs without
FARTHEST = 100.0
# a tangent of which less than this is left by others depends on them, and a basis without less than that is exact
_DEPENDENT, _EXACT = 1e-4, 1e-13
# rows of which a smaller part of the squared length is left are not known to rounding
_LEAST = 1e-8


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


@kernel("i8(f8[:,::1], b1[::1], b1[::1], f8[:,::1], f8[:,::1])")
def held_tangents(W: Array, near: Array, sticks: Array, L: Array, Q: Array) -> int:
    """Write an orthonormal basis of the displacements that are held; return its size.

    It is -1 where it is not certain on which side of `HARDLY` some displacement lies.

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
    # written so that a NaN is refused too
    if size > 0 and not (squares * inverse * HARDLY < 1.0 and lost < HARDLY * largest):
        return -1
    if lost > _EXACT * _EXACT * squares:
        turn_basis(W, near, sticks, size, L, Q)
    return size


@kernel("i8(f8[:,::1], i8[::1], f8[:,::1], b1[::1], i8, f8[:,::1], f8[:,::1], f8[:,::1], f8[:,::1])")
def hold_rows(
    L: Array, parent: Array, W: Array, near: Array, size: int, Q: Array, J: Array, A: Array, left: Array
) -> int:
    """Write normal rows without their parts along a basis; return how many, or -1 where hardly anything is left of one.

    Parameters
    ----------
    L, parent
        Factor of the mass matrix, as of `tree.solve`.
    W, near, Q
        As of `held_tangents`.
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
        # written so that a NaN is refused too
        if not after > _LEAST * before:
            return -1
        for k in range(n):
            J[count, k] = 0.0
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
