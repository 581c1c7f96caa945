"""Stress scenes in other engines: the same steps and the same numbers, measured on states read after each step."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import BrokenExecutor
from dataclasses import replace
from importlib import import_module
from itertools import product
from typing import Any

from mbvi.compiled import compile_all
from mbvi.results.diagnosis.energies import energies
from mbvi.results.trajectory import Trajectory

from ..chart.workers import worker
from ..engines import Peer
from ..engines.bodies import NoModelError
from ..engines.measure import ModelError, recorded
from .models import model_of
from .scene import StressScene
from .scenes import SCENES
from .sweep import Cell, judged


def sweep_peer(peer: Peer, scenes: Sequence[StressScene], steps: Sequence[float], budget: float) -> Iterator[Cell]:
    """Yield a cell for every scene and step of an engine; it runs in a process of its own.

    Parameters
    ----------
    peer : Peer
        An engine that is installed.
    scenes : sequence of StressScene
        Scenes of `SCENES`.
    steps : sequence of float
        [s].
    budget : float
        Limit of the CPU time of one run [s].

    Raises
    ------
    ImportError
        If the engine cannot be loaded.
    """
    waiting, name = list(product(scenes, steps)), ""
    while waiting:
        with worker(silent=True) as call:
            name = name or call(_name, peer.module)
            while waiting:
                scene, h = waiting.pop(0)
                try:
                    yield call(peer_cell, peer.module, scene.name, h, budget)
                except BrokenExecutor:
                    yield Cell(scene.name, name, h, float("inf"), "failed", 0.0, "its process died")
                    break


def peer_cell(module: str, scene: str, h: float, budget: float) -> Cell:
    """Run one scene in an engine at one step, as `cell` does in mbvi; the cell holds the engine's settings."""
    compile_all()
    engine, stress_scene = _engine(module), next(s for s in SCENES if s.name == scene)
    problem, setting, peer = stress_scene.make(h), "", None
    try:
        if not hasattr(engine, "Free"):
            raise NoModelError(engine.NO_BODIES)
        model = model_of(stress_scene, problem)
    except NoModelError as error:
        return Cell(scene, engine.NAME, h, float("inf"), "not run", 0.0, str(error))

    def run() -> Trajectory:
        nonlocal setting, peer
        try:
            peer = engine.Free(model, h)
            setting = peer.settings
            if hasattr(peer, "limit"):
                peer.limit(budget)
            peer.start(model.state(problem.q0, problem.v0))
            run = recorded(problem, scene, model, peer, h, problem.t0, int(stress_scene.duration / h * (1.0 + 1e-12)))
        except engine.FAILURES as error:
            raise ModelError(f"{engine.NAME}: {error}") from error
        if peer.continuous:
            # q and v of a continuous engine belong to the same time
            own = energies(problem, run.t, run.q, run.v, 0.0)
            run = replace(run, record=replace(run.record, energies=own))
        return run

    found = judged(stress_scene, engine.NAME, h, budget, run)
    # CPU time in a child process of the engine; float() is 0
    own = getattr(peer, "clock", float)()
    return replace(found, setting=setting, cpu=found.cpu + own)


def _engine(module: str) -> Any:
    return import_module(f"..engines.{module}", __package__)


def _name(module: str) -> str:
    return str(_engine(module).NAME)
