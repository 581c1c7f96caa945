"""An impact of a run with the contacts around it."""

from __future__ import annotations

from dataclasses import dataclass

from ..system.system import Array
from .motion.friction import ChosenModes


@dataclass(frozen=True)
class ImpactFriction:
    """Friction in an impact and around it.

    Attributes
    ----------
    before, after : ChosenModes
        Modes of the closed contacts before the impact, and when the motion goes on.
    tangential : ndarray, shape (k, 3)
        Percussions of the rows along their tangents, in the world.
    sticks : ndarray of bool, shape (k,)
        Which rows stick in the impact.
    restitution : ndarray, shape (k,)
        e that the law was applied with.
    """

    before: ChosenModes
    after: ChosenModes
    tangential: Array
    sticks: Array
    restitution: Array


@dataclass(frozen=True)
class LocatedImpact:
    """An impact with the contacts around it.

    Attributes
    ----------
    t, q : float and ndarray, shape (nq,)
        Time [s] and configuration.
    before, after : ndarray, shape (nv,)
        Velocity before the impact, and when the motion goes on.
    rows : ndarray of int, shape (k,)
        The rows that touch.
    percussion : ndarray, shape (k,)
        Of each.
    closed_before, held_before, closed_after : ndarray of int
        Rows that were kept closed, rows that those held, and rows that are kept closed when the motion goes on.
    friction : ImpactFriction or None
        None in problems without friction.
    """

    t: float
    q: Array
    before: Array
    after: Array
    rows: Array
    percussion: Array
    closed_before: Array
    held_before: Array
    closed_after: Array
    friction: ImpactFriction | None = None
