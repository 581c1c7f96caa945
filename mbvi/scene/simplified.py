"""Replaces convex hulls of a scene by simpler shapes within a tolerance."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from ..geometry.fit_primitive import Fit, fit_primitive
from ..geometry.shapes import Hull, PlacedShape
from .reductions import Omission


@dataclass
class Simplified:
    """The simpler shape of each hull, computed once, and the names of the shapes that were replaced."""

    _known: dict[tuple[bytes, float | None], tuple[Hull, Fit | None, list[str]]] = field(default_factory=dict)

    def of(self, placed: PlacedShape, tolerance: float | None) -> PlacedShape:
        """Return a shape, or a simpler one that equals it within a tolerance [m]; see `fit_primitive`."""
        hull = placed.shape
        if not isinstance(hull, Hull):
            return placed
        # links on the left and on the right often have the same mesh
        key = hull.vertices.tobytes(), tolerance
        if key not in self._known:
            self._known[key] = hull, fit_primitive(hull, tolerance), []
        _, found, names = self._known[key]
        if found is None:
            return placed
        names.append(placed.name)
        rotation, position = placed.rotation @ found.rotation, placed.rotation @ found.position + placed.position
        return replace(placed, shape=found.shape, rotation=rotation, position=position)

    def omitted(self) -> list[Omission]:
        """Return the omissions due to simpler shapes."""
        omissions = []
        for hull, found, names in self._known.values():
            if found is None:
                continue
            what = f"hull {names[0]}" + (f" and {len(names) - 1} alike" if len(names) > 1 else "")
            before, after = len(hull.vertices), len(found.shape.support_points()[0])
            kind = type(found.shape).__name__.lower()
            by = f"a hull of {after} of its {before} vertices" if isinstance(found.shape, Hull) else f"a {kind}"
            saved = max(before - after, 0) * len(names)
            omissions.append(Omission(what, f"replaced by {by}, {_up(found.distance)} m away at most", vertices=saved))
        return omissions


def _up(distance: float) -> str:
    """Return a distance in two digits, rounded up."""
    return f"{distance * 1.05 + 1e-17:.1e}"
