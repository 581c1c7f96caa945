"""Which pairs of many shapes are left out, and e and mu of the others, by the places of the shapes in a table.

These are classes, for a function within a function cannot be pickled.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arguments import Array
from .items import SceneItems, entity


@dataclass(frozen=True)
class LeftOut:
    """Which pairs of shapes are left out.

    `sphere`, `closed` and `driven` hold of each shape whether it is a sphere, one that spheres meet in bulk, and one
    that moves on its own; `known` holds i n + j of other pairs, ascending.
    """

    sphere: Array
    closed: Array
    driven: Array
    known: Array

    def __call__(self, i: Array, j: Array) -> Array:
        """Return which of the pairs i < j are left out."""
        sphere, driven = self.sphere, self.driven
        apart = np.isin(i * len(sphere) + j, self.known)
        return np.asarray(sphere[i] & sphere[j] | self.closed[i] & sphere[j] | driven[i] | driven[j] | apart)


@dataclass(frozen=True)
class LeftOutAround:
    """The same of shapes about the first `count` ones, which move on their own."""

    count: int
    sphere: Array
    closed: Array

    def __call__(self, i: Array, j: Array) -> Array:
        """Return which of the pairs i < j are left out."""
        return np.asarray((i >= self.count) | self.closed[i] & self.sphere[j])


@dataclass(frozen=True)
class PairSetting:
    """e or mu of pairs of shapes by their places in `names`; looked up once for each pair of groups of shapes.

    Shapes are in one group if no setting of the scene tells them apart. `friction` is whether it is mu.
    """

    items: SceneItems
    names: tuple[str, ...]
    friction: bool = False

    @cached_property
    def _groups(self) -> tuple[Array, list[str]]:
        """The group of each shape, and one name of each group."""
        pairs = self.items.pair_friction if self.friction else self.items.pair_restitution
        set_for = {name for pair in pairs for name in pair}
        known: dict[tuple[str, ...], int] = {}
        group: list[int] = []
        member: list[str] = []
        for name in self.names:
            key = tuple(n if n in set_for else "" for n in (name, entity(name)))
            if key not in known:
                known[key] = len(member)
                member.append(name)
            group.append(known[key])
        return np.array(group, dtype=np.int64), member

    def __call__(self, i: Array, j: Array) -> Array:
        """Return e or mu of the pairs i < j."""
        group, member = self._groups
        pairs, place = np.unique(group[i] * len(member) + group[j], return_inverse=True)
        sides = [divmod(pair, len(member)) for pair in pairs.tolist()]
        value_of = self.items.friction_of if self.friction else self.items.restitution_of
        return np.array([value_of(member[a], member[b]) for a, b in sides], dtype=float)[place]
