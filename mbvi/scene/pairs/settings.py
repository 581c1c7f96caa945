"""Which pairs of many shapes are left out, and e and mu of the others, by the places of the shapes in a table.

These are classes, for a function within a function cannot be pickled.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...arguments import Array
from ..items import SceneItems, entity


@dataclass(frozen=True)
class LeftOut:
    """Which pairs of shapes are left out.

    `sphere`, `closed` and `driven` hold of each shape whether it is a sphere, one that spheres meet in bulk, and one
    that moves on its own; `known` holds i n + j of other pairs, ascending. `excluded` is 1 for pairs that the user
    leaves out.
    """

    sphere: Array
    closed: Array
    driven: Array
    known: Array
    excluded: PairSetting | None = None

    def __call__(self, i: Array, j: Array) -> Array:
        """Return which of the pairs i < j are left out."""
        sphere, driven = self.sphere, self.driven
        apart = np.isin(i * len(sphere) + j, self.known)
        out = sphere[i] & sphere[j] | self.closed[i] & sphere[j] | driven[i] | driven[j] | apart
        return out if self.excluded is None else np.asarray(out | (self.excluded(i, j) > 0.0))


@dataclass(frozen=True)
class LeftOutAround:
    """The same of shapes about the first `count` ones, which move on their own."""

    count: int
    sphere: Array
    closed: Array
    excluded: PairSetting | None = None

    def __call__(self, i: Array, j: Array) -> Array:
        """Return which of the pairs i < j are left out."""
        out = (i >= self.count) | self.closed[i] & self.sphere[j]
        return out if self.excluded is None else np.asarray(out | (self.excluded(i, j) > 0.0))


@dataclass(frozen=True)
class PairSetting:
    """e or mu of pairs of shapes by their places in `names`; looked up once for each pair of groups of shapes.

    Shapes are in one group if no setting of the scene tells them apart. `kind` is "restitution", "friction", or
    "excluded": 1 for pairs that the user leaves out, else 0.
    """

    items: SceneItems
    names: tuple[str, ...]
    kind: str = "restitution"

    @cached_property
    def _groups(self) -> tuple[Array, list[str]]:
        """The group of each shape, and one name of each group."""
        pairs: Iterable[frozenset[str]] = {
            "restitution": self.items.pair_restitution,
            "friction": self.items.pair_friction,
            "excluded": self.items.excluded,
        }[self.kind]
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
        values = {"restitution": self.items.restitution_of, "friction": self.items.friction_of}
        value_of = values.get(self.kind, self.items.excludes)
        return np.array([value_of(member[a], member[b]) for a, b in sides], dtype=float)[place]
