"""Steps over dead centres of closed loops, where the rank of the equalities drops.

The motion is smooth there, along one of the branches that meet. Beside a dead centre an error of the configuration
changes accelerations by itself over the squared distance. No stage of a step should therefore be near one.
"""

from __future__ import annotations

import numpy as np

from ...system import System
from ...system.mechanisms.loop_margin import loop_margins, with_equalities
from ...system.system import Array

# the time over which the change of the margin is measured, relative to the step
_LOOK = 0.01
# the share of a step at which a dead centre is farthest from all stages, the shares that are as good, and the largest
# share to which the prediction is believed
_FARTHEST, _GOOD, _BELIEVED = 0.467, (0.42, 0.52), 1.5
# the part of the way to a dead centre that is taken where the step does not reach past it
_BEFORE = 0.5
# margin below which a motion that cannot go on is at a dead centre
_AT = 1e-3


def beside_dead_centre(system: System, q: Array, v: Array, h: float) -> float:
    """Return the length of a step of at most h, none of whose stages is near a dead centre."""
    here = loop_margins(system, q)
    if not here.size or not v.any():
        return h
    fall = here - loop_margins(system, system.integrate(q, _LOOK * h * v))
    share = _LOOK * np.divide(here, fall, out=np.full(len(here), np.inf), where=fall > 0.0).min()
    if share > _BELIEVED or _GOOD[0] <= share <= _GOOD[1]:
        return h
    return share / _FARTHEST * h if share < _FARTHEST else _BEFORE * share * h


def at_dead_centre(system: System, t: float, q: Array) -> str:
    """Return what an error says of a motion that cannot go on from q; empty if no loop is at a dead centre there."""
    margins = loop_margins(system, q)
    if not margins.size or margins.min() > _AT:
        return ""
    names = [name for part, _ in with_equalities(system) for name in part.equality_names()]
    name = names[int(margins.argmin())]
    return (
        f"the loop that {name} closes is at a dead centre at t = {t:.6g} s, where its equalities lose rank: several "
        "motions go on from there, and rounding would choose one; take a larger tolerance, or a scheme of fixed steps, "
        "such as Centered"
    )
