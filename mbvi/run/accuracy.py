"""The accuracy of a run's projections: a residual that is given, or one that follows from an accepted penetration."""

from __future__ import annotations

from typing import SupportsFloat

import numpy as np

from ..arguments import optional, positive
from ..errors import InputError, UnsuitableError
from ..problem import Problem
from ..projection import AcceptedDepth, ChosenSolver, Projector, StatedDepth
from ..schemes import SchemeBase
from ..system import located_parts, parts_of

DEFAULT_RESIDUAL, DEFAULT_DEPTH = 1e-6, 1e-3
# of Coulomb's law for more than 64 contacts
FRICTION_RESIDUAL = 1e-3
# size of the bodies of a system without shapes, in lengths of the scene
_SIZE = 0.1


def projector_of(
    problem: Problem,
    scheme: SchemeBase,
    residual: SupportsFloat | None,
    depth: SupportsFloat | None,
    solver: ChosenSolver | None,
    h: float | None = None,
) -> tuple[Projector, list[str]]:
    """Return the projector of a run with steps of h [s], and a note where its residual follows from a depth.

    Raises
    ------
    InputError
        If both are given, or one is not positive and finite.
    UnsuitableError
        If a depth is given and the scheme penetrates by more than its residual, or if a solver is given and the problem
        has friction.
    """
    residual, depth = optional(positive, residual, "residual"), optional(positive, depth, "depth")
    if residual is not None and depth is not None:
        raise InputError("give depth or residual, not both: each determines the other")
    if solver is not None and problem.constraints.frictional:
        raise UnsuitableError(f"{solver!r} does not solve Coulomb's law: leave out solver where there is friction")
    if depth is not None and not scheme.accepts_depth:
        raise UnsuitableError(
            f"{scheme!r} does not take a depth, because it penetrates however small the residual is: "
            "give a residual, or take StewartTrinkle"
        )
    if residual is None and depth is None and problem.system.sparse and scheme.accepts_depth:
        depth = DEFAULT_DEPTH
    size, levers, stated = smallest_size(problem), problem.constraints.levers, None
    if h is not None:
        jointed = np.concatenate([np.full(part.nv, not part.free_bodies) for part in parts_of(problem.system)])
        stated = StatedDepth((depth or DEFAULT_DEPTH) * size, problem.tolerance, h, levers, jointed)
    if depth is None:
        of_many = FRICTION_RESIDUAL if residual is None else residual
        return Projector(residual or DEFAULT_RESIDUAL, solver, None, of_many, problem.energy_cap, stated), []
    accepted = AcceptedDepth(depth, depth * size, levers)
    note = f"depth = {depth:g} was accepted: {depth * size:.3g} m, relative to the smallest body's {size:.3g} m"
    return Projector(DEFAULT_RESIDUAL, solver, accepted, FRICTION_RESIDUAL, stated=stated), [note]


def residual_note(projector: Projector) -> list[str]:
    """Return notes that state the residuals that followed from the accepted depth, and how often bodies jammed."""
    notes = []
    if projector.loosest > 0.0:
        notes.append(f"the accepted depth gave residuals of {projector.strictest:.1e} to {projector.loosest:.1e}")
    jams = projector.friction.jams
    if jams:
        notes.append(
            f"bodies jammed {jams} time{'s' * (jams != 1)}: Coulomb's law was not solved with the restitution or the "
            "correction of penetration that was asked for, and was solved without them"
        )
    return notes


def smallest_size(problem: Problem) -> float:
    """Return the size of the smallest free body [m]; where there is none, that of the smallest link.

    The size of a body is the radius of the largest ball within one of its shapes: the radius of a sphere or a capsule,
    half of the smallest edge of a box. Without shapes it is a tenth of the scene's length.
    """
    sizes: dict[int, float] = {}
    known: dict[int, float] = {}
    for placed in () if problem.scene is None else problem.scene.shapes:
        if placed.body:
            key = id(placed.shape)
            # many bodies share a shape
            inner = known[key] if key in known else known.setdefault(key, placed.shape.inner)
            sizes[placed.body] = max(inner, sizes.get(placed.body, 0.0))
    free = [
        sizes[body]
        for part in located_parts(problem.system)
        if part.system.free_bodies
        for body in range(part.body + 1, part.body + len(part.system.bodies))
        if body in sizes
    ]
    return min(free or sizes.values(), default=_SIZE * problem.length)
