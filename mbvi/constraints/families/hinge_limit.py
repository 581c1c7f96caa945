"""The family of limits of hinges that close loops: lower <= angle of the second body about the axis <= upper."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...system import System
from ...system.mechanisms.hinge_angles import HingeAngles
from ..family import ConstraintFamily
from ..rows import Array


class HingeLimits(ConstraintFamily):
    """Limits of the angles of hinges between bodies, the lower ones first.

    Parameters
    ----------
    system : System
        The system.
    angles : HingeAngles
        Their angles.
    limits : ndarray, shape (2, n)
        Lower and upper limits [rad].
    names : sequence of str
        Names of the hinges.
    restitution : float
        e of all.
    lever : float
        The factor by which an angle becomes a length [m/rad].
    """

    of_joints = True

    def __init__(
        self, system: System, angles: HingeAngles, limits: Array, names: Sequence[str], restitution: float, lever: float
    ) -> None:
        self._system, self._angles, self._limits = system, angles, limits
        self.size = 2 * len(names)
        self.names = tuple(f"{name} {side} limit" for side in ("lower", "upper") for name in names)
        self.restitution, self.lever = restitution, lever

    def gap(self, t: float, q: Array) -> Array:
        """Return the angles from the lower and to the upper limits, shape (2 n,) [rad]."""
        angle = self._angles.at(self._system, q)
        return np.concatenate([angle - self._limits[0], self._limits[1] - angle])

    def gradient(self, t: float, q: Array) -> Array:
        """Return the gradients of the angles and their negatives, shape (2 n, nv)."""
        turning = self._angles.gradients(self._system, q)
        return np.concatenate([turning, -turning])

    def describe(self) -> str:
        """Return one line of `Problem.report()`, in words."""
        return f"{self.size} limits of hinges"
