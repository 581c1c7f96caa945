"""Problems that carry their exact solution, found by other means than mbvi's schemes and projection."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from ..errors import InputError
from .closed_forms import bouncing_ball, sliding_in_disc
from .mechanisms import double_pendulum, rocking_block, rod, tumbling_body
from .oscillator import chaotic_oscillator, impact_oscillator
from .polyhedron import chain, corner
from .solution import Reference, checked

__all__ = [
    "Reference",
    "bouncing_ball",
    "chain",
    "chaotic_oscillator",
    "corner",
    "double_pendulum",
    "impact_oscillator",
    "references",
    "rocking_block",
    "rod",
    "sliding_in_disc",
    "tumbling_body",
]


_MAKERS: tuple[Callable[[float], Reference], ...] = (
    bouncing_ball,
    impact_oscillator,
    chaotic_oscillator,
    corner,
    partial(corner, aim=True),
    partial(corner, angle=1.0),
    partial(corner, angle=2.0),
    chain,
    partial(chain, gaps=(0.5, 0.3)),
    partial(chain, masses=(1.0, 2.0, 0.5, 1.5), gaps=(0.4, 0.2, 0.3)),
    sliding_in_disc,
    double_pendulum,
    rod,
    rocking_block,
    tumbling_body,
)


def references(e: float) -> tuple[Reference, ...]:
    """Return every problem that has a solution at this restitution, each under a name of its own.

    Parameters
    ----------
    e : float
        Restitution in [0, 1].

    Returns
    -------
    tuple of Reference
        With their default arguments. Left out is what raises at this e: the oscillators, where e is small and impacts
        accumulate or the periodic orbit is none.

    Raises
    ------
    InputError
        On e outside [0, 1].
    """
    e, _ = checked(e, 1.0)
    found = []
    for make in _MAKERS:
        try:
            found.append(make(e))
        except InputError:
            continue
    return tuple(found)
