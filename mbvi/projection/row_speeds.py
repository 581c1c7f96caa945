"""The kernel of the rates of rows."""

from __future__ import annotations

from ..compiled import kernel
from .metric import Array


@kernel("void(f8[:,::1], f8[::1], f8, f8[::1])")
def row_speeds(J: Array, v: Array, time: float, change: Array) -> None:
    """Write by how much the gaps of the first rows change within a time, shape (k,).

    Four sums side by side wait less for each other.
    """
    m, fours = len(change), len(change) - len(change) % 4
    for i in range(0, fours, 4):
        a = b = c = d = 0.0
        for k in range(len(v)):
            x = v[k]
            a, b, c, d = a + J[i, k] * x, b + J[i + 1, k] * x, c + J[i + 2, k] * x, d + J[i + 3, k] * x
        change[i], change[i + 1], change[i + 2], change[i + 3] = time * a, time * b, time * c, time * d
    for i in range(fours, m):
        a = 0.0
        for k in range(len(v)):
            a += J[i, k] * v[k]
        change[i] = time * a
