"""Kernels that tell whether a contact is closed, and whether it would stay in penetration."""

from __future__ import annotations

from ...compiled import kernel


@kernel("b1(f8, f8, f8)")
def is_closed(percussion: float, rise: float, tolerance: float) -> bool:
    """Return whether a contact is closed that rises so far within a step [m]: one that bears load and closes lands."""
    return abs(rise) <= tolerance or (percussion > 0.0 and rise < 0.0)


@kernel("b1(f8, f8, f8, f8, f8)")
def stays_sunk(depth: float, rise: float, fall: float, e: float, tolerance: float) -> bool:
    """Return whether a row in penetration is raised whatever it bears: nothing else would raise it within two steps.

    Without restitution this is every row. With restitution it is a row that hardly moves, unless it has sunk by an
    impact of this step: it leaves by its rebound.

    Parameters
    ----------
    depth, rise : float
        Penetration at the end of the step, and how far the row moves out in a step at the velocity after the law [m].
    fall : float
        How far it moves out in a step at the velocity before the law [m].
    e, tolerance : float
        Its restitution, and the activation tolerance [m].
    """
    if e >= 1.0 or not depth > tolerance:
        return False
    return e == 0.0 or (2.0 * abs(rise) < depth and depth > -fall)
