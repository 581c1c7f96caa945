"""Rates of the coordinates of a chart: the tangent vector from a configuration to one that moves."""

from __future__ import annotations

import numpy as np

from ...compiled import kernel
from .frames import cross_product
from .joint_tree import FLIES, FREE, PLANAR, ROLLS, JointTree

Array = np.ndarray

# angle below which series are summed, and |B_2n| / (2 n)! for n = 1, 2, ..., of Bernoulli's numbers
_SMALL = 1.0
_TERMS = (
    1 / 12, 1 / 720, 1 / 30240, 1 / 1209600, 1 / 47900160, 691 / 1307674368000, 1 / 74724249600,
    3617 / 10670622842880000, 43867 / 5109094217170944000, 174611 / 802857662698291200000,
)  # fmt: skip


@kernel("UniTuple(f8, 2)(f8)")
def commutator_factors(angle: float) -> tuple[float, float]:
    """Return the factors a and b of `joint_chart_rates` for an angle below 2 pi."""
    if angle < _SMALL:
        a, b, square, power = _TERMS[0], -_TERMS[1], angle * angle, 1.0
        for n in range(3, len(_TERMS) + 1):
            power *= square
            a -= _TERMS[n - 1] * (n - 2) * power * square
            b -= _TERMS[n - 1] * (n - 1) * power
        return a, b
    sine, lost, square = np.sin(angle), 4.0 * angle * (np.cos(angle) - 1.0), angle * angle
    return 2.0 / square + (angle + 3.0 * sine) / lost, (1.0 / square + (angle + sine) / lost) / square


@kernel("void(f8[::1], f8[::1])")
def commute(x: Array, y: Array) -> None:
    """Overwrite a twist y by its commutator with the twist x, shapes (6,), the velocity before the angular velocity."""
    a, b, c = cross_product(x[3], x[4], x[5], y[0], y[1], y[2])
    d, e, f = cross_product(x[0], x[1], x[2], y[3], y[4], y[5])
    y[0], y[1], y[2] = a + d, b + e, c + f
    y[3], y[4], y[5] = cross_product(x[3], x[4], x[5], y[3], y[4], y[5])


@kernel("void(JointTree, f8[::1], f8[::1], f8[::1])")
def joint_chart_rates(tree: JointTree, dq: Array, v: Array, rate: Array) -> None:
    """Write the rate of dq, shape (nv,), where q + dq along the retraction moves with velocity v.

    Notes
    -----
    Of a joint whose displacements do not commute it is v + [dq, v] / 2 + a [dq, [dq, v]] + b [dq, [dq, [dq, [dq, v]]]]:
    the inverse of the derivative of the exponential map, of which higher commutators are multiples of these.
    """
    for k in range(len(v)):
        rate[k] = v[k]
    x, y = np.zeros(6), np.zeros(6)
    for i in range(1, len(tree.kind)):
        kind, first = tree.kind[i], tree.first_v[i]
        if kind == ROLLS or kind == FLIES:
            place, start, count = first + (3 if kind == FLIES else 0), 3, 3
        elif kind == FREE:
            place, start, count = first, 0, 6
        elif kind == PLANAR:
            place, start, count = first, 0, 3
        else:
            continue
        for k in range(6):
            x[k] = y[k] = 0.0
        for k in range(count):
            # the angular velocity of a planar joint is about its third axis
            to = 5 if kind == PLANAR and k == 2 else start + k
            x[to], y[to] = dq[place + k], v[place + k]
        a, b = commutator_factors(np.sqrt(x[3] * x[3] + x[4] * x[4] + x[5] * x[5]))
        for n in range(1, 5):
            commute(x, y)
            factor = 0.5 if n == 1 else a if n == 2 else b if n == 4 else 0.0
            for k in range(count):
                rate[place + k] += factor * y[5 if kind == PLANAR and k == 2 else start + k]
