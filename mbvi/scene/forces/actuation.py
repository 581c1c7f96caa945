"""Turns the controls and forces of a scene into loads of its system."""

from __future__ import annotations

from itertools import groupby
from typing import cast

import numpy as np

from ...geometry.shapes.shapes import Array
from ...system import ActuatedSystem, ArticulatedSystem, System, located_parts
from ...system.actuated import Load
from ...system.system import Part
from ..blocks import Blocks
from ..items import SceneItems
from ..plane import axes_of
from ..state import Place, Places
from .loads import BodyForce, LinkForce, SceneControls, SphereForce


def actuated(blocks: Blocks, system: System, length: float) -> System:
    """Return a system under the scene's controls and forces; the same system where there are none.

    Parameters
    ----------
    blocks : Blocks
        The blocks that the system was made of.
    system : System
        Robots, bodies and spheres.
    length : float
        Of the scene [m].
    """
    items = blocks.items
    if not items.controls and not items.forces:
        return system
    places = places_of(items, blocks.axes, system)
    normal = axes_of(items.plane)[2] if items.plane else None
    robots = {item.robot.name: part.system for item, part in zip(items.robots, located_parts(system), strict=False)}
    spheres = {name for s in items.spheres for name in (s.name, *s.names())}
    loads: list[Load] = []
    for force in items.forces:
        given = force.body, force.function
        owner, _, link = force.body.partition("/")
        if link:
            loads.append(
                LinkForce(
                    cast("ArticulatedSystem", robots[owner]),
                    *blocks.centres[force.body],
                    *given,
                    places.of(owner),
                    normal,
                    length,
                )
            )
            continue
        kind = SphereForce if force.body in spheres and not items.frictional else BodyForce
        loads.append(kind(*given, places.of(force.body), normal, length))
    if items.controls:
        where = {name: places.of(name).v for name in robots}
        loads.append(SceneControls(tuple(items.controls), places, where))
    return ActuatedSystem(system, loads, bool(items.controls))


def places_of(items: SceneItems, axes: Array | None, system: System) -> Places:
    """Return the places in q and v of everything that moves; `axes` are those of a plane that all moves in."""
    parts = located_parts(system)
    places = Places()
    for item in items.robots:
        part, *parts = parts
        q, v = slice(part.q, part.q + part.system.nq), slice(part.v, part.v + part.system.nv)
        places.known[item.robot.name] = Place(q, v, (part.system.nq,), (part.system.nv,))
    bodies = [b for b in items.bodies if not b.fixed]
    groups = [(name, list(group)) for name, group in groupby(bodies, lambda b: b.name.partition("[")[0])]
    given = [(name, [b.name for b in group], _lift(axes, [b.rotation for b in group])) for name, group in groups]
    turning = items.spheres if items.frictional else []
    # spheres that friction turns are rigid bodies, and one system with the others
    given += [(s.name, s.names(), _lift(axes, [np.eye(3)] * len(s.radii))) for s in turning]
    if given:
        part, *parts = parts
        _add(places, part, given, 7, 6)
    if items.spheres and not turning:
        lifts = None if axes is None else axes[None, :2].transpose(0, 2, 1)
        each = [(s.name, s.names(), None if lifts is None else lifts.repeat(len(s.radii), 0)) for s in items.spheres]
        _add(places, parts[0], each, 3, 3)
    return places


def _lift(axes: Array | None, rotations: list[Array]) -> Array | None:
    """Return the matrices from velocities of bodies in a plane to velocities in space, shape (n, 6, 3)."""
    if axes is None:
        return None
    lift = np.zeros((len(rotations), 6, 3))
    lift[:, :3, :2] = axes[:2].T
    lift[:, 3:, 2] = [rotation.T @ axes[2] for rotation in rotations]
    return lift


def _add(places: Places, part: Part, groups: list[tuple[str, list[str], Array | None]], nq: int, nv: int) -> None:
    """Add groups of bodies or spheres, each with nq coordinates and nv velocities in space."""
    width, k = part.system.nv // (len(part.system.bodies) - 1), 0
    for name, members, lift in groups:
        n = len(members)
        for i, member in enumerate(members):
            q, v = part.q + (k + i) * nq, part.v + (k + i) * width
            own = None if lift is None else lift[i : i + 1]
            places.members[member] = Place(slice(q, q + nq), slice(v, v + width), (nq,), (nv,), own)
        if members == [name]:
            places.known[name] = places.members.pop(name)
        else:
            q, v = part.q + k * nq, part.v + k * width
            places.known[name] = Place(slice(q, q + n * nq), slice(v, v + n * width), (n, nq), (n, nv), lift)
        k += n
