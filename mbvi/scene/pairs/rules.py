"""The part of a scene that says which pairs touch, and with which restitution and friction."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...arguments import between, not_negative, printable, shown
from ...constraints.rotations import Resistances
from ...errors import InputError
from ...geometry.shapes.convex_cores import has_core
from ...geometry.shapes.shapes import PlacedShape, Sphere
from ..items import SceneItems, set_last

# most links and single bodies that an error names
_MOST_NAMED = 50


def refuse_others(surface: str, shapes: list[PlacedShape]) -> None:
    """Raise `InputError` if one of the shapes that would meet a surface cannot."""
    others = [s.name for s in shapes if not (isinstance(s.shape, Sphere) or has_core(s.shape))]
    if others:
        raise InputError(
            f"{others[0]} would meet {surface}, but a mesh as it is meets no ellipsoids: use a ball, capsule or "
            f"hull, or let them pass through each other by exclude({others[0]!r}, {surface!r})"
        )


def friction_coefficients(value: Any, name: str) -> tuple[float, float, float]:
    """Return mu and the lengths of torsional and rolling friction, given mu or all three."""
    given: Any = value.tolist() if isinstance(value, np.ndarray) else value
    if not isinstance(given, list | tuple):
        return not_negative(given, name), 0.0, 0.0
    if len(given) != 3:
        raise InputError(f"{name} must be mu, or mu and lengths of torsional and rolling friction; got {shown(value)}")
    mu, torsion, rolling = (not_negative(x, part) for x, part in zip(given, (name, "torsion", "rolling"), strict=True))
    if mu == 0.0 and max(torsion, rolling) > 0.0:
        raise InputError(f"torsional and rolling friction need mu > 0; got {shown(value)} for {name}")
    return mu, torsion, rolling


def resistances_of(items: SceneItems) -> Resistances | None:
    """Return the torsional and rolling friction of a scene; None if it has none.

    Raises
    ------
    InputError
        If the scene has an energy cap too.
    """
    if not items.resists_turning:
        return None
    if items.energy_cap:
        raise InputError("energy_cap does not know torsional and rolling friction: leave one of them out")
    return Resistances(items.resistance_of)


class PairRules:
    """Methods of `Scene` about pairs of things."""

    _items: SceneItems

    def set_restitution(self, first: str, second: str, e: float) -> None:
        """Set the restitution between two things: robots, bodies, walls, or single links "robot/link".

        Parameters
        ----------
        first, second : str
            Names; the same twice is a robot's contact with itself, or that of the members of a group.
        e : float
            Newton's e in [0, 1]; a link's own setting goes before its robot's, the last said before the earlier.

        Raises
        ------
        InputError
            If a name is unknown, no pair of these two can touch, or e is outside [0, 1].
        """
        e = between(e, "restitution e", 0.0, 1.0)
        set_last(self._items.pair_restitution, self._pairs(first, second), e)

    def set_friction(self, first: str, second: str, mu: float | tuple[float, float, float]) -> None:
        """Set the coefficients of friction between two things, named as in `set_restitution`.

        Parameters
        ----------
        first, second : str
            Names; settings go before each other as those of e do.
        mu : float or tuple of three floats
            Coefficient of Coulomb friction, at least 0, or that and the lengths of torsional and of rolling friction
            [m]; see `Scene`. Above 100 mu counts as 100: nothing that bears slips then.

        Raises
        ------
        InputError
            If a name is unknown, no pair of these two can touch, a number is negative or not finite, or there is
            torsional or rolling friction where mu is 0.
        """
        mu, *resistance = friction_coefficients(mu, "friction mu")
        pairs = self._pairs(first, second)
        set_last(self._items.pair_friction, pairs, mu)
        set_last(self._items.pair_resistance, pairs, (resistance[0], resistance[1]))

    def exclude(self, first: str, second: str) -> None:
        """Let two things pass through each other, whatever else is said of them.

        Parameters
        ----------
        first, second : str
            Names as in `set_restitution`, such as "robot/link" and "bucket".

        Raises
        ------
        InputError
            If a name is unknown, or no pair of these two can touch anyway.
        """
        self._items.excluded.update(self._pairs(first, second))

    def _pairs(self, first: str, second: str) -> list[frozenset[str]]:
        """Return the pairs of things or shapes in the scene that two names stand for."""
        items = self._items
        things, parts, links = items.names(), items.parts(), items.shapes_of_links()
        sides = []
        for name in (printable(first, "first"), printable(second, "second")):
            if name not in things and name not in parts and name not in links:
                known = sorted(things) + sorted(parts - things)[:_MOST_NAMED]
                raise InputError(f"unknown name {shown(name)}; known are {', '.join(known) or 'none yet'}")
            sides.append([name] if name in things or name in parts else links[name])
        pairs = [(a, b) for a in sides[0] for b in sides[1] if items.can_meet(a, b)]
        if not pairs:
            raise InputError(
                f"no pair of {shown(first)} and {shown(second)} can touch: they are one body, both of the world, "
                "without a shape, or left out by the robot's file"
            )
        return [frozenset(pair) for pair in pairs]
