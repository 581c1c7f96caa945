"""Timed runs of piles by mbvi and by other engines: CPU time per simulated second, and the worst depth."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import import_module
from time import process_time

import numpy as np

from mbvi.compiled import compile_all
from mbvi.errors import MbviError, MbviWarning
from mbvi.run.simulate import simulate
from mbvi.schemes import StewartTrinkle

from ..engines.variant import Variant
from .errors import Array
from .piles import PICTURES, Pile, PilePoses
from .records import NOT_MEASURED

# depths are evaluated at steps that are at least this far apart [s]
_SAMPLE = 2e-3
# part of a run that is run before it, so that caches are warm
_WARM = 0.05


@dataclass(frozen=True)
class PileRecord:
    """One point of a chart of piles; NaN means that it does not apply.

    Attributes
    ----------
    picture, scene, pile : str
        The picture, and the panel by its name on the command line and in the picture.
    line : str
        The engine with what is kept along its line.
    setting : str
        Its other settings.
    step : float
        Time step [s].
    accuracy : float
        The `depth` that mbvi was given.
    duration : float
        Simulated time [s].
    cpu : float
        CPU time per simulated second [s / s].
    depth : float
        Worst depth at any sample, in `unit`.
    end : float
        Depth at the end, in `unit`.
    residual : float
        Largest relative residual of mbvi.
    unit : str
        Unit of the depths: "radii" or "edges".
    """

    picture: str
    scene: str
    pile: str
    line: str
    setting: str
    step: float
    accuracy: float
    duration: float
    cpu: float
    depth: float
    end: float
    residual: float
    unit: str


@dataclass(frozen=True)
class Cost:
    """CPU time per simulated second [s / s], worst and last depth [units of the pile], largest relative residual."""

    cpu: float
    depth: float
    end: float
    residual: float = NOT_MEASURED


def run_ours(pile: Pile, h: float, depth: float | None = None, residual: float | None = None) -> Cost:
    """Run `StewartTrinkle`; the time includes recording."""
    compile_all()
    with warnings.catch_warnings():
        # warnings are in the notes, too
        warnings.simplefilter("ignore", MbviWarning)
        for duration in (_WARM * pile.duration, pile.duration):
            problem, begin = pile.problem(), process_time()
            run = simulate(
                problem, StewartTrinkle(), step=h, duration=duration, depth=depth, residual=residual, progress=False
            )
            spent = process_time() - begin
    judge = _Judge(pile)
    every = _samples(h)
    depths = [judge.depth(q) for q in run.q[::every]] + [judge.depth(run.q[-1])]
    return Cost(spent / pile.duration, max(depths), depths[-1], float(run.residual.max()))


class TooSlowError(MbviError):
    """A run of another engine was given up, because it needs more CPU time than it may."""


def run_peer(pile: Pile, variant: Variant[Pile, PilePoses], h: float, limit: float = np.inf) -> Cost:
    """Run another engine; the time is that of its steps alone.

    Raises
    ------
    TooSlowError
        If these need more CPU time than `limit` [s].
    """
    engine, judge, every = variant.make(pile, h), _Judge(pile), _samples(h)
    steps, spent, depths = round(pile.duration / h), 0.0, [0.0]
    for first in range(0, steps, every):
        begin = process_time()
        for _ in range(min(every, steps - first)):
            engine.advance()
        spent += process_time() - begin
        if spent > limit:
            raise TooSlowError(f"{variant.line} needs over {limit:g} s of CPU time for {pile.name} at h = {h:g} s")
        depths.append(judge.depth(pile.configuration(*engine.read())))
    return Cost(spent / pile.duration, max(depths), depths[-1])


def _samples(h: float) -> int:
    """Return the number of steps between two samples of the depth."""
    return max(1, round(_SAMPLE / h))


class _Judge:
    """Evaluates the depth of a configuration by mbvi's gaps, for all engines alike."""

    def __init__(self, pile: Pile) -> None:
        self._problem, self._unit = pile.problem(), pile.unit[1]

    def depth(self, q: Array) -> float:
        """Return the deepest penetration in units of the pile; infinite for a configuration that is not finite."""
        if not np.isfinite(q).all():
            return np.inf
        gap = self._problem.constraints.active(0.0, q, self._problem.tolerance).gap
        return max(0.0, -float(gap.min(initial=0.0))) / self._unit


def sweep_ours(
    picture: str, scene: str, steps: Sequence[float], depths: Sequence[float], budget: float
) -> tuple[PileRecord, ...]:
    """Run mbvi on a scene of a picture, at each step and each accepted depth; see `sweep_peer_piles`."""
    pile, found, each = PICTURES[picture].scenes[scene](), [], 0.0
    for h in steps:
        if each * pile.duration / h > budget:
            break
        for depth in depths:
            cost = run_ours(pile, h, depth)
            each = cost.cpu * h
            line = f"mbvi, h = {1e3 * h:g} ms"
            found.append(_record(picture, scene, pile, line, "StewartTrinkle()", h, depth, cost))
    return tuple(found)


def sweep_peer_piles(
    module: str, picture: str, scene: str, steps: Sequence[float], budget: float
) -> tuple[PileRecord, ...]:
    """Run another engine on a scene of a picture in all its variants at each step; called in a worker process.

    Parameters
    ----------
    module : str
        Name of the adapter, such as "piles_in_mujoco". Its function `variants(pile)` returns how to set the engine.
    picture, scene : str
        Their names.
    steps : sequence of float
        Time steps [s], the longest first.
    budget : float
        CPU time of a run: steps are left out from the first that would cost more, judged by the one before, or that
        costs over twice as much [s].

    Raises
    ------
    MbviError
        If no step can be run.
    """
    pile, found = PICTURES[picture].scenes[scene](), []
    given_up: TooSlowError | None = None
    engine = import_module(f"..engines.{module}", __package__)
    for variant in engine.variants(pile):
        each = 0.0
        for h in steps:
            if each * pile.duration / h > budget:
                break
            try:
                cost = run_peer(pile, variant, h, 2.0 * budget)
            except TooSlowError as error:
                given_up = error
                break
            each = cost.cpu * h
            if np.isfinite(cost.depth):
                found.append(_record(picture, scene, pile, variant.line, variant.setting, h, NOT_MEASURED, cost))
    if not found:
        raise given_up or MbviError(f"it diverges on {pile.name} at all steps")
    return tuple(found)


def _record(
    picture: str, scene: str, pile: Pile, line: str, setting: str, h: float, accuracy: float, cost: Cost
) -> PileRecord:
    return PileRecord(
        picture, scene, pile.name, line, setting, h, accuracy, pile.duration, cost.cpu, cost.depth, cost.end,
        cost.residual, pile.unit[0],
    )  # fmt: skip
