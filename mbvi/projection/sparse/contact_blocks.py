"""Kernel that packs sparse rows of contacts into blocks, with tangents along the axes of each contact's own law."""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from ..metric import Array

# share of the larger eigenvalue, and of the normal entry, that is rounding
_ROUNDING = 1e-13
# a smaller second eigenvalue, relative to the first, is replaced by this
_RANK = 1e-14


@kernel("void(f8[::1], u4[::1], u4[::1], i8, i8[::1], f8[::1], u4[::1], u4[::1], f8[:,::1])")
def pack_contacts(
    data: Array, columns: Array, starts: Array, n: int, bound: Array, blocks: Array, own_columns: Array,
    own_starts: Array, local: Array,
) -> None:  # fmt: skip
    """Write the three rows of each contact side by side, scaled and with tangents in the axes of its own law.

    Parameters
    ----------
    data, columns, starts : ndarray, shapes (k,), (k,), (3 m + 1,)
        Whitened rows, one after the other: of each contact its normal and two tangents.
    n : int
        Columns in all.
    bound : ndarray of int, shape (m,)
        See `coulomb_law`. A contact that is bounded by another is scaled to its tangents.
    blocks, own_columns, own_starts : ndarray, shapes (3 k,), (k,), (m + 1,)
        Receive three values for each column of a contact, its columns, and where they begin. The rows are divided by
        the length of the normal one, or are zero where that is zero. The tangents are turned.
    local : ndarray, shape (m, 7)
        Receives the normal's product with the first and the second turned tangent, the eigenvalues of the tangential
        block less the part that the normal takes, the larger first, minus that where the second tangent of a bounded
        contact moves nothing, the cosine and the sine of the turn, and the
        factor of scale.
    """
    place, count = np.full(n, -1), 0
    own_starts[0] = 0
    for a in range(len(local)):
        begin = count
        for row in range(3):
            for k in range(starts[3 * a + row], starts[3 * a + row + 1]):
                if place[columns[k]] < begin:
                    place[columns[k]] = count
                    own_columns[count] = columns[k]
                    blocks[3 * count] = blocks[3 * count + 1] = blocks[3 * count + 2] = 0.0
                    count += 1
                blocks[3 * place[columns[k]] + row] += data[k]
        own_starts[a + 1] = count
        g00 = g01 = g02 = g11 = g12 = g22 = 0.0
        for k in range(begin, count):
            r0, r1, r2 = blocks[3 * k], blocks[3 * k + 1], blocks[3 * k + 2]
            g00, g01, g02 = g00 + r0 * r0, g01 + r0 * r1, g02 + r0 * r2
            g11, g12, g22 = g11 + r1 * r1, g12 + r1 * r2, g22 + r2 * r2
        bounded = bound[a] >= 0
        if bounded:
            g00 = max(g11, g22)
        if g00 == 0.0:
            for k in range(begin, count):
                blocks[3 * k + 1] = blocks[3 * k + 2] = 0.0
            local[a, 0] = local[a, 1] = local[a, 5] = local[a, 6] = 0.0
            local[a, 2] = local[a, 3] = local[a, 4] = 1.0
            continue
        k1, k2 = g01 / g00, g02 / g00
        a11, a12, a22 = g11 / g00 - k1 * k1, g12 / g00 - k1 * k2, g22 / g00 - k2 * k2
        mean, half = 0.5 * (a11 + a22), 0.5 * (a11 - a22)
        spread, x, y = np.sqrt(half * half + a12 * a12), 1.0, 0.0
        if spread > _ROUNDING * mean:
            x, y = (half + spread, a12) if half >= 0.0 else (a12, spread - half)
            length = np.sqrt(x * x + y * y)
            x, y = x / length, y / length
        else:
            spread = 0.0
        # what is rounding becomes zero, for which there is a closed form
        if k1 * k1 + k2 * k2 <= _ROUNDING**2:
            k1 = k2 = 0.0
        scale = 1.0 / np.sqrt(g00)
        for k in range(begin, count):
            r1, r2 = scale * blocks[3 * k + 1], scale * blocks[3 * k + 2]
            blocks[3 * k] *= scale
            blocks[3 * k + 1], blocks[3 * k + 2] = x * r1 + y * r2, x * r2 - y * r1
        local[a, 0], local[a, 1] = x * k1 + y * k2, x * k2 - y * k1
        local[a, 2] = max(mean + spread, _RANK)
        local[a, 3] = max(mean - spread, _RANK * local[a, 2])
        if bounded and local[a, 3] <= _ROUNDING * local[a, 2]:
            # no velocity along the second tangent
            local[a, 3] = -local[a, 2]
        local[a, 4], local[a, 5], local[a, 6] = x, y, scale
