"""Finds robots that pass through everything, or through every wall, because no shape of theirs can meet it."""

from __future__ import annotations

from ..items import RobotItem, SceneItems
from ..reductions import Omission


def passing_robots(items: SceneItems) -> list[Omission]:
    """Return the robots of a scene that meet nothing, or nothing of the world, although there is something to meet."""
    found = []
    fixed = [b.name for b in items.bodies if b.fixed]
    world = [*items.walls, *(s.name for s in items.surfaces), *fixed]
    others = world or items.bodies or items.spheres or any(item.robot.shapes for item in items.robots)
    for item in items.robots:
        why = _why(item, world) if others else ""
        if why:
            found.append(Omission(f"contacts of {item.robot.name}", why))
    return found


def _why(item: RobotItem, world: list[str]) -> str:
    """Return why a robot meets nothing, or nothing of the world; empty if it does."""
    apart = item.robot.apart
    moving = [s.name for s in item.robot.shapes if s.body]
    if not moving:
        return "no link that moves has a collision shape: it passes through everything"
    if world and all((a, b) in apart or (b, a) in apart for a in world for b in moving):
        return f"its file leaves out all pairs with {', '.join(world)}: it passes through"
    return ""
