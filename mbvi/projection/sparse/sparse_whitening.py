"""Kernels that whiten sparse rows of free bodies, and measure the lengths of rows."""

from __future__ import annotations

import numpy as np

from ...compiled import kernel

Array = np.ndarray


@kernel("void(f8[:,:,::1], i8[::1], f8[::1], f8[::1])")
def whiten_bodies(inverse_lower: Array, body: Array, data: Array, out: Array) -> None:
    """Write L^-1 r of pieces r of rows, one for each body of a row.

    Parameters
    ----------
    inverse_lower : ndarray, shape (n, 6, 6)
        L^-1 of each body, lower triangular.
    body : ndarray of int, shape (k,)
        The body of each piece.
    data, out : ndarray, shape (6 k,)
        The pieces one after the other; receives the whitened ones.
    """
    for piece in range(len(body)):
        b, first = body[piece], 6 * piece
        for i in range(6):
            value = 0.0
            for j in range(i + 1):
                value += inverse_lower[b, i, j] * data[first + j]
            out[first + i] = value


@kernel("void(i8[::1], f8[::1], f8[::1])")
def row_lengths(starts: Array, data: Array, out: Array) -> None:
    """Write the length of each sparse row, shape (m,); starts has shape (m + 1,), data (k,)."""
    for a in range(len(out)):
        square = 0.0
        for k in range(starts[a], starts[a + 1]):
            square += data[k] * data[k]
        out[a] = square**0.5
