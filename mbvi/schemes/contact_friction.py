"""Friction of the rows of a step as impacts and contacts give it: world vectors, and which rows stick."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..constraints.contact import Contact

if TYPE_CHECKING:
    from .step import Step

Array = np.ndarray

# slip that counts as none, relative to the largest speed of the row
_STILL = 1e-9
# part of the largest speed of all rows that each one has at least
_OTHERS = 1e-6


class ContactFriction(NamedTuple):
    """Friction of rows.

    Attributes
    ----------
    tangential : ndarray, shape (k, 3)
        Tangential percussions on the body that the normal points to, in the world [N s].
    before, after : ndarray, shape (k, 3)
        Tangential velocities of that body relative to the other, in the world [m/s]; zero where mu = 0.
    sticks : ndarray of bool, shape (k,)
        Which rows stick; False where mu = 0 and where there is no percussion.
    angular : ndarray, shape (k, 3), or None
        Percussions of torsional and rolling friction on that body, in the world [N m s]; None in problems without.
    """

    tangential: Array
    before: Array
    after: Array
    sticks: Array
    angular: Array | None = None

    def take(self, index: Array | slice) -> ContactFriction:
        """Return those of some rows."""
        angular = None if self.angular is None else self.angular[index]
        tangential, before, after, sticks = (values[index] for values in self[:4])
        return ContactFriction(tangential, before, after, sticks, angular)


def friction_of(step: Step) -> ContactFriction | None:
    """Return the friction of a step's rows; None if its problem has none.

    A row sticks if its velocity is nearer to zero than its percussion is to the edge of the cone, relative to the
    largest speed of the row, or to a small part of that of all, and to mu p: in exact numbers one of the two is zero.
    """
    tangents = step.active.tangents
    if tangents is None:
        return None
    if step.slip is None:
        # a scheme without friction
        nothing = np.zeros((len(step.rates[0]), 3))
        return ContactFriction(nothing, nothing, nothing, np.zeros(len(nothing), bool))
    percussion, free, _, before = np.abs(step.rates)
    across, free_slip, after_slip, before_slip = np.hypot(step.slip[:, :, 0], step.slip[:, :, 1])
    edge = tangents.friction * percussion
    speed = np.maximum(np.maximum(free, before), np.maximum(free_slip, before_slip))
    # what rests where others strike has no speed of its own
    speed = np.maximum(speed, _OTHERS * speed.max(initial=0.0))
    # multiplied out, because both may be divisions by zero; of dependent contacts some stick at the edge of their cones
    sticks = (edge > 0.0) & (after_slip * edge <= np.maximum(edge - across, _STILL * edge) * speed)
    tangential, _, after, before = (step.slip[..., :2, None] * tangents.axes).sum(axis=2)
    if step.slip.shape[2] == 2:
        return ContactFriction(tangential, before, after, sticks)
    # constraints without a normal have no torque
    normal = np.nan_to_num(step.active.normal)
    axes = np.concatenate([normal[:, None], tangents.axes], axis=1)
    return ContactFriction(tangential, before, after, sticks, (step.slip[0, :, 2:, None] * axes).sum(axis=1))


def with_friction(contacts: Sequence[Contact], friction: ContactFriction, h: float) -> tuple[Contact, ...]:
    """Return contacts of a step of the length h [s] with the friction of their rows."""
    angular = np.zeros_like(friction.tangential) if friction.angular is None else friction.angular
    # that of an instantaneous percussion is infinite
    with np.errstate(divide="ignore"):
        torque = np.divide(angular, h, out=np.zeros_like(angular), where=angular != 0.0)
    rows = zip(contacts, friction.tangential, friction.after, friction.sticks.tolist(), torque, strict=True)
    return tuple(replace(c, tangential=p, slip=u, regime=regime(s, c.percussion), torque=m) for c, p, u, s, m in rows)


def regime(sticks: bool, percussion: float) -> str:
    """Return "stick", "slip" or, without a percussion, "open"."""
    return "open" if percussion == 0.0 else "stick" if sticks else "slip"
