"""Chooses the scheme and the time step of a problem where the user names none, with the reason."""

from __future__ import annotations

import numpy as np

from ..errors import DivergedError
from ..geometry.shapes.shapes import HalfSpace, PlacedShape
from ..problem import Problem
from ..schemes import Centered, EventDriven, Scheme, StewartTrinkle
from ..system import HingedSystem, System, located_parts, parts_of
from ..system.parts import velocity_units
from ..system.system import Array, Part

# up to this number of constraints `EventDriven` costs at most twice the time of steps of 1e-3 s; measured by
# benchmarks/default_scheme.py
_FEW = 100
# from this number of free bodies on they count as grains, among which robots move
_GRAINS = 15
# the step relative to each time scale: the time in which a body travels its own size, the time in which it falls by its
# size, one over the rate of the fastest mode, the duration
_TRAVEL, _FALL, _MODE, _RUN = 0.1, 0.02, 0.2, 0.01
# a mode that decays need not be resolved below this part of the step that the speed and the fall of bodies ask for; it
# then only has to be stable: for rates d of damping and w of stiffness, `Centered` is as long as h d + (h w)^2 / 2 < 2.
# Where this decides, rates in other poses are up to 4 times those at the start; measured by benchmarks/robot_schemes.py
_DECAYED, _STABLE = 0.1, 0.4
# least part of the rate of a mode that decays which is its decay, the rest being oscillation
_OVERDAMPED = 0.9
# rate of a mode that counts as none, in rates of the fastest
_STILL = 1e-9
# size of the bodies of a system without shapes, in lengths of the scene
_SIZE = 0.1
# largest size that a body counts as having, in radii of the ball that fits into its thickest shape: steps must be short
# enough that nothing passes through flat bodies
_FLAT = 5.0
# least size that a link counts as having, in median sizes of the links of its mechanism
_SMALL_LINK = 1.0 / 3.0
# length of the differences that give modes, in lengths of the scene and radians, and the most velocities of a system
# whose modes are computed
_DIFFERENCE, _MOST_MODES = 1e-6, 200
# relative deviation between differences of two lengths above which a force counts as having no slope
_SAME_SLOPE = 0.5
# steps are such a number times a power of ten
_ROUND_NUMBERS = (5.0, 2.0, 1.0)


def default_scheme(
    problem: Problem, duration: float, switching: bool = False
) -> tuple[Scheme | EventDriven, float | None, str]:
    """Return the scheme for a problem, its time step, and why.

    Parameters
    ----------
    problem : Problem
        The problem to run.
    duration : float
        Duration of the run [s].
    switching : bool
        Whether connections are switched in it.

    Returns
    -------
    scheme : Scheme or EventDriven
        `EventDriven` for few constraints with continuous gradients, no control and no external force, else that of
        `time_stepping`.
    step : float or None
        h [s]; None for `EventDriven`.
    reason : str
        The choice and its reason in words, as in the notes of a run.
    """
    against = "connections are switched" if switching else _reason_against_event_driven(problem)
    if against is None:
        count = _count(problem)
        why = f"{count} smooth constraint{'s' * (count != 1)}" if count else "no constraints"
        scheme = EventDriven()
        return scheme, None, f"EventDriven(tolerance={scheme.tolerance:g}) was chosen: {why}"
    h, scale = time_step(problem, duration)
    stepping, words = time_stepping(problem)
    return stepping, h, f"{words} at h = {h:g} s was chosen: {against}; the step by {scale}"


def time_stepping(problem: Problem) -> tuple[Scheme, str]:
    """Return the default scheme of fixed steps, and its name with its options.

    `StewartTrinkle` for many free bodies, also with robots among them, because they then land without penetration. If
    nothing takes energy from them they never lie on each other: `Centered`, which keeps their energy, without position
    projection, for no contact stays closed. Else `Centered` with position projection.
    """
    parts = parts_of(problem.system)
    grains = sum(part.independent_bodies for part in parts if part.free_bodies)
    free = all(part.free_bodies for part in parts)
    many = (free or grains >= _GRAINS) and _count(problem) > _FEW
    if problem.scene is None or not many or problem.energy_cap:
        return Centered(project_positions=True), "Centered(project_positions=True)"
    if problem.scene.items.elastic:
        return Centered(), "Centered(), for elastic impacts,"
    return StewartTrinkle(), "StewartTrinkle()"


def _reason_against_event_driven(problem: Problem) -> str | None:
    """Return in words why `EventDriven` is not chosen; None if it is."""
    for family in problem.constraints.families:
        if family.tracked and not family.moving and not np.all(family.smooth):
            jumping = family.name(int(np.flatnonzero(np.logical_not(family.smooth))[0]))
            return f"the contact normal of {jumping} can jump"
    if problem.constraints.moving:
        return "walls move on their own"
    if problem.constraints.frictional:
        return "contacts have friction"
    count = _count(problem)
    if count > _FEW:
        return f"{count} constraints are many"
    if problem.system.loaded:
        return "a control of the scene or a force may switch"
    controlled = [part for part in parts_of(problem.system) if part.controlled]
    if controlled:
        return f"the control of {controlled[0].name} may switch"
    return None


def _count(problem: Problem) -> int:
    """Return the number of constraints; each pair of spheres counts once."""
    return sum(family.count for family in problem.constraints.families)


def time_step(problem: Problem, duration: float) -> tuple[float, str]:
    """Return a step from the time scales of the scene [s], and the shortest of them in words.

    The step is rounded down to 1, 2 or 5 times a power of ten.
    """
    motion = _travel_steps(problem, duration)
    shortest = min((h for h, _ in motion), default=np.inf)
    scales = [(_RUN * duration, "the duration"), *motion, *_mode_steps(problem, _DECAYED * shortest)]
    h, scale = min(scales)
    decade = 10.0 ** np.floor(np.log10(h))
    # rounding errors must not reduce a step that is such a number already
    leading = next(n for n in _ROUND_NUMBERS if n * decade <= h * (1.0 + 1e-9))
    return float(f"{leading * decade:.1g}"), scale


def _mode_steps(problem: Problem, least: float) -> list[tuple[float, str]]:
    """Return the step for the fastest mode of each mechanism, linearised about the initial state.

    Modes that decay need no shorter step than `least` [s], as long as they are stable.
    """
    found, parts = [], located_parts(problem.system)
    coupled = problem.system.loaded or isinstance(problem.system, HingedSystem)
    if coupled and problem.system.nv <= _MOST_MODES:
        # a force of the scene or a hinge may couple the parts, so that they have common modes
        parts = [Part(problem.system, 0, 0, 0)]
    for system, q, v, _ in parts:
        q0, v0 = problem.q0[q : q + system.nq], problem.v0[v : v + system.nv]
        # the forces on free bodies do not change
        if system.free_bodies or system.nv > _MOST_MODES:
            continue
        h, rate = _mode_step(force_slope(system, problem.t0, q0, v0, problem.length), least)
        if rate > 0.0:
            name = system.name or "the forces"
            found.append((h, f"the fastest mode of {name}, {rate:.3g} 1/s"))
    return found


def _mode_step(slope: Array, least: float) -> tuple[float, float]:
    """Return the shortest of the steps for all modes [s] and the rate of that mode [1/s], which is 0 without modes.

    Parameters
    ----------
    slope : ndarray, shape (n, 2 n)
        d(M^-1 g) / d(q, v).
    least : float
        Modes that decay need no shorter step, as long as they are stable [s].
    """
    n = len(slope)
    modes = np.linalg.eigvals(np.block([[np.zeros((n, n)), np.eye(n)], [slope]]))
    # motions without a force have modes of rate 0
    modes = modes[np.abs(modes) > _STILL * np.abs(modes).max()]
    if not modes.size:
        return np.inf, 0.0
    rates = np.abs(modes)
    stiffness, damping = (float(np.abs(np.linalg.eigvals(block)).max()) for block in (slope[:, :n], slope[:, n:]))
    # the root of h d + h^2 w^2 / 2
    stable = 2.0 * _STABLE / (damping + np.sqrt(damping**2 + 2.0 * _STABLE * stiffness))
    steps = _MODE / rates
    decays = modes.real <= -_OVERDAMPED * rates
    steps[decays] = np.maximum(steps[decays], min(stable, least))
    shortest = int(np.argmin(steps))
    return min(float(steps[shortest]), stable), float(rates[shortest])


def force_slope(system: System, t: float, q: Array, v: Array, length: float) -> Array:
    """Return d(M^-1 g) / d(q, v), shape (nv, 2 nv), zero where a force has no slope."""
    fine, coarse = (_jacobian(system, t, q, v, s, length) for s in (_DIFFERENCE, 10.0 * _DIFFERENCE))
    # a force that jumps, such as dry friction or a switch, has no slope: shorter differences give larger values
    return np.where(np.abs(fine - coarse) <= _SAME_SLOPE * np.abs(fine), fine, 0.0)


def _jacobian(system: System, t: float, q: Array, v: Array, s: float, length: float) -> Array:
    """Return d(M^-1 g) / d(q, v), shape (nv, 2 nv), by differences of s lengths of the scene and s radians."""
    units, columns = velocity_units(system, length), []
    for size, unit in zip(s * units, s * np.diag(units), strict=True):
        ends = (_acceleration(system, t, system.integrate(q, shift), v) for shift in (unit, -unit))
        columns.append(np.subtract(*ends) / (2.0 * size))
    for size, unit in zip(s * units, s * np.diag(units), strict=True):
        ends = (_acceleration(system, t, q, v + shift) for shift in (unit, -unit))
        columns.append(np.subtract(*ends) / (2.0 * size))
    return np.array(columns).T


def _acceleration(system: System, t: float, q: Array, v: Array) -> Array:
    """Return M^-1 g without joint damping, which steps treat implicitly."""
    try:
        free = system.acceleration(t, q, v)
    except DivergedError:
        # a force that is not finite near the start has no slope
        return np.full(system.nv, np.nan)
    damping = system.damping_force(q, v)
    if damping.any():
        free = free + system.metric(q).solve_rows(damping[None])[0]
    return free


def _travel_steps(problem: Problem, duration: float) -> list[tuple[float, str]]:
    """Return for each body the steps in which it travels and falls by a part of its size; see `_sizes`."""
    system = problem.system
    if problem.scene is None:
        # without shapes the whole system counts as one body
        pull = float(np.abs(system.acceleration(problem.t0, problem.q0, problem.v0)).max(initial=0.0))
        speed = float(np.abs(problem.v0).max(initial=0.0))
        return _body_steps("the system", _SIZE * problem.length, speed, pull)
    g = float(np.linalg.norm(problem.scene.items.gravity))
    bodies: dict[int, list[PlacedShape]] = {}
    for shape in problem.scene.shapes:
        if shape.body:
            bodies.setdefault(shape.body, []).append(shape)
    # a body has the size of its largest shape
    largest = [max(shapes, key=lambda s: s.shape.bound) for shapes in bodies.values()]
    rates, found = np.abs(problem.v0), []
    forced = np.abs(system.added_acceleration(problem.t0, problem.q0, problem.v0))
    sizes = _sizes(system, bodies)
    for size, shape, drop in zip(sizes, largest, _fall_heights(problem, largest, g), strict=True):
        reach = system.reach(shape.body, shape.position, shape.shape.bound)
        speed, pull = float(reach @ rates), g + float(reach @ forced)
        found += _body_steps(shape.name, size, speed + min(np.sqrt(2.0 * g * drop), g * duration), pull)
    return found


def _sizes(system: System, bodies: dict[int, list[PlacedShape]]) -> Array:
    """Return the size of each body by its shapes; that of a link is at least a third of the median of its mechanism.

    A step that a finger alone asks for would not make the motion of its robot more accurate.
    """
    numbers = np.array(list(bodies), dtype=np.int64)
    sizes = np.array(
        [min(max(s.shape.bound for s in one), _FLAT * max(s.shape.inner for s in one)) for one in bodies.values()]
    )
    for part in located_parts(system):
        own = (numbers > part.body) & (numbers < part.body + len(part.system.bodies))
        if own.any() and not part.system.free_bodies:
            sizes[own] = np.maximum(sizes[own], _SMALL_LINK * np.median(sizes[own]))
    return sizes


def _body_steps(name: str, size: float, speed: float, pull: float) -> list[tuple[float, str]]:
    """Return the steps for one body of a size [m]: by its speed [m/s], and by its acceleration `pull` [m/s^2]."""
    found = []
    if speed > 0.0:
        found.append((_TRAVEL * size / speed, f"the speed of {name}, {speed:.3g} m/s at a size of {size:.3g} m"))
    if pull > 0.0:
        found.append((_FALL * float(np.sqrt(2.0 * size / pull)), f"the fall of {name} by its size, {size:.3g} m"))
    return found


def _fall_heights(problem: Problem, moving: list[PlacedShape], g: float) -> Array:
    """Return how far each shape can fall: to a wall, or to the height of the lowest shape [m]."""
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
        drops = np.minimum(drops, _height_above(wall, centres, up))
    return np.where(np.isfinite(drops), np.maximum(drops, 0.0), heights - lowest)


def _height_above(wall: HalfSpace, centres: Array, up: Array) -> Array:
    """Return the height of points above a wall, infinite where the wall is vertical."""
    normal = np.asarray(wall.normal)
    slope = float(normal @ up)
    return (centres @ normal - wall.offset) / slope if slope > 1e-3 else np.full(len(centres), np.inf)
