"""The rows of the last step, whose contact points its bodies have carried to where the law acts now."""

from __future__ import annotations

import numpy as np

from ..constraints.carried import Place, carried
from ..problem import Problem
from ..schemes import Step, Timing

Array = np.ndarray

_NONE = np.zeros(0, np.int64), np.zeros((2, 0, 3)), np.zeros((4, 0))


def carried_rows(
    problem: Problem, timing: Timing, before: Step | None, last: Step | None, t: float
) -> tuple[Array, Array, Array]:
    """Return the rows of a step that have a percussion, constraints ascending, as they are at the law of the next step.

    Parameters
    ----------
    problem, timing
        Those of the run.
    before, last : Step or None
        The state before the step, None where that is the initial one, and the step.
    t : float
        End of the next step [s].

    Returns
    -------
    number : ndarray of int, shape (k,)
        Constraints.
    point : ndarray, shape (2, k, 3)
        Contact points as the first and as the second body has carried them [m].
    rates : ndarray, shape (4, k)
        See `Step`.
    """
    if last is None:
        return _NONE
    loaded = np.flatnonzero(last.rates[0] > 0.0)
    if not loaded.size:
        return _NONE
    rows = last.active
    loaded = loaded[np.argsort(rows.constraint[loaded], kind="stable")]
    number, rates = rows.constraint[loaded], np.ascontiguousarray(last.rates[:, loaded])
    # the law of the initial state acts there
    start = last if before is None else before
    old, new = (
        Place(at.t + timing.jump * h, timing.place_of_law(problem.system, at.q, at.v, h))
        for at, h in ((start, last.t - start.t), (last, t - last.t))
    )
    return number, carried(problem.constraints, number, rows.point[loaded], old, new), rates
