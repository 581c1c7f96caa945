"""Problems with exact solutions, computed without mbvi's schemes and projection."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from ..errors import InputError
from .closed_forms import bouncing_ball, sliding_in_disc
from .mechanisms import double_pendulum, rocking_block, rod, tumbling_body
from .oscillator import chaotic_oscillator, impact_oscillator
from .polyhedron import chain, corner
from .rough_ball import ball_with_spin, rolling_ball
from .rough_pendulum import wall_pendulum
from .rough_plane import block_on_belt, block_on_incline, tipping_box
from .rough_rod import painleve_rod
from .rough_tripod import spinning_tripod
from .solution import Reference, checked

__all__ = [
    "MAKERS",
    "ROUGH",
    "Reference",
    "ball_with_spin",
    "block_on_belt",
    "block_on_incline",
    "bouncing_ball",
    "chain",
    "chaotic_oscillator",
    "corner",
    "double_pendulum",
    "impact_oscillator",
    "painleve_rod",
    "references",
    "rocking_block",
    "rod",
    "rolling_ball",
    "sliding_in_disc",
    "spinning_tripod",
    "tipping_box",
    "tumbling_body",
    "wall_pendulum",
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

# problems with friction, by what happens in them; they have a restitution of their own
ROUGH: dict[str, Callable[[], Reference]] = {
    "block that sticks": partial(block_on_incline, 0.5, 0.45),
    "block that slides": partial(block_on_incline, 0.5, 0.6),
    "block launched on a floor": partial(block_on_incline, 0.5, 0.0, 2.0),
    "block launched up, that comes back": partial(block_on_incline, 0.5, 0.6, -1.5),
    "block launched up, that stays": partial(block_on_incline, 0.5, 0.45, -1.5),
    "block on a belt": block_on_belt,
    "box that tips": tipping_box,
    "ball that slides, then rolls": rolling_ball,
    "ball with backspin": partial(rolling_ball, 0.4, 0.0, 1.0, -40.0),
    "ball that rolls down": partial(rolling_ball, 0.2, 0.4, 0.0),
    "ball that slides down": partial(rolling_ball, 0.2, 0.9, 0.0),
    "ball with spin, six bounces": ball_with_spin,
    "ball with spin, e = 1": partial(ball_with_spin, 1.0, 0.05),
    "tripod that spins": spinning_tripod,
    "tripod that slides and spins": partial(spinning_tripod, 0.4, 0.5, 10.0),
    "pendulum on a wall": wall_pendulum,
    "Painlevé rod": painleve_rod,
    "Painlevé rod with a ball": partial(painleve_rod, tip=0.01),
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
