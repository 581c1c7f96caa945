"""The scene that a Problem was built from, for the report, the replay and the file."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..constraints import ConstraintFamily
from ..geometry.motion import Motion
from ..geometry.same_motions import each_once
from ..geometry.shapes.picture import Placed, picture
from ..geometry.shapes.shapes import Array, HalfSpace, PlacedShape
from ..system import System, parts_of
from ..system.given import called
from .connected.items import ConnectionItem
from .forces.actuation import places_of
from .named_state import named_state
from .plane import axes_of, check_same_plane
from .reductions import Omission, savings
from .state import Places

if TYPE_CHECKING:
    from ..problem import Problem
    from .items import SceneItems, SurfaceItem


class Start(NamedTuple):
    """A start that was moved out of penetration, or to close loops.

    Attributes
    ----------
    q : ndarray, shape (nq,)
        The configuration.
    moved : str
        By how much what was moved, in words.
    why : str
        What for, in words.
    """

    q: Array
    moved: str
    why: str = "out of penetration"

    @property
    def note(self) -> str:
        """One line on it."""
        return f"the start was moved {self.why}: {self.moved}"


@dataclass(frozen=True)
class SceneModel:
    """The scene behind a Problem.

    Attributes
    ----------
    items : SceneItems
        The robots, bodies, spheres, walls and forces that the user added.
    shapes : tuple of PlacedShape
        Every shape on the body that carries it; 0 is the world.
    omitted : tuple of Omission
        The parts that were left out of the model, why, and how much that saves.
    reduce : tuple of str
        The kinds of reductions that are on.
    system : System
        The system that the scene was built to.
    constraints : tuple of ConstraintFamily
        The constraints that the scene was built to.
    start : Start or None
        The initial configuration, where it was moved out of penetration.
    underway : bool
        Whether the start is a state of a run, which may penetrate.
    """

    items: SceneItems
    shapes: tuple[PlacedShape, ...]
    omitted: tuple[Omission, ...]
    reduce: tuple[str, ...]
    system: System
    constraints: tuple[ConstraintFamily, ...]
    start: Start | None = None
    underway: bool = False

    @property
    def walls(self) -> dict[str, HalfSpace]:
        """Half-spaces by name."""
        return self.items.walls

    @property
    def surfaces(self) -> list[SurfaceItem]:
        """Meshes of the world."""
        return self.items.surfaces

    @property
    def motions(self) -> list[Motion]:
        """Prescribed motions of walls, meshes and fixed bodies, each once."""
        given = [w.motion for w in self.walls.values()]
        given += [s.motion for s in self.surfaces] + [s.motion for s in self.shapes]
        return each_once(given)

    def notes(self, problem: Problem) -> list[str]:
        """Return what a run shall note about how the scene was built."""
        notes = []
        if self.start is not None and np.array_equal(self.start.q, problem.q0):
            notes.append(self.start.note)
        return notes

    def state(self, problem: Problem, q: Any, v: Any) -> tuple[Array, Array]:
        """Return q and v of a problem with values given by name, shapes (nq,) and (nv,); see `Problem.state`."""
        return named_state(problem, self.places(), q, v)

    def places(self) -> Places:
        """Return the places in q and v of everything that moves."""
        planar = self.items.plane is not None and "plane" in self.reduce
        axes = axes_of(self.items.plane) if planar and self.items.plane else None
        return places_of(self.items, axes, self.system)

    def check_in_plane(self, problem: Problem, q: Array) -> None:
        """Raise `InputError` if a body of a planar scene lies outside the plane at a configuration."""
        if self.items.plane is not None and "plane" in self.reduce:
            check_same_plane(problem.system, problem.q0, q, self.items.plane)

    def picture(self, q: Array, t: float) -> str:
        """Return a picture, the text of an svg element, of a configuration, shape (nq,), and a time [s]."""
        bodies = sorted({placed.body for placed in self.shapes} - {0})
        poses = dict(zip(bodies, self.system.placements(q, np.array(bodies)), strict=True)) if bodies else {}
        seen = list[Placed]()
        for placed in self.shapes:
            turn, place = np.eye(3), np.zeros(3)
            if placed.body:
                turn, place = poses[placed.body][:3].T, poses[placed.body][3]
            elif placed.motion is not None:
                turn, place = placed.motion.pose(t)
            position = turn @ placed.position + place
            seen.append(Placed(placed.shape, turn @ placed.rotation, position, placed.color, bool(placed.body)))
        still = [item.placed() for item in self.surfaces if item.motion is None]
        return picture(seen, [wall for wall in self.walls.values() if wall.motion is None], still)

    def _equalities(self) -> list[str]:
        """Return in words what is connected and coupled."""
        kinds = {"point": "share a point", "hinge": "share a point and an axis", "weld": "are welded"}
        found = [
            f"{c.name}: {c.first} and {c.second} {kinds[c.kind]}{_acting(c)}{'' if c.active else ', switched off'}"
            for c in self.items.connections
        ]
        return found + [str(c) for c in self.items.couplings]

    def report(self, problem: Problem) -> str:
        """Return in words what is modelled, what was left out, and why."""
        lines = ["Modelled"]
        lines += [f"  {part.describe()}" for part in parts_of(problem.system)]
        planar = f", in the plane {self.items.plane}" if self.items.plane and "plane" in self.reduce else ""
        lines.append(f"  {problem.system.nv} degrees of freedom in all{planar}")
        lines += [f"  {described}" for described in self._equalities()]
        lines += [f"  {family.describe()}" for family in problem.constraints.families]
        lines += [f"  a control of the scene, {called(control)}" for control in self.items.controls]
        lines += [f"  a force on {force.body}, {called(force.function)}" for force in self.items.forces]
        e = {self.items.restitution, *self.items.pair_restitution.values()}
        lines.append(f"  restitution {', '.join(f'{x:g}' for x in sorted(e))}")
        if self.items.frictional:
            mu = {self.items.friction, *self.items.pair_friction.values()}
            lines.append(f"  Coulomb friction, mu {', '.join(f'{x:g}' for x in sorted(mu))}")
            if self.items.resists_turning:
                lengths = np.unique([self.items.resistance, *self.items.pair_resistance.values()], axis=0)
                each = "; ".join(f"{torsion:g} and {rolling:g}" for torsion, rolling in lengths)
                lines.append(f"  torsional and rolling friction, lengths {each} m")
            turning = sum(len(s.radii) for s in self.items.spheres)
            if turning:
                added = (1 if self.items.plane and "plane" in self.reduce else 3) * turning
                lines.append(f"  {added} degrees of freedom of them by rotation of spheres, which friction turns")
        lines.append(f"  a constraint is active at a gap below {problem.tolerance:.1e} m")
        lines += [f"  {self.start.note}"] if self.start is not None else []
        lines.append("Left out")
        lines += [f"  {one}" for one in self.omitted] or ["  nothing"]
        counted = Counter(one.why.partition(",")[0] for one in self.omitted if one.what.startswith("pair "))
        lines += [f"  ({n} pairs: {why})" for why, n in counted.items()]
        saved = savings(self.omitted)
        lines += [f"  saved in all: {saved}"] if saved else []
        return "\n".join(lines)


def _acting(item: ConnectionItem) -> str:
    """Return in words what acts about a hinge."""
    found = ", a control" if item.control is not None else ""
    spring, damper = ("stiffness", item.stiffness, "N m/rad"), ("damping", item.damping, "N m s/rad")
    given = spring, damper, ("dry friction", item.friction, "N m")
    return "".join(f", {what} {value:g} {unit}" for what, value, unit in given if value) + found
