"""A ball on a rough floor, with exact solutions: it slides until it rolls, and bounces with spin."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from ..arguments import finite, integer, not_negative, positive, vector
from ..geometry.rotations import compose
from ..problem import Problem
from ..scene import Scene
from .rough_plane import G, Stretch, stretches
from .solution import Array, Motion, Pieces, Reference, State, Times, checked, column, stacked, times

_RADIUS, _MASS = 0.1, 1.5
# of a homogeneous ball: change of the slip at the contact per change of the centre's velocity, by a tangential force
_SLIP = 3.5


def rolling_ball(
    mu: float = 0.2, slope: float = 0.0, speed: float = 2.0, spin: float = 0.0, duration: float = 1.0
) -> Reference:
    """Return a homogeneous ball on a rough plane that slides until it rolls.

    Parameters
    ----------
    mu : float
        Coefficient of friction.
    slope : float
        Tangent of the angle of the plane.
    speed : float
        Initial speed of the centre down the plane [m/s].
    spin : float
        Initial angular velocity, positive if it rolls down; negative is backspin [rad/s].
    duration : float
        [s].

    Raises
    ------
    InputError
        If mu is negative or the duration is not positive.

    Notes
    -----
    On a level floor the ball rolls after 2 |speed - r spin| / (7 mu g), at (5 speed + 2 r spin) / 7. On an incline it
    rolls if mu >= 2/7 tan, with the acceleration 5/7 g sin. The plane is level and gravity is inclined.
    """
    mu, slope = not_negative(mu, "mu"), finite(slope, "slope")
    speed, spin = finite(speed, "speed"), finite(spin, "spin")
    _, end = checked(0.0, duration)
    cos = 1.0 / np.sqrt(1.0 + slope**2)
    load = G * cos * slope
    slips = stretches(speed - _RADIUS * spin, load, _SLIP * mu * G * cos)
    starts, states = [], []
    x, angle = 0.0, 0.0
    for k, slip in enumerate(slips):
        # the tangential force per mass changes the slip by 7/2 of itself
        force = (slip.acceleration - load) / _SLIP
        line = Stretch(slip.start, x, speed, load + force)
        turn = Stretch(slip.start, angle, spin, -2.5 * force / _RADIUS)
        starts.append(slip.start)
        states.append(partial(_rolling, line, turn))
        if k + 1 < len(slips):
            (x, speed), (angle, spin) = line(slips[k + 1].start), turn(slips[k + 1].start)
    scene = Scene(gravity=(load, 0.0, -G * cos), friction=mu)
    scene.add_halfspace((0, 0, 1), name="floor")
    q, v = states[0](0.0)
    problem = _with_ball(scene, (q, v))
    source = "closed form: constant accelerations of the centre and of the spin; exact to rounding"
    name = f"ball that rolls, mu = {mu:g}, slope = {slope:g}, {v[0]:g} m/s, {v[4]:g} rad/s"
    return Reference(name, problem, end, Pieces(starts, states, end), np.zeros(0), source, times(starts[1:], end))


def ball_with_spin(
    e: float = 0.7,
    mu: float = 0.12,
    velocity: Sequence[float] | Array = (1.0, 0.5),
    spin: Sequence[float] | Array = (5.0, -20.0, 12.0),
    height: float = 0.5,
    bounces: int = 6,
) -> Reference:
    """Return a ball with spin that bounces off a rough floor: each impact sticks or slips.

    Parameters
    ----------
    e : float
        Restitution in (0, 1].
    mu : float
        Coefficient of friction.
    velocity : array_like, shape (2,)
        Initial horizontal velocity of the centre [m/s].
    spin : array_like, shape (3,)
        Initial angular velocity in the world [rad/s].
    height : float
        Initial height of the lowest point [m].
    bounces : int
        Number of impacts; the solution ends in the middle of the flight after the last.

    Raises
    ------
    InputError
        If e is not in (0, 1], mu is negative, the height is not positive, or a shape is wrong.

    Notes
    -----
    With u_t the slip at the contact before an impact of normal speed w, the tangential velocity of the centre changes
    by -2/7 u_t if |u_t| <= 7/2 mu (1 + e) w (it sticks), and otherwise by -mu (1 + e) w u_t / |u_t|. The angular
    velocity is constant in flight.
    """
    e, _ = checked(positive(e, "restitution e"), 1.0)
    mu, height = not_negative(mu, "mu"), positive(height, "height")
    number = integer(bounces, "bounces", 1)
    start, centre = 0.0, np.array([0.0, 0.0, _RADIUS + height])
    v, w = np.append(vector(velocity, "velocity", 2), 0.0), vector(spin, "spin")
    turn = Rotation.identity()
    starts, states = [], []
    flight = float(np.sqrt(2.0 * height / G))
    for k in range(number + 1):
        state = _flight(start, centre, v, turn, w)
        starts.append(start)
        states.append(state)
        if k == number:
            break
        start += flight
        centre = np.append(state(start)[0][:2], _RADIUS)
        turn = Rotation.from_rotvec(flight * w) * turn
        v, w = bounced(v - [0.0, 0.0, G * flight], w, e, mu)
        flight = 2.0 * float(v[2]) / G
    end = start + 0.5 * flight
    scene = Scene(gravity=(0, 0, -G), restitution=e, friction=mu)
    scene.add_halfspace((0, 0, 1), name="floor")
    source = "closed form: parabolas and constant spin between impacts; exact to rounding"
    name = f"ball with spin, e = {e:g}, mu = {mu:g}"
    return Reference(
        name, _with_ball(scene, states[0](0.0), e), end, Pieces(starts, states, end), np.array(starts[1:]), source
    )


def bounced(v: Array, w: Array, e: float, mu: float) -> tuple[Array, Array]:
    """Return the velocity of the centre and the angular velocity after an impact on the floor, in the world."""
    up = np.array([0.0, 0.0, 1.0])
    slip = v - _RADIUS * np.cross(w, up)
    slip[2] = 0.0
    size, most = float(np.linalg.norm(slip)), -mu * (1.0 + e) * v[2]
    change = -slip / _SLIP if size <= _SLIP * most else -most * slip / size
    jump = change - (1.0 + e) * v[2] * up
    return v + jump, w - 2.5 / _RADIUS * np.cross(up, change)


def _with_ball(scene: Scene, state: State, e: float = 0.0) -> Problem:
    """Return the problem of a ball that starts at a state of a free body."""
    scene.add_sphere(_RADIUS, _MASS, position=state[0][:3], name="ball")
    problem = scene.build()
    return Problem(problem.system, problem.constraints.constraints, *state, restitution=e, length=problem.length)


def _rolling(line: Stretch, turn: Stretch, t: Times) -> State:
    (x, speed), (angle, spin) = line(t), turn(t)
    q = stacked(x, 0.0, _RADIUS, 0.0, np.sin(0.5 * angle), 0.0, np.cos(0.5 * angle))
    return q, stacked(speed, 0.0, 0.0, 0.0, spin, 0.0)


def _flight(start: float, centre: Array, velocity: Array, turn: Rotation, spin: Array) -> Motion:
    """Return the motion of a ball that flies with constant spin, from a time on."""
    fall, rate = np.array([0.0, 0.0, -G]), float(np.linalg.norm(spin))
    # the spin is constant in the axes of the ball, too
    first, own = turn.as_quat(), turn.inv().apply(spin)
    quarter = compose(np.append(spin / rate, 0.0)[None], first[None])[0] if rate else first

    def state(t: Times) -> State:
        s = column(t - start)
        half = 0.5 * s * rate
        place, axes = centre + s * (velocity + 0.5 * s * fall), np.cos(half) * first + np.sin(half) * quarter
        return np.concatenate([place, axes], axis=-1), np.concatenate([velocity + s * fall, own + 0.0 * s], axis=-1)

    return state
