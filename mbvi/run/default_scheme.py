"""Which scheme runs a problem when none is named, at which step, and why."""

from __future__ import annotations

import numpy as np

from ..errors import DivergedError
from ..geometry.shapes import HalfSpace, PlacedShape
from ..problem import Problem
from ..schemes import Centered, EventDriven, Scheme, StewartTrinkle
from ..system import ActuatedSystem, ArticulatedSystem, FreeBodies, Spheres, System, located_parts, parts_of
from ..system.actuated import Part
from ..system.lengths import velocity_units
from ..system.system import Array

# up to so many constraints error control costs at most some twice what steps of 1e-3 s do: benchmarks/default_scheme.py
_FEW = 100
# of a time scale, the part that a step may take: of the time a body takes for its own size, of its fall by that, of the
# fastest mode (1 / omega), of the run
_WAY, _FALL, _MODE, _RUN = 0.1, 0.02, 0.2, 0.01
# of a system that knows no sizes, the part of the scene's length that counts as one
_SIZE = 0.1
# a body counts as no larger than so many times the ball that fits into its thickest shape: what is flat must not be
# passed through
_FLAT = 5.0
# difference of q and v, in lengths of the scene and radians, and the most degrees of freedom, for which modes are
# looked for
_DIFFERENCE, _MOST_MODES = 1e-6, 200
# relative difference of two differences of one slope
_SAME_SLOPE = 0.5
_NEAT = (5.0, 2.0, 1.0)


def default_scheme(problem: Problem, duration: float) -> tuple[Scheme | EventDriven, float | None, str]:
    """Return the scheme for a problem, its time step, and why.

    Parameters
    ----------
    problem : Problem
        What moves.
    duration : float
        How long [s].

    Returns
    -------
    scheme : Scheme or EventDriven
        `EventDriven` for few constraints with continuous gradients, no control and no external force, else what
        `time_stepping` says.
    step : float or None
        h [s]; None for `EventDriven`.
    reason : str
        In words.
    """
    against = _against_error_control(problem)
    if against is None:
        count = _count(problem)
        why = f"{count} smooth constraint{'s' * (count != 1)}" if count else "no constraints"
        located = EventDriven()
        return located, None, f"EventDriven(tolerance={located.tolerance:g}) was chosen: {why}"
    h, scale = time_step(problem, duration)
    scheme, words = time_stepping(problem)
    return scheme, h, f"{words} at h = {h:g} s was chosen: {against}; the step by {scale}"


def time_stepping(problem: Problem) -> tuple[Scheme, str]:
    """Return the scheme that fixed steps are taken by when none is named, and how it is called.

    `StewartTrinkle` for many free bodies without restitution, which then land on each other and not in each other. Else
    `Centered` with position projection.
    """
    free = all(isinstance(part, FreeBodies | Spheres) for part in parts_of(problem.system))
    if problem.scene is not None and free and _count(problem) > _FEW:
        items = problem.scene.items
        if items.restitution == 0.0 and not any(items.pair_restitution.values()):
            return StewartTrinkle(), "StewartTrinkle()"
    return Centered(project_positions=True), "Centered(project_positions=True)"


def _against_error_control(problem: Problem) -> str | None:
    """Return what speaks against error control, if anything."""
    for family in problem.constraints.families:
        if family.tracked and not family.moving and not np.all(family.smooth):
            jumping = family.name(int(np.flatnonzero(np.logical_not(family.smooth))[0]))
            return f"the gradient of {jumping} jumps"
    if problem.constraints.moving:
        return "walls move on their own"
    count = _count(problem)
    if count > _FEW:
        return f"{count} constraints are many"
    if isinstance(problem.system, ActuatedSystem):
        return "a control of the scene or a force may switch"
    controlled = [part for part in parts_of(problem.system) if getattr(part, "control", None) is not None]
    if controlled:
        return f"the control of {controlled[0].bodies[1].split('/')[0]} may switch"
    return None


def _count(problem: Problem) -> int:
    """Return how many constraints there are, every pair of spheres counted once."""
    return sum(family.count for family in problem.constraints.families)


def time_step(problem: Problem, duration: float) -> tuple[float, str]:
    """Return a step from the scene's own time scales, a neat number [s], and which scale it is due to."""
    scales = [(_RUN * duration, "the duration")]
    scales += _modes(problem)
    scales += _motions(problem, duration)
    h, scale = min(scales)
    decade = 10.0 ** np.floor(np.log10(h))
    # rounding must not lose a step that is neat already
    neat = next(n for n in _NEAT if n * decade <= h * (1.0 + 1e-9))
    return float(f"{neat * decade:.1g}"), scale


def _modes(problem: Problem) -> list[tuple[float, str]]:
    """Return the step for the fastest mode of each mechanism, linearised about the initial state."""
    found, parts = [], located_parts(problem.system)
    if isinstance(problem.system, ActuatedSystem) and problem.system.nv <= _MOST_MODES:
        # springs between parts
        parts = [Part(problem.system, 0, 0, 0)]
    for system, q, v, _ in parts:
        q0, v0 = problem.q0[q : q + system.nq], problem.v0[v : v + system.nv]
        # bodies on their own have no forces that change
        if isinstance(system, FreeBodies | Spheres) or system.nv > _MOST_MODES:
            continue
        rate = _fastest(system, problem.t0, q0, v0, problem.length)
        if rate > 0.0:
            name = system.bodies[1].split("/")[0] if isinstance(system, ArticulatedSystem) else "the forces"
            found.append((_MODE / rate, f"the fastest mode of {name}, {rate:.3g} 1/s"))
    return found


def _fastest(system: System, t: float, q: Array, v: Array, length: float) -> float:
    """Return the largest modulus of an eigenvalue of d(v, M^-1 g) / d(q, v) [1/s]."""
    n = system.nv
    fine, coarse = (_jacobian(system, t, q, v, s, length) for s in (_DIFFERENCE, 10.0 * _DIFFERENCE))
    # a force that jumps, as dry friction or a switch, has no slope, and differences of it grow as they are refined
    slope = np.where(np.abs(fine - coarse) <= _SAME_SLOPE * np.abs(fine), fine, 0.0)
    block = np.block([[np.zeros((n, n)), np.eye(n)], [slope]])
    return float(np.abs(np.linalg.eigvals(block)).max())


def _jacobian(system: System, t: float, q: Array, v: Array, s: float, length: float) -> Array:
    """Return d(M^-1 g) / d(q, v), shape (nv, 2 nv), by differences of s lengths of the scene and s radians."""
    units, columns = velocity_units(system, length), []
    for size, unit in zip(s * units, s * np.diag(units), strict=True):
        ends = (_acceleration(system, t, system.integrate(q, way), v) for way in (unit, -unit))
        columns.append(np.subtract(*ends) / (2.0 * size))
    for size, unit in zip(s * units, s * np.diag(units), strict=True):
        ends = (_acceleration(system, t, q, v + way) for way in (unit, -unit))
        columns.append(np.subtract(*ends) / (2.0 * size))
    return np.array(columns).T


def _acceleration(system: System, t: float, q: Array, v: Array) -> Array:
    """Return M^-1 g without the joints' damping, which steps take implicitly."""
    try:
        free = system.acceleration(t, q, v)
    except DivergedError:
        # beside the start: no slope can be told from that
        return np.full(system.nv, np.nan)
    damping = np.concatenate([getattr(part, "damping", np.zeros(part.nv)) for part in parts_of(system)])
    if damping.any():
        free = free + system.metric(q).solve_rows((damping * v)[None])[0]
    return free


def _motions(problem: Problem, duration: float) -> list[tuple[float, str]]:
    """Return the steps in which no body moves by much of its own size."""
    system = problem.system
    if problem.scene is None:
        pull = float(np.abs(system.acceleration(problem.t0, problem.q0, problem.v0)).max(initial=0.0))
        speed = float(np.abs(problem.v0).max(initial=0.0))
        return _of_one("the system", _SIZE * problem.length, speed, pull)
    g = float(np.linalg.norm(problem.scene.items.gravity))
    bodies: dict[int, list[PlacedShape]] = {}
    for shape in problem.scene.shapes:
        if shape.body:
            bodies.setdefault(shape.body, []).append(shape)
    # the largest shape of each body stands for it
    largest = [max(shapes, key=lambda s: s.shape.bound) for shapes in bodies.values()]
    rates, found, forced = np.abs(problem.v0), [], np.zeros(system.nv)
    if isinstance(system, ActuatedSystem):
        forced = np.abs(system.added_acceleration(problem.t0, problem.q0, problem.v0))
    for shapes, shape, drop in zip(bodies.values(), largest, _drops(problem, largest, g), strict=True):
        reach = system.reach(shape.body, shape.position, shape.shape.bound)
        speed, pull = float(reach @ rates), g + float(reach @ forced)
        size = min(shape.shape.bound, _FLAT * max(s.shape.inner for s in shapes))
        found += _of_one(shape.name, size, speed + min(np.sqrt(2.0 * g * drop), g * duration), pull)
    return found


def _of_one(name: str, size: float, speed: float, pull: float) -> list[tuple[float, str]]:
    """Return the steps for one size [m], by its speed and by its fall."""
    found = []
    if speed > 0.0:
        found.append((_WAY * size / speed, f"the speed of {name}, {speed:.3g} m/s at a size of {size:.3g} m"))
    if pull > 0.0:
        found.append((_FALL * float(np.sqrt(2.0 * size / pull)), f"the fall of {name} by its size, {size:.3g} m"))
    return found


def _drops(problem: Problem, moving: list[PlacedShape], g: float) -> Array:
    """Return how far each shape can fall, onto a wall or to where the lowest shape is [m]."""
    scene = problem.scene
    assert scene is not None
    if g == 0.0 or not moving:
        return np.zeros(len(moving))
    up = -scene.items.gravity / g
    places = problem.system.placements(problem.q0, np.array([s.body for s in moving]))
    centres = np.einsum("ni,nij->nj", np.array([[*s.position, 1.0] for s in moving]), places)
    heights = centres @ up
    lowest = min([heights.min(), *(float(s.position @ up) for s in scene.shapes if not s.body)])
    drops = np.full(len(moving), np.inf)
    for wall in scene.walls.values():
        drops = np.minimum(drops, _above(wall, centres, up))
    return np.where(np.isfinite(drops), np.maximum(drops, 0.0), heights - lowest)


def _above(wall: HalfSpace, centres: Array, up: Array) -> Array:
    """Return how far below points a wall lies, infinite where it lies beside them."""
    normal = np.asarray(wall.normal)
    slope = float(normal @ up)
    return (centres @ normal - wall.offset) / slope if slope > 1e-3 else np.full(len(centres), np.inf)
