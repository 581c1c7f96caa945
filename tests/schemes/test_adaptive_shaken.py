"""`Adaptive` on floors that oscillate: reversals of slip and flights within a step, against exact solutions."""

import numpy as np
import pytest
from scipy.optimize import brentq

import mbvi
from mbvi import motion

G, DURATION = 9.81, 0.6


def first_root(function, start, grid):
    """The first time on a grid after `start` at which a function has become negative; None without."""
    below = np.flatnonzero(function(start + grid) < 0.0)
    return brentq(function, start, start + grid[below[0]]) if below.size else None


def exact_flights(amplitude, omega):
    """The height at any time of a point at rest on a floor that leaves it where the floor falls faster, at e = 0."""

    def floor(t):
        return amplitude * np.sin(omega * t)

    def leaves(t):
        return G - amplitude * omega**2 * np.sin(omega * t)

    def above(start, height, rate):
        return lambda t: height + rate * (t - start) - 0.5 * G * (t - start) ** 2 - floor(t)

    t, flights, grid = 0.0, [], np.linspace(0.0, 4.0 * np.pi / omega, 4001)[1:]
    while t < DURATION:
        start = t if leaves(t) < 0.0 else first_root(leaves, t, grid)
        height, rate = floor(start), amplitude * omega * np.cos(omega * start)
        end = first_root(above(start, height, rate), start + 5e-3 / omega, grid)
        flights.append((start, end, height, rate))
        t = end

    def path(time):
        for start, end, height, rate in flights:
            if start < time < end:
                return height + rate * (time - start) - 0.5 * G * (time - start) ** 2
        return floor(time)

    return path


@pytest.mark.parametrize("tolerance", [1e-3, 1e-4])
@pytest.mark.parametrize(("frequency", "strength"), [(5.0, 1.3), (5.0, 2.0), (10.0, 1.3), (20.0, 1.3)])
def test_a_ball_leaves_the_floor_and_lands_between_two_states(frequency, strength, tolerance):
    """`strength` is the largest acceleration of the floor in that of gravity."""
    omega = 2.0 * np.pi * frequency
    amplitude = strength * G / omega**2
    path = exact_flights(amplitude, omega)
    scene = mbvi.Scene(restitution=0.0)
    scene.add_halfspace((0, 0, 1), name="floor", motion=motion.Oscillation((0, 0, amplitude), frequency))
    scene.add_sphere(0.1, 1.0, position=(0, 0, 0.1), velocity=(0, 0, amplitude * omega))
    problem = scene.build()
    run = mbvi.simulate(problem, mbvi.Adaptive(tolerance), duration=DURATION)
    times = np.linspace(0.0, DURATION, 1001)
    errors = np.abs(run.at(times)[0][:, 2] - 0.1 - [path(t) for t in times]) / problem.length / tolerance
    assert errors.max() < 3.0
    assert len(run.impacts) >= 2


@pytest.mark.parametrize("frequency", [2.3, 5.0])
def test_between_states_a_body_stays_on_its_floor(frequency):
    omega = 2.0 * np.pi * frequency
    amplitude = 0.8 * G / omega**2
    scene = mbvi.Scene(restitution=0.0)
    scene.add_halfspace((0, 0, 1), motion=motion.Oscillation((0, 0, amplitude), frequency))
    scene.add_sphere(0.1, 1.0, position=(0, 0, 0.1), velocity=(0, 0, amplitude * omega))
    problem, times = scene.build(), np.linspace(0.0, DURATION, 1001)
    for tolerance in (1e-3, 1e-5):
        run = mbvi.simulate(problem, mbvi.Adaptive(tolerance), duration=DURATION)
        errors = run.at(times)[0][:, 2] - 0.1 - amplitude * np.sin(omega * times)
        assert np.abs(errors).max() < 2.0 * tolerance * problem.length
        assert not run.impacts


def exact_slides(amplitude, omega, most):
    """Parts of the motion of a box that starts at rest on a floor that shakes along it: (start, x, v, acceleration).

    `most` is the acceleration by friction. Where the box sticks there are no v and no acceleration.
    """

    def wall(t):
        return amplitude * omega * np.cos(omega * t)

    def pulled(t):
        return -amplitude * omega**2 * np.sin(omega * t)

    def slip(side, start, v):
        return lambda t: side * (wall(t) - v - side * most * (t - start))

    grid, t, x, v, side, parts = np.linspace(0.0, 1.0, 20001)[1:], 0.0, 0.0, 0.0, 1.0, []
    while t < DURATION:
        parts.append((t, x, v, side * most))
        end = first_root(slip(side, t, v), t + 2e-4, grid)
        x, t, v = x + v * (end - t) + 0.5 * side * most * (end - t) ** 2, end, wall(end)
        if abs(pulled(t)) <= most:
            parts.append((t, x, None, None))
            end = first_root(lambda s: most - np.abs(pulled(s)), t, grid)
            x, t, v = x + amplitude * (np.sin(omega * end) - np.sin(omega * t)), end, wall(end)
        side = np.sign(pulled(t))
    return parts


@pytest.mark.parametrize("tolerance", [1e-3, 1e-4, 1e-5])
@pytest.mark.parametrize(("frequency", "strength", "friction"), [(5.606, 23.727, 0.318), (6.9, 9.0, 0.335)])
def test_slip_reverses_on_a_floor_that_shakes(frequency, strength, friction, tolerance):
    """`strength` is the largest acceleration of the floor [m/s^2]."""
    omega = 2.0 * np.pi * frequency
    amplitude = strength / omega**2
    parts = exact_slides(amplitude, omega, friction * G)
    assert len(parts) > 3

    def path(time):
        start, x, v, pull = [part for part in parts if part[0] <= time][-1]
        if v is None:
            return x + amplitude * (np.sin(omega * time) - np.sin(omega * start))
        return x + v * (time - start) + 0.5 * pull * (time - start) ** 2

    scene = mbvi.Scene(friction=friction)
    scene.add_halfspace((0, 0, 1), motion=motion.Oscillation((amplitude, 0, 0), frequency))
    scene.add_box((0.5, 0.5, 0.02), 2.0, position=(0, 0, 0.01))
    problem = scene.build()
    run = mbvi.simulate(problem, mbvi.Adaptive(tolerance), duration=DURATION)
    errors = np.abs(run.q[:, 0] - [path(t) for t in run.t]) / problem.length / tolerance
    assert errors.max() < 3.0
