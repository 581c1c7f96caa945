"""Stress scenes of spheres, boxes and beads."""

from __future__ import annotations

from functools import partial

import numpy as np

from mbvi import reference
from mbvi.constraints import GapFunction
from mbvi.problem import Problem
from mbvi.results.trajectory import Trajectory
from mbvi.scene import Scene
from mbvi.system import LagrangianSystem
from mbvi.system.system import Array

from ..spheres import cube_of_spheres
from .scene import StressScene, compared, energy_drift, gain_or_penetration, moved, penetration

_G = 9.81
# radius of a sphere, diameter of a bead [m]
_GRAIN, BEAD = 0.1, 0.02
# legs of the table: gradients with respect to height and two small angles, shape (100, 3)
_ANGLES = np.linspace(0.0, 2.0 * np.pi, 100, endpoint=False)
LEGS = np.column_stack([np.ones(100), np.sin(_ANGLES), -np.cos(_ANGLES)])


def _bouncing_grid(h: float) -> Problem:
    scene = Scene(restitution=1.0)
    scene.add_halfspace((0, 0, 1), name="floor")
    x, y = np.meshgrid(np.arange(7) * 0.5, np.arange(7) * 0.5)
    heights = 1.0 + 0.01 * np.arange(49)
    scene.add_spheres(positions=np.column_stack([x.ravel(), y.ravel(), heights]), radius=0.1, mass=1.0)
    return scene.build()


def _cube_of_spheres(e: float, h: float) -> Problem:
    return cube_of_spheres(e)


def _heavy_on_light(ratio: float, h: float) -> Problem:
    scene = Scene()
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_box(size=(0.2, 0.2, 0.1), mass=1.0, position=(0, 0, 0.05), name="light")
    scene.add_box(size=(0.2, 0.2, 0.1), mass=ratio, position=(0, 0, 0.15), name="heavy")
    return scene.build()


def _linear(row: Array, offset: float) -> GapFunction:
    return GapFunction(lambda q: float(row @ q) - offset, lambda q: row)


def _table(h: float) -> Problem:
    """Return a disc on a hundred legs, dropped from 3 cm; q holds its height and two small angles."""
    mass = np.diag([10.0, 2.5, 2.5])
    system = LagrangianSystem(mass=lambda q: mass, force=lambda t, q, v: np.array([-10.0 * _G, 0.0, 0.0]), dim=3)
    rows = [_linear(row, 0.0) for row in LEGS]
    return Problem(system, rows, [0.03, 0.01, 0.005], np.zeros(3), restitution=0.5)


def _beads(h: float) -> Problem:
    """Return ten beads on a vertical wire; impacts of every bead accumulate."""
    n = 10
    rows = np.eye(n) - np.eye(n, k=-1)
    system = LagrangianSystem(
        mass=lambda q: np.eye(n), force=lambda t, q, v: np.full(n, -_G), dim=n, potential=lambda q: float(_G * q.sum())
    )
    gaps = [_linear(row, own) for row, own in zip(rows, [0.5 * BEAD, *[BEAD] * (n - 1)], strict=True)]
    return Problem(system, gaps, 0.1 + 0.08 * np.arange(n), np.zeros(n), restitution=0.9)


def _plate(h: float) -> Problem:
    """Return a ball that flies at a plate, at ten thicknesses of the plate per step."""
    scene = Scene(gravity=(0, 0, 0), restitution=0.5)
    scene.add_box(size=(2.0, 2.0, 0.01), position=(0, 0, 0), fixed=True, name="plate")
    # a distance that is no whole number of steps
    scene.add_sphere(radius=0.002, mass=1.0, position=(0, 0, 0.5437), velocity=(0, 0, -0.1 / h))
    return scene.build()


def _passed(run: Trajectory) -> float:
    """Return the largest distance of the ball beyond the plate [m]."""
    return max(0.0, -float(run.q[:, 2].min()))


def _cradle(gap: float) -> reference.Reference:
    return reference.chain(1.0, masses=[1.0] * 5, gaps=[0.5, gap, gap, gap], duration=1.5)


BODIES = (
    StressScene("bouncing 7x7, e = 1", _bouncing_grid, 20.0, energy_drift, "relative drift of energy", 1e-2, 0.1),
    StressScene(
        "cube of 216, e = 1", partial(_cube_of_spheres, 1.0), 2.0, energy_drift, "relative drift of energy", 1e-2, 0.1
    ),
    StressScene(
        "cube of 216, e = 0", partial(_cube_of_spheres, 0.0), 2.0, penetration(_GRAIN), "penetration in radii",
        0.01, 0.2,
    ),
    *(
        StressScene(
            f"mass ratio {ratio:.0e}".replace("+0", "").replace("+", ""), partial(_heavy_on_light, ratio),
            1.0, moved, "displacement [m, rad]", 1e-6, 1e-2,
        )
        for ratio in (1e4, 1e8, 1e12)
    ),
    StressScene("table on 100 legs", _table, 2.0, penetration(1.0), "penetration [m]", 1e-3, 2e-2),
    StressScene(
        "ten beads, e = 0.9", _beads, 3.0, gain_or_penetration(BEAD),
        "gain of energy or penetration in diameters", 0.1, 0.5,
    ),
    compared("cradle, touching", _cradle(0.0), 1e-2),
    compared("cradle, gaps of 1e-3", _cradle(1e-3), 1e-2),
    StressScene("plate, ten thicknesses a step", _plate, 1.0, _passed, "passed through by [m]", 0.0, 1e-3),
)  # fmt: skip
