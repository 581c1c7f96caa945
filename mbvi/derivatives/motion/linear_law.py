"""The linearised law of an impact."""

from __future__ import annotations

from typing import NamedTuple

from ...system.system import Array


class LinearLaw(NamedTuple):
    """The law of an impact on some rows, and its derivatives.

    Attributes
    ----------
    after : ndarray, shape (nv,)
        The velocity after it.
    by_q, by_v : ndarray, shape (nv, nv)
        Its derivatives by configuration and velocity before.
    by_e : ndarray, shape (nv, k)
        Its derivative by the restitution of each row.
    by_p : ndarray, shape (nv, m)
        Its derivatives by the parameters.
    """

    after: Array
    by_q: Array
    by_v: Array
    by_e: Array
    by_p: Array
