"""What the compiled loop takes: systems, constraints, controls and schemes."""

from __future__ import annotations

from functools import cache

import numpy as np

from ...compiled import held
from ...constraints.mechanism.state import can_be_compiled, has_given_rows, walls_can_be_bodies
from ...problem import Problem
from ...schemes import Centered, MoreauJean, Paoli, Scheme, StewartTrinkle
from ...system import HingedSystem
from ...system.control_table import TRACKING, ControlTable, no_control, side_by_side, tracking
from ...system.controls import LoopControl
from ...system.mechanisms.articulated import ArticulatedSystem
from ...system.mechanisms.joined import can_be_joined
from ...system.parts import parts_of
from ...system.system import Array, Part, System, located_parts
from .step_loop import Loop, loop_with

# most velocities of free bodies, and most with friction: of more, laws take so long that steps of sparse rows are
# cheaper, unless few points can touch: of bodies that all lie on one face at most so many
_MOST_FREE, _MOST_ROUGH = 60, 36
_MOST_WITH_FEW_POINTS, _POINTS, _ROUGH_POINTS = 160, 64, 48
# points of a shape that can touch one face; of a hull with more corners on a face, more would be rare
_POINTS_OF_SHAPE = 4
# schemes whose kernels know walls that move
_TAKE_WALLS = Paoli, MoreauJean, Centered, StewartTrinkle


def is_compiled(problem: Problem, scheme: Scheme) -> bool:
    """Return whether the loop takes the steps of a scheme; the projections may still be such that it does not."""
    system = problem.system
    loop = loop_of(scheme)
    if loop is None or problem.energy_cap or not can_be_joined(system):
        return False
    if isinstance(system, HingedSystem):
        return False
    bodies = sum(part.nv for part in parts_of(system) if part.free_bodies)
    rough = problem.constraints.frictional
    few = bodies <= (_MOST_ROUGH if rough else _MOST_FREE) or (
        bodies <= _MOST_WITH_FEW_POINTS and _points(problem) <= (_ROUGH_POINTS if rough else _POINTS)
    )
    if problem.constraints.moving:
        return few and _walls_can_be_bodies(problem, scheme)
    return few and can_be_compiled(problem.constraints)


def _walls_can_be_bodies(problem: Problem, scheme: Scheme) -> bool:
    """Return whether all walls that move can be bodies of the mechanism, and a scheme takes them as such."""
    system = problem.system
    plain = system.whole is None and not has_user_forces(system) and system.observe is None
    return plain and isinstance(scheme, _TAKE_WALLS) and walls_can_be_bodies(problem.constraints)


def _points(problem: Problem) -> float:
    """Return how many points of free bodies can touch faces at once; infinite where shapes are not known."""
    if problem.scene is None:
        return np.inf
    parts = [part for part in located_parts(problem.system) if part.system.free_bodies]
    free = {body for part in parts for body in range(part.body + 1, part.body + len(part.system.bodies))}
    shapes = [placed.shape for placed in problem.scene.shapes if placed.body in free]
    return sum(min(len(shape.support_points()[0]), _POINTS_OF_SHAPE) for shape in shapes)


def is_compiled_on_copies(problem: Problem, scheme: Scheme) -> bool:
    """Return whether the loop takes the steps on copies of a problem.

    Given constraints cannot be copied, and a control that sees contacts belongs to one run.
    """
    own = problem.system.observe is None and not has_given_rows(problem.constraints)
    return own and is_compiled(problem, scheme)


def has_user_forces(system: System) -> bool:
    """Return whether a function of the user acts on a system, which the loop calls."""
    return system.loaded or _tables(system) is None


def _tables(system: System) -> list[tuple[ControlTable, Part]] | None:
    """Return the controls and springs of mechanisms, and on what they act; None if kernels do not evaluate them."""
    found = []
    for part in located_parts(system):
        robot = part.system if isinstance(part.system, ArticulatedSystem) else None
        control = None if robot is None else robot.control
        if part.system.controlled and not isinstance(control, LoopControl):
            return None
        if robot is not None and (robot.controlled or robot.springs):
            table = control.table if isinstance(control, LoopControl) else tracking(np.zeros((1, robot.nv)))
            found.append((table._replace(springs=robot.spring_rows), part))
    return found if len(found) <= 1 or all(table.kind == TRACKING for table, _ in found) else None


def control_of(system: System) -> tuple[ControlTable, Array]:
    """Return the control of a system without functions of the user, and where its coordinates begin and end in q, v."""
    tables, nq, nv = _tables(system) or [], system.nq, system.nv
    if not tables:
        return _no_control(nv), np.array([0, nq, 0, nv])
    if len(tables) == 1:
        table, part = tables[0]
        return table, np.array([part.q, part.q + part.system.nq, part.v, part.v + part.system.nv])
    ends = [(table, part.q + part.system.nq, part.v + part.system.nv) for table, part in tables]
    return side_by_side(ends, nq, nv), np.array([0, nq, 0, nv])


@cache
def _no_control(nv: int) -> ControlTable:
    """Return the table of no control, held once for all systems: kernels write nothing to it."""
    return held(no_control(nv))


def loop_of(scheme: Scheme) -> Loop | None:
    """Return the loop of a scheme; None if it has none."""
    for kind in type(scheme).__mro__:
        if "step_kernel" in vars(kind):
            return None if scheme.step_kernel is None else loop_with(scheme.step_kernel)
        if "step" in vars(kind):
            # the step of a subclass is not that of the kernel
            return None
    return None
