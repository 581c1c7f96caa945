"""The things in a scene as text, and as a table for a notebook."""

from __future__ import annotations

from collections.abc import Collection
from html import escape
from typing import TYPE_CHECKING

from ..arguments import listed
from .items import SceneItems, entity

if TYPE_CHECKING:
    from ..problem import Problem

# most names of one kind, and of robots in a line on a problem
_MOST_NAMED, _THINGS = 8, 4


def overview(items: SceneItems) -> str:
    """Return one line on a scene."""
    things = [f"{kind} {names}" for kind, names in _things(items).items()]
    return f"Scene({', '.join(things) or 'empty'})"


def overview_html(items: SceneItems) -> str:
    """Return a table of the things in a scene and its settings."""
    settings = {
        "gravity [m/s^2]": ", ".join(f"{g:g}" for g in items.gravity),
        "restitution": _coefficients(items.restitution, items.pair_restitution.values()),
        "friction": _coefficients(items.friction, items.pair_friction.values()),
    }
    if items.resists_turning:
        pairs = items.pair_resistance.values()
        for k, kind in enumerate(("torsional friction [m]", "rolling friction [m]")):
            settings[kind] = _coefficients(items.resistance[k], [pair[k] for pair in pairs])
    if items.plane is not None:
        settings["plane"] = items.plane
    rows = (_things(items) | settings).items()
    cells = "".join(f"<tr><th>{escape(head)}</th><td>{escape(text)}</td></tr>" for head, text in rows)
    return f"<table><caption>Scene</caption>{cells}</table>"


def things_of(problem: Problem | None) -> str:
    """Return the names or numbers of the robots, bodies and spheres of a problem."""
    if problem is None or problem.scene is None:
        return "given functions"
    items = problem.scene.items
    names = [item.robot.name for item in items.robots]
    groups = [(sum(not b.fixed for b in items.bodies), "body", "bodies")]
    groups.append((sum(len(s.radii) for s in items.spheres), "sphere", "spheres"))
    if len(names) > _THINGS:
        groups.insert(0, (len(names), "robot", "robots"))
        names = []
    return ", ".join([*names, *(f"{n} {one if n == 1 else many}" for n, one, many in groups if n)])


def _things(items: SceneItems) -> dict[str, str]:
    """Return the names of the things of each kind that there are."""
    groups: dict[str, Collection[str]] = {
        "robots": [item.robot.name for item in items.robots],
        "bodies": dict.fromkeys(entity(b.name) for b in items.bodies if not b.fixed),
        "spheres": [s.name if len(s.radii) == 1 else f"{s.name} ({len(s.radii)})" for s in items.spheres],
        "walls": items.walls,
        "meshes": [s.name for s in items.surfaces],
        "fixed bodies": dict.fromkeys(entity(b.name) for b in items.bodies if b.fixed),
    }
    return {kind: listed(list(names), _MOST_NAMED) for kind, names in groups.items() if names}


def _coefficients(common: float, own: Collection[float]) -> str:
    """Return a coefficient, and those that pairs have of their own."""
    others = sorted(set(own))
    return f"{common:g}" + (f"; of some pairs {', '.join(f'{e:g}' for e in others)}" if others else "")
