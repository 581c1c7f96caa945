"""Stress scenes of mechanisms, of single bodies, and of problems given by functions."""

from __future__ import annotations

import numpy as np

from mbvi import reference
from mbvi.constraints import GapFunction
from mbvi.problem import Problem
from mbvi.results.trajectory import Trajectory
from mbvi.scene import Scene
from mbvi.system import LagrangianSystem
from mbvi.system.system import Array

from .scene import StressScene, compared, energy_drift, gain_or_penetration

_G = 9.81
# crank, rod and slider: lengths [m], masses [kg], inertias [kg m^2]; half width and height of the slider, clearance [m]
_CRANK, _ROD = 0.153, 0.306
_MASSES, _INERTIAS = (0.038, 0.038, 0.076), (7.4e-5, 5.9e-4, 2.7e-6)
_HALF, _TALL, _CLEARANCE = 0.05, 0.025, 0.001


def _slider_crank(h: float) -> Problem:
    """Return a slider-crank with play in the guide: four corners of the slider against two walls."""
    (m1, m2, m3), (J1, J2, J3) = _MASSES, _INERTIAS
    a = J1 + _CRANK**2 * (m1 / 4 + m2 + m3)
    b = J2 + _ROD**2 * (m2 / 4 + m3)
    c = _CRANK * _ROD * (m2 / 2 + m3)

    def mass(q: Array) -> Array:
        coupling = c * np.cos(q[0] - q[1])
        return np.array([[a, coupling, 0.0], [coupling, b, 0.0], [0.0, 0.0, J3]])

    def force(t: float, q: Array, v: Array) -> Array:
        turn = c * np.sin(q[0] - q[1])
        return np.array([
            -turn * v[1] ** 2 - _G * _CRANK * (m1 / 2 + m2 + m3) * np.cos(q[0]),
            turn * v[0] ** 2 - _G * _ROD * (m2 / 2 + m3) * np.cos(q[1]),
            0.0,
        ])  # fmt: skip

    def corner(along: float, up: float, wall: float) -> GapFunction:
        # wall = 1 is above the slider, -1 below; the corner is at (along, up) on the slider

        def gap(q: Array) -> float:
            height = _CRANK * np.sin(q[0]) + _ROD * np.sin(q[1]) + along * np.sin(q[2]) + up * np.cos(q[2])
            return float((_TALL + _CLEARANCE) - wall * height)

        def gradient(q: Array) -> Array:
            rows = [_CRANK * np.cos(q[0]), _ROD * np.cos(q[1]), along * np.cos(q[2]) - up * np.sin(q[2])]
            return -wall * np.array(rows)

        return GapFunction(gap, gradient)

    def potential(q: Array) -> float:
        return float(_G * (_CRANK * (m1 / 2 + m2 + m3) * np.sin(q[0]) + _ROD * (m2 / 2 + m3) * np.sin(q[1])))

    corners = [corner(x, side * _TALL, side) for x in (-_HALF, _HALF) for side in (-1.0, 1.0)]
    system = LagrangianSystem(mass=mass, force=force, dim=3, potential=potential)
    return Problem(system, corners, np.zeros(3), [150.0, -75.0, 0.0], restitution=0.4, length=0.1)


def _tumbling(h: float) -> Problem:
    """Return a free body that rotates about its middle principal axis and flips over."""
    scene = Scene(gravity=(0, 0, 0))
    # the box of mass 1 that has these moments of inertia [kg m^2]
    squares = 6.0 * np.array([[-1, 1, 1], [1, -1, 1], [1, 1, -1]]) @ (np.array([2.0, 1.2, 2.8]) * 1e-2)
    scene.add_box(size=np.sqrt(squares), mass=1.0, angular_velocity=(10.0, 0.01, 0.0))
    return scene.build()


def _stretched_arm(h: float) -> Problem:
    """Return a planar arm of two links that straightens towards a wall; only the straight arm touches it."""

    def mass(q: Array) -> Array:
        c = np.cos(q[1])
        return np.array([[5.0 / 3.0 + c, 1.0 / 3.0 + 0.5 * c], [1.0 / 3.0 + 0.5 * c, 1.0 / 3.0]])

    def force(t: float, q: Array, v: Array) -> Array:
        s = 0.5 * np.sin(q[1])
        return np.array([s * (2.0 * v[0] * v[1] + v[1] ** 2), -s * v[0] ** 2])

    wall = GapFunction(
        lambda q: float(2.0 - np.cos(q[0]) - np.cos(q[0] + q[1])),
        lambda q: np.array([np.sin(q[0]) + np.sin(q[0] + q[1]), np.sin(q[0] + q[1])]),
    )
    system = LagrangianSystem(mass=mass, force=force, dim=2, potential=lambda q: 0.0)
    return Problem(system, [wall], [0.3, -0.6], [-0.7, 1.4], restitution=0.5)


def _off_the_circle(run: Trajectory) -> float:
    """Return the largest distance from the circle [m]."""
    return float(np.abs(np.linalg.norm(run.q, axis=1) - 1.0).max())


_DISC, _BALL = reference.sliding_in_disc(0.0, duration=50.0), reference.bouncing_ball(1.0)

MECHANISMS = (
    compared("rocking block", reference.rocking_block(0.5), 2e-2),
    compared("obtuse corner", reference.corner(0.5, angle=2.0), 2e-2),
    compared("near-grazing chaos", reference.chaotic_oscillator(0.5), 2e-2),
    StressScene(
        "slider-crank with play", _slider_crank, 0.2, gain_or_penetration(_CLEARANCE),
        "gain of energy or penetration in clearances", 0.1, 1.0,
    ),
    StressScene("tumbling body, 20 s", _tumbling, 20.0, energy_drift, "relative drift of energy", 1e-2, 0.1),
    StressScene(
        "arm at full stretch", _stretched_arm, 1.0, gain_or_penetration(1.0),
        "gain of energy or penetration [m]", 1e-2, 0.1,
    ),
    StressScene(
        "50 s in a disc", lambda h: _DISC.problem, _DISC.duration, _off_the_circle, "off the circle by [m]", 1e-3, 1e-1
    ),
    StressScene(
        "a ball for 1e6 steps of 1e-3 s", lambda h: _BALL.problem, 1000.0, energy_drift, "relative drift of energy",
        1e-2, 0.1, long=True,
    ),
)  # fmt: skip
