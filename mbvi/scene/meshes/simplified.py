"""Replaces convex hulls of a scene by simpler shapes within a tolerance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from ...geometry.shapes.fit_primitive import Fit, fit_primitive
from ...geometry.shapes.shapes import Hull, PlacedShape
from ..reductions import Omission


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

    def added_to(self, omitted: Sequence[Omission]) -> list[Omission]:
        """Return omissions with those of simpler shapes; a mesh that was replaced by its hull keeps its one line."""
        meshes = {one.what for one in omitted if one.what.startswith("mesh ")}
        lines: dict[str, Omission] = {}
        more = []
        for hull, found, names in self._known.values():
            if found is None:
                continue
            before, after = len(hull.vertices), len(found.shape.support_points()[0])
            is_hull, saved = isinstance(found.shape, Hull), max(before - after, 0)
            by = f"a hull of {after} vertices" if is_hull else f"a {type(found.shape).__name__.lower()}"
            far = f"{_up(found.distance)} m"
            why = f"replaced by {by}, {far} from its convex hull of {before} vertices at most"
            lines |= {f"mesh {name}": Omission(f"mesh {name}", why, vertices=saved) for name in names}
            rest = [name for name in names if f"mesh {name}" not in meshes]
            if rest:
                what = f"hull {rest[0]}" + (f" and {len(rest) - 1} alike" if len(rest) > 1 else "")
                more.append(Omission(what, f"replaced by {by}, {far} away at most", vertices=saved * len(rest)))
        return [*(lines.get(one.what, one) for one in omitted), *more]


def _up(distance: float) -> str:
    """Return a distance in two digits, rounded up."""
    return f"{distance * 1.05 + 1e-17:.1e}"
