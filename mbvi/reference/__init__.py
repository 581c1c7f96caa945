"""Problems that carry their exact solution, found by other means than mbvi's schemes and projection."""

from __future__ import annotations

from .closed_forms import bouncing_ball, sliding_in_disc
from .mechanisms import double_pendulum, rocking_block, rod, tumbling_body
from .oscillator import chaotic_oscillator, impact_oscillator
from .polyhedron import chain, corner
from .solution import Reference

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


def references(e: float) -> tuple[Reference, ...]:
    """Return every problem there is for this restitution, each under a name of its own.

    Parameters
    ----------
    e : float
        Restitution in [0, 1].

    Raises
    ------
    InputError
        On e outside [0, 1].
    """
    return (
        bouncing_ball(e),
        impact_oscillator(e),
        chaotic_oscillator(e),
        corner(e),
        corner(e, aim=True),
        corner(e, angle=1.0),
        corner(e, angle=2.0),
        chain(e),
        chain(e, gaps=(0.5, 0.3)),
        chain(e, masses=(1.0, 2.0, 0.5, 1.5), gaps=(0.4, 0.2, 0.3)),
        sliding_in_disc(e),
        double_pendulum(e),
        rod(e),
        rocking_block(e),
        tumbling_body(e),
    )
