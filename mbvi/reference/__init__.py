"""Problems with exact solutions, computed without mbvi's schemes and projection."""

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
    "MAKERS",
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

# functions of e, by the name of the problem
MAKERS: dict[str, Callable[[float], Reference]] = {
    "bouncing ball": bouncing_ball,
    "impact oscillator": impact_oscillator,
    "chaotic oscillator": chaotic_oscillator,
    "corner of 90 degrees": corner,
    "corner of 90 degrees, aimed at": partial(corner, aim=True),
    "corner of 57.3 degrees": partial(corner, angle=1.0),
    "corner of 114.6 degrees": partial(corner, angle=2.0),
    "chain of 3, touching": chain,
    "chain of 3, apart": partial(chain, gaps=(0.5, 0.3)),
    "chain of 4, apart, unequal masses": partial(chain, masses=(1.0, 2.0, 0.5, 1.5), gaps=(0.4, 0.2, 0.3)),
    "sliding in a disc": sliding_in_disc,
    "double pendulum": double_pendulum,
    "rod": rod,
    "rocking block": rocking_block,
    "tumbling body": tumbling_body,
}


def references(e: float) -> tuple[Reference, ...]:
    """Return every problem that has a solution at this restitution.

    Parameters
    ----------
    e : float
        Restitution in [0, 1].

    Returns
    -------
    tuple of Reference
        The problems with their default arguments. Oscillators are left out where e is so small that impacts accumulate
        or no periodic orbit exists.

    Raises
    ------
    InputError
        If e is outside [0, 1].
    """
    e, _ = checked(e, 1.0)
    found = []
    for make in MAKERS.values():
        try:
            found.append(make(e))
        except InputError:
            continue
    return tuple(found)
