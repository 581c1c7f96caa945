"""Position limits of joints: lower <= q_k <= upper."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..compiled import kernel
from .active import NOWHERE, Array, Rows


def _reached_plain(where: Array, sign: Array, offset: Array, tolerance: float, gap: Array) -> float:
    """Write the gaps sign where + offset, all of shape (m,); return the least less the tolerance."""
    gap[:] = sign * where + offset
    return float(gap.min()) - tolerance


@kernel("f8(f8[::1], f8[::1], f8[::1], f8, f8[::1])", plain=_reached_plain)
def _reached(where: Array, sign: Array, offset: Array, tolerance: float, gap: Array) -> float:
    nearest = np.inf
    for a in range(len(sign)):
        gap[a] = sign[a] * where[a] + offset[a]
        nearest = min(nearest, gap[a])
    return nearest - tolerance


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
        self._position, self._velocity = (np.asarray(p, dtype=np.int64)[joint] for p in (position, velocity))
        self._nv = nv
        self.asked_by: object = None
        self.first_number = 0
        self.envelope = np.zeros(nv)
        self.envelope[self._velocity] = 1.0
        self.spare, self.busy = -np.inf, False
        self._gap = np.empty(len(kept))
        self._nowhere = np.tile(NOWHERE, (len(kept), 1))
        # the rows last reached, which are often reached again
        self._key = b""
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

    def forget(self) -> None:
        """Look at every limit next time."""
        self.spare, self._key = -np.inf, b""

    def active(self, t: float, q: Array, tolerance: float, travel: Array | None) -> Rows | None:
        """Return the rows of the limits that are reached."""
        if not self._sign.size:
            self.spare = np.inf
            return None
        # a limit comes no nearer than its joint travels
        spare = _reached(q.take(self._position), self._sign, self._offset, tolerance, self._gap)
        if spare > 0.0:
            self.spare = spare
            return None
        self.spare = -np.inf
        index = (self._gap <= tolerance).nonzero()[0]
        key = index.tobytes()
        if key != self._key:
            self._key = key
            self._rows_of = index + self.first_number, self._rows(index), self.restitution[index]
        number, rows, restitution = self._rows_of
        nowhere = self._nowhere[: len(index)]
        return Rows(number, self._gap.take(index), rows.copy(), restitution, nowhere, nowhere)
