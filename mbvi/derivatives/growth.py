"""How variations of the start grow along a run."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..errors import InputError
from ..problem import Problem
from ..results.trajectory import Trajectory
from ..system.parts import velocity_units
from ..system.system import Array
from .directions import Directions

if TYPE_CHECKING:
    from .variation import Variation


def growth(problem: Problem, matrices: Array, varied: Directions) -> Array:
    """Return the largest factor by which a variation of the start has grown at each time, shape (n + 1,).

    Places count in lengths of the scene and angles in rad, velocities in these a second.
    """
    if "state" not in varied.columns:
        raise InputError('growth is that of variations of the start: wrt must hold "state"')
    own = varied.columns["state"]
    units = np.tile(velocity_units(problem.system, problem.length), 2)
    # each column varies one coordinate
    sizes = units[np.abs(varied.start[:, own]).argmax(axis=0)]
    return np.linalg.norm(matrices[:, :, own] / units[:, None] * sizes, 2, axis=(1, 2))


def with_growth(run: Trajectory, variation: Variation) -> Trajectory:
    """Return the run with the growth of variations of its start as far as it is followed, where all were varied."""
    varied, problem, known = variation.varied, variation.problem, variation.known[: len(run.t)]
    own = varied.columns.get("state", slice(0, 0))
    if own.stop - own.start < 2 * problem.system.nv or not known:
        return run
    factors = growth(problem, np.array(known) / varied.sizes, varied)
    return replace(run, record=replace(run.record, growth=factors))
