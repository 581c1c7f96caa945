"""The derivative of an elastic bounce by its start, by steps of fixed length and by `mbvi.sensitivity`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mbvi.derivatives import sensitivity
from mbvi.problem import Problem
from mbvi.run.simulate import simulate
from mbvi.scene import Scene
from mbvi.schemes import Centered, EventDriven, Paoli

# a ball falls onto a floor, e = 1 [m, s, m/s^2]
RADIUS, HEIGHT, DURATION, GRAVITY = 0.1, 1.0, 0.8, 9.81
# half of the distance of the starts of two runs whose ends are compared [m]
_APART = 1e-7
_TOLERANCE = 1e-9


@dataclass(frozen=True)
class GradientRecord:
    """One point of the chart.

    Attributes
    ----------
    line : str
        What computed it.
    step : float
        Time step, the mean one where it is chosen [s].
    height : float
        Height of the ball at the end [m].
    slope : float
        Derivative of this height by that at the start.
    setting : str
        Setting of another engine.
    """

    line: str
    step: float
    height: float
    slope: float
    setting: str = ""


def exact() -> tuple[float, float]:
    """Return the height at the end [m], and its derivative by that at the start."""
    fall = np.sqrt(2.0 * (HEIGHT - RADIUS) / GRAVITY)
    left = DURATION - fall
    return float(RADIUS + GRAVITY * fall * left - 0.5 * GRAVITY * left**2), float((2.0 * DURATION - 3.0 * fall) / fall)


def steps_of(count: int) -> list[float]:
    """Return steps from 10 ms to 0.1 ms that divide the duration [s]; few of them, and none a multiple of another."""
    return [DURATION / round(DURATION / h) for h in 1.03 * np.geomspace(1e-2, 1e-4, count)]


def ball(height: float = HEIGHT) -> Problem:
    """Return the ball above its floor."""
    scene = Scene(gravity=(0.0, 0.0, -GRAVITY), restitution=1.0)
    scene.add_halfspace((0.0, 0.0, 1.0), name="floor")
    scene.add_sphere(RADIUS, mass=1.0, position=(0.0, 0.0, height), name="ball")
    return scene.build()


def measure_ours(steps: Sequence[float]) -> list[GradientRecord]:
    """Return the records of mbvi: of steps whose runs are compared, of the same with impacts located, and without."""
    found = []
    for h in steps:
        low, middle, high = (
            float(simulate(ball(z), Paoli(), step=h, duration=DURATION, progress=False).q[-1, 2])
            for z in (HEIGHT - _APART, HEIGHT, HEIGHT + _APART)
        )
        found.append(GradientRecord("differences of runs, Paoli", h, middle, (high - low) / (2.0 * _APART)))
    for h in steps:
        one = sensitivity(ball(), Centered(), duration=DURATION, step=h)
        found.append(GradientRecord("mbvi.sensitivity, Centered", h, float(one.run.q[-1, 2]), float(one.matrix[2, 2])))
    one = sensitivity(ball(), EventDriven(_TOLERANCE), duration=DURATION)
    mean = DURATION / (len(one.run.t) - 1)
    line = f"mbvi.sensitivity, EventDriven({_TOLERANCE:.0e})"
    return [*found, GradientRecord(line, mean, float(one.run.q[-1, 2]), float(one.matrix[2, 2]))]
