"""What the percussions of two halves of a step leave out of the velocity that is extrapolated from them."""

from __future__ import annotations

import numpy as np

from ..positions.corrections import wrenches
from ..step import Step
from .doubling import Doubled

Array = np.ndarray


def with_balance(found: Doubled, closed: Array, returned: Array) -> Step:
    """Return the second half with the wrenches that belong to twice the velocity of both halves less that of the whole.

    They make the recorded forces of contacts those of the extrapolated state, which are of order two.

    Parameters
    ----------
    found : Doubled
        The step, with the same contacts in all parts.
    closed : ndarray of bool, shape (k,)
        Which rows of the second half are those.
    returned : ndarray, shape (n, 6)
        Wrenches of these rows that are added, as `Returned.wrench`.
    """
    second = found.second
    number, total = second.active.constraint, np.zeros((len(second.active.constraint), 6))
    own = _wrenches_of(second)
    if second.correction is not None:
        total[: len(second.correction)] = second.correction
    total[closed] += returned
    total += own
    # points may differ, moments are about the origin: rows of one constraint are one
    for step, factor in ((found.first, 1.0), (found.whole, -1.0)):
        each = factor * _wrenches_of(step)
        for a, constraint in enumerate(step.active.constraint.tolist()):
            same = np.flatnonzero(number == constraint)
            if len(same):
                total[same[0]] += each[a]
    return second._replace(correction=total)


def _wrenches_of(step: Step) -> Array:
    """Return the wrench of each row of a step, with its correction, shape (k, 6)."""
    found = wrenches(
        step.active, np.arange(len(step.percussion)), step.percussion, None if step.slip is None else step.slip[0]
    )
    if step.correction is not None:
        found[: len(step.correction)] += step.correction
    return found
