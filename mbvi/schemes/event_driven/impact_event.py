"""An impact that the event-driven integrator located: state, constraints and percussions."""

from __future__ import annotations

from typing import NamedTuple

from ...system.system import Array
from ..contact_friction import ContactFriction


class ImpactEvent(NamedTuple):
    """An impact at one instant.

    Attributes
    ----------
    t : float
        When [s].
    q : ndarray, shape (nq,)
        Configuration.
    before, after : ndarray, shape (nv,)
        Velocity before and after the impact.
    number : ndarray of int, shape (k,)
        The constraints that took part.
    rates : ndarray, shape (3, k)
        Percussion, J v before and J v after of each.
    point, normal : ndarray, shape (k, 3)
        Contact points and normals in the world [m]; NaN where a constraint is no contact.
    friction : ContactFriction or None
        None in problems without friction.
    restitution : ndarray, shape (k,), or None
        e that the law was applied with, in problems with friction.
    """

    t: float
    q: Array
    before: Array
    after: Array
    number: Array
    rates: Array
    point: Array
    normal: Array
    friction: ContactFriction | None = None
    restitution: Array | None = None
