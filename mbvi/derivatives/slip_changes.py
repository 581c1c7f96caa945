"""Carries variations over stops of sliding contacts, where friction forces jump."""

from __future__ import annotations

import numpy as np

from ..system.system import Array
from .directions import Directions
from .impacts import Refuse
from .motion.friction import ChosenModes
from .motion.linearised import Linearised

# least rate at which a slip vanishes, relative to the acceleration of its row, and the largest slip of a variation
# after the stop that its error explains, relative to its size
_SLOWEST, _LEFT = 1e-6, 1e-4


class SlipChanges:
    """Stops of sliding contacts, which stick or slip another way afterwards.

    A variation x = (dq, dv) shifts the time of the stop by s = -d(w . T v) / r, with the slip w . T v along its
    direction w and its rate r, and dv becomes dv + (a- - a+) s with the accelerations a before and after.

    Parameters
    ----------
    linear : Linearised
        The derivatives of the motion.
    varied : Directions
        The columns of the variations.
    refuse : callable
        refuse(reason, rows, time) raises `SensitivityError`.

    Attributes
    ----------
    stopped : int
        The row whose slip vanishes at the end of the last step, as an index of its closed rows; -1 if none does.
    """

    def __init__(self, linear: Linearised, varied: Directions, refuse: Refuse) -> None:
        self._linear, self._varied, self._refuse, self.stopped = linear, varied, refuse, -1

    def carried(
        self,
        at: tuple[float, Array, Array],
        after: Array,
        was: tuple[Array, ChosenModes],
        now: tuple[Array, ChosenModes],
        X: Array,
    ) -> Array:
        """Return variations X, shape (2 nv, p), after a stop.

        Parameters
        ----------
        at : (t, q, v)
            When, and the state.
        after : ndarray, shape (nv,)
            The acceleration after it.
        was, now : (ndarray of int, ChosenModes)
            The closed rows and their modes, before and after.
        X : ndarray, shape (2 nv, p)
            The variations.
        """
        linear, (t, q, v), (closed, modes) = self._linear, at, was
        linear.choose(modes)
        assert linear.friction is not None
        n, k = len(v), self.stopped
        way = linear.friction.turn_to_stop(t, q, v, closed, k)
        before, row = linear.flow.acceleration(t, q, v, closed)[:n], closed[k : k + 1]
        X = linear.friction.stopped_across(t, q, v, closed, k, self._kept(at, closed, X))
        T, slopes, along = linear.friction.slip(t, q, v, row)
        rate = float(way @ (T @ before - along))
        terms = float(np.abs(T @ before).max() + np.abs(along).max())
        if not rate < -_SLOWEST * terms:
            self._refuse("its slip vanishes with hardly any rate", row, t)
        shift = -(way @ (slopes @ X[:n] + T @ X[n:])) / rate
        X = np.vstack([X[:n], X[n:] + np.outer(before - after, shift)])
        linear.choose(now[1])
        kept, units = self._kept(at, now[0], X), linear.units[:, None]
        if np.abs((kept - X) / units).max() > _LEFT * np.abs(X / units).max():
            self._refuse("the direction of its slip is not known where it stops", row, t)
        return np.asarray(kept)

    def _kept(self, at: tuple[float, Array, Array], closed: Array, X: Array) -> Array:
        """Return variations in which closed rows stay closed, and move with their walls."""
        onto, moved = self._linear.tangents(*at, closed, self._varied.by_gap[self._linear.rows.number[closed]], False)
        return np.asarray(onto @ X + moved)
