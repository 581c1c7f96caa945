"""Position limits of joints: lower <= q_k <= upper."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..extrema import least, most
from .active import NOWHERE, Array, Rows


class JointLimits:
    """All position limits of a system, one constraint a side.

    Parameters
    ----------
    nv : int
        Size of v.
    position, velocity : ndarray of int, shape (n,)
        Where each joint's coordinate stands in q and its rate in v.
    lower, upper : ndarray, shape (n,)
        Limits [rad or m]; an infinite one is left out.
    joints : sequence of str
        Names of the joints.
    restitution : float or ndarray, shape (n,)
        e of each joint.
    """

    def __init__(
        self,
        nv: int,
        position: Array,
        velocity: Array,
        lower: Array,
        upper: Array,
        joints: Sequence[str],
        restitution: Array | float = 0.0,
    ) -> None:
        n = len(position)
        e = np.broadcast_to(np.asarray(restitution, dtype=float), (n,))
        bound = np.concatenate([lower, upper])
        kept = np.flatnonzero(np.isfinite(bound))
        joint = np.concatenate([np.arange(n), np.arange(n)])[kept]
        self._sign = np.concatenate([np.ones(n), -np.ones(n)])[kept]
        self._offset = -self._sign * bound[kept]
        self._position, self._velocity = np.asarray(position)[joint], np.asarray(velocity)[joint]
        self._nv = nv
        self.asked_by: object = None
        self._spare = -np.inf
        self.restitution = e[joint]
        self.names = tuple(
            f"{joints[j]} {'lower' if s > 0 else 'upper'} limit" for j, s in zip(joint, self._sign, strict=True)
        )

    def gap(self, t: float, q: Array) -> Array:
        """Return the distances to the limits, shape (m,) [rad or m]."""
        gap = q.take(self._position)
        gap *= self._sign
        gap += self._offset
        return gap

    def gradient(self, t: float, q: Array) -> Array:
        """Return rows of +1 or -1, shape (m, nv)."""
        return self._rows(np.arange(len(self._sign)))

    def _rows(self, index: Array) -> Array:
        rows = np.zeros((len(index), self._nv))
        rows[np.arange(len(index)), self._velocity[index]] = self._sign[index]
        return rows

    def active(self, t: float, q: Array, tolerance: float, travel: Array | None) -> Rows | None:
        """Return the rows of the limits that are reached."""
        if not self._sign.size:
            return None
        # a limit comes no nearer than its joint travels: while there is room to spare no gap is looked at
        self._spare = -np.inf if travel is None else self._spare - most(travel.take(self._velocity))
        if self._spare > tolerance:
            return None
        gap = self.gap(t, q)
        self._spare = least(gap)
        if self._spare > tolerance:
            return None
        index = (gap <= tolerance).nonzero()[0]
        nowhere = np.broadcast_to(NOWHERE, (index.size, 3))
        return Rows(index, gap[index], self._rows(index), self.restitution[index], nowhere, nowhere)
