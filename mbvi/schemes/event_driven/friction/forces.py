"""Forces of closed contacts with friction, as records and controls receive them."""

from __future__ import annotations

from ....system.system import Array
from ...contact_friction import ContactFriction
from ..rows.contact_rows import SmoothRows
from .modes import ContactModes


def contact_forces(
    rows: SmoothRows, modes: ContactModes, at: tuple[float, Array, Array], closed: Array, time: float
) -> tuple[Array, ContactFriction]:
    """Return the normal percussions of closed contacts at (t, q, v) within a time [s], shape (k,), and their friction.

    Forces are never negative: where contacts depend on each other, each is at least zero.
    """
    equations, found = modes.forces(*at, closed)
    axes = rows.tangents(at[0], at[1], closed).axes
    slip = (equations.slip[..., None] * axes).sum(axis=1)
    slip[modes.sticks] = 0.0
    tangential = time * (found.tangential[..., None] * axes).sum(axis=1)
    return time * found.normal.clip(0.0), ContactFriction(tangential, slip, slip, modes.sticks)
