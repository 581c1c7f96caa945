"""Functions of studies, which worker processes import by their names."""

from __future__ import annotations

import ctypes
import os
import signal
import time

import numpy as np

import mbvi


def drop(height: float, e: float = 0.5) -> mbvi.Scene:
    """Return a ball above a floor."""
    scene = mbvi.Scene(restitution=e)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_sphere(0.1, position=(0, 0, 0.1 + height), name="ball")
    return scene


def drop_by_chance(height: float, e: float, rng: np.random.Generator) -> mbvi.Scene:
    """Return a ball above a floor, thrown at random."""
    scene = mbvi.Scene(restitution=e, friction=0.3)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_box((0.1, 0.1, 0.1), position=(0, 0, 0.2 + height), velocity=rng.normal(size=3), name="box")
    return scene


def bounces(run: mbvi.Trajectory) -> dict[str, object]:
    """Return numbers of every kind, and an array whose length differs."""
    times = [impact.time for impact in run.impacts]
    return {"count": len(times), "last": run.q[-1], "times": times, "high": run.q[-1, 2] > 0.5, "word": run.scheme}


def energy(run: mbvi.Trajectory) -> dict[str, float]:
    """Return the energy at the end, and the velocity."""
    return {"energy": run.energy()[-1], "v": run.v[-1]}


def slow(height: float, e: float, rng: np.random.Generator) -> mbvi.Scene:
    """As `drop_by_chance`, a twentieth of a second later; calls are counted in the file that a variable names."""
    time.sleep(0.05)
    with open(os.environ.get("MBVI_TEST_CALLS", os.devnull), "a") as calls:
        calls.write(".")
    return drop_by_chance(height, e, rng)


def troubled(kind: str) -> mbvi.Scene | mbvi.Problem:
    """Return a ball, or have the trouble of a name."""
    if kind == "raises":
        raise ValueError("no scene today")
    if kind == "kills":
        os.kill(os.getpid(), signal.SIGKILL)
    if kind == "exits":
        os._exit(0)
    if kind == "segfaults":
        ctypes.string_at(0)
    if kind == "leaves":
        raise SystemExit(2)
    if kind == "endless":
        while True:
            sum(range(1000))
    if kind.startswith("diverges"):
        pull = lambda t, q, v: np.array([-9.81 if t < 5e-3 else np.nan])  # noqa: E731
        energy = None if kind.endswith("energy") else lambda q: 9.81 * q[0]
        system = mbvi.LagrangianSystem(mass=lambda q: np.eye(1), force=pull, dim=1, potential=energy)
        return mbvi.Problem(system, [mbvi.GapFunction(lambda q: q[0], lambda q: np.ones(1))], [1.0], [0.0])
    if kind == "stuck":
        # it keeps Python's lock, as a kernel without end would
        ctypes.PyDLL(None).sleep(1000)
    if kind == "no problem":
        return 5
    return drop(0.2)


def wrong_measure(run: mbvi.Trajectory) -> dict[str, object]:
    """Return a name that a study has itself."""
    return {"status": 1}


def nothing(run: mbvi.Trajectory) -> dict[str, object]:
    """Return no mapping."""
    return None


def height(run: mbvi.Trajectory) -> dict[str, float]:
    """Return the last height."""
    return {"height": run.q[-1, -1]}
