"""The family of position limits of joints: lower <= q_k <= upper."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...compiled import kernel
from ..family import ConstraintFamily
from ..mechanism.held_rows import LIMIT, RowParts
from ..rebuilt import Rebuilt
from ..rows import NO_POINT, Array, Rows


@kernel("Tuple((f8, b1))(f8[::1], f8[::1], f8[::1], f8[::1], f8, i8[::1], f8[::1])")
def _limits_within(
    where: Array, sign: Array, offset: Array, lever: Array, tolerance: float, index: Array, gap: Array
) -> tuple[float, bool]:
    """Find the gaps, sign where + offset of shape (m,), that are within the tolerance when multiplied by the lever.

    Parameters
    ----------
    lever : ndarray, shape (m,)
        Factors by which the gaps become lengths.
    tolerance : float
        The largest length [m].
    index : ndarray of int, shape (m + 1,)
        First how many limits were within the tolerance at the last call, then which; overwritten.
    gap : ndarray, shape (c,)
        Receives their gaps, if they are the limits of the last call; c is their number then.

    Returns
    -------
    nearest : float
        The least gap as a length [m].
    same : bool
        Whether they are the limits of the last call.
    """
    count, nearest, same = 0, np.inf, True
    for a in range(len(sign)):
        here = sign[a] * where[a] + offset[a]
        nearest = min(nearest, lever[a] * here)
        if lever[a] * here <= tolerance:
            same = same and count < len(gap) and index[1 + count] == a
            index[1 + count] = a
            if same:
                gap[count] = here
            count += 1
    same = same and count == index[0]
    index[0] = count
    return nearest, same


class JointLimits(Rebuilt, ConstraintFamily):
    """All position limits of a system, one constraint for each lower and each upper limit.

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
    lever : float or ndarray, shape (n,)
        The factor by which a gap becomes a length: the scene's length for a joint that turns [m/rad], 1 for one that
        slides.

    Attributes
    ----------
    lever : ndarray, shape (m,)
        The lever of each limit.
    """

    of_joints = True

    def __init__(
        self,
        nv: int,
        position: Array,
        velocity: Array,
        lower: Array,
        upper: Array,
        joints: Sequence[str],
        restitution: Array | float = 0.0,
        lever: Array | float = 1.0,
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
        self.lever: Array = np.broadcast_to(np.asarray(lever, dtype=float), (n,))[joint].copy()
        self.restitution: Array = e[joint]
        self.size = len(kept)
        # first how many limits were within the tolerance at the last query, then which
        self._index = np.zeros(len(kept) + 1, np.int64)
        self._constant_part = self._rows_of(self._index[1:1])
        self.names = tuple(
            f"{joints[j]} {'lower' if s > 0 else 'upper'} limit" for j, s in zip(joint, self._sign, strict=True)
        )

    @property
    def arrays(self) -> tuple[Array, Array, Array, Array, Array]:
        """Of each limit sign and offset of its gap, lever, and places in q and v, each of shape (m,)."""
        return self._sign, self._offset, self.lever, self._position, self._velocity

    def gap(self, t: float, q: Array) -> Array:
        """Return the distances to the limits, shape (m,) [rad or m]."""
        gap = q.take(self._position)
        gap *= self._sign
        gap += self._offset
        return gap

    def gradient(self, t: float, q: Array) -> Array:
        """Return rows of +1 or -1, shape (m, nv)."""
        return self.row_gradient(t, q, np.arange(self.size))

    def reach(self) -> Array:
        """Return the absolute gradients: a limit comes no nearer than its joint travels."""
        return np.abs(self.row_gradient(0.0, np.zeros(0), np.arange(self.size)))

    def row_gradient(self, t: float, q: Array, rows: Array) -> Array:
        """Return the gradients of some limits, shape (k, nv)."""
        gradient = np.zeros((len(rows), self._nv))
        gradient[np.arange(len(rows)), self._velocity[rows]] = self._sign[rows]
        return gradient

    def row_bias(self, t: float, q: Array, v: Array, rows: Array) -> Array:
        """Return (dJ/dt) v of some limits, which is zero."""
        return np.zeros(len(rows))

    def row_parts(self, rows: Array) -> RowParts:
        """Return what some limits are, for kernels."""
        parts = np.zeros((len(rows), 2, 2, 3))
        parts[:, 0, 0, 0], parts[:, 0, 0, 1] = self._sign[rows], self._offset[rows]
        sides = np.stack([self._position[rows], self._velocity[rows]], axis=1)
        return RowParts(np.full(len(rows), LIMIT), sides, parts, *np.zeros((2, len(rows))))

    def describe(self) -> str:
        """Return one line of `Problem.report()`, in words."""
        return f"{self.size} joint limits"

    def contacts(self, t: float, q: Array, tolerance: float) -> Rows | None:
        """Return the rows of the limits within the tolerance, or None."""
        if not self.size:
            self._clearance = np.inf
            return None
        number, rows, restitution, nowhere = self._constant_part
        where, gap = q.take(self._position), np.empty(len(number))
        nearest, same = _limits_within(where, self._sign, self._offset, self.lever, tolerance, self._index, gap)
        # a row must be returned at every step, so that no step can be skipped while there is one
        self._clearance = -np.inf if nearest <= tolerance else nearest - tolerance
        if not same:
            within = self._index[1 : 1 + self._index[0]]
            self._constant_part = number, rows, restitution, nowhere = self._rows_of(within)
            gap = np.empty(len(number))
            _limits_within(where, self._sign, self._offset, self.lever, tolerance, self._index, gap)
        if not gap.size:
            return None
        return Rows(number, gap, rows.copy(), restitution, nowhere, nowhere)

    def _rows_of(self, index: Array) -> tuple[Array, Array, Array, Array]:
        """Return the constant part of the rows of some limits: numbers, gradients, e, and points that are NaN."""
        nowhere = np.tile(NO_POINT, (len(index), 1))
        return index.copy(), self.row_gradient(0.0, np.zeros(0), index), self.restitution[index], nowhere
