"""The energy that an impact with friction gains, and the largest restitution with which it gains none.

Restitution acts on normals only. Where friction couples normals to tangents, e > 0 can then raise the kinetic energy
(T. R. Kane, 1984). With e = 0 it never rises.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...errors import ProjectionError
from ..metric import Array, Metric
from .friction import FrictionalProjection, project_frictional

# a gain below this share of the kinetic energy is rounding
ROUNDING = 1e-12
# shares of e that are tried in turn, and steps of bisection
_SHARES, _BISECTIONS = [k / 16 for k in range(16, -1, -1)], 40


class CappedImpact(NamedTuple):
    """An impact that gains no energy.

    Attributes
    ----------
    projection : FrictionalProjection
        The impact.
    e : ndarray, shape (m,)
        The restitution that was used.
    gain : float
        What the impact would have gained with the restitution that was asked for [J]; negative where it loses energy,
        inf where the law has no solution with it.
    """

    projection: FrictionalProjection
    e: Array
    gain: float


def energy_gain(found: FrictionalProjection, rate: Array | None = None) -> float:
    """Return the work of percussions, which is the kinetic energy that bodies gain from contacts [J].

    Parameters
    ----------
    found : FrictionalProjection
        The impact.
    rate : ndarray, shape (3 m,), optional
        What moving walls add to J w. Energy is then counted without the work of the walls.
    """
    speed = 0.5 * (found.free + found.after)
    return float(found.percussion @ (speed if rate is None else speed + rate))


def capped_restitution(
    x: Array,
    metric: Metric,
    J: Array,
    before: Array,
    e: Array,
    friction: Array,
    rate: Array | None = None,
    residual: float = 1e-6,
    start: FrictionalProjection | None = None,
) -> CappedImpact:
    """Apply Coulomb's law with the largest restitution, at most e, that gains no energy.

    The restitutions of all contacts are reduced by one factor. Shares of e in steps of 1/16 are tried downwards, and
    the limit between the last two is found by bisection. Each is one solution of the law; shares of e with which it has
    none are passed over.

    Parameters
    ----------
    x, metric, J, friction, residual, start
        See `project_frictional`.
    before, e : ndarray, shape (m,)
        Normal rates J_n v before the impact [m/s], and the restitution of each contact.
    rate : ndarray, shape (3 m,), optional
        What moving walls add to J w.

    Raises
    ------
    ProjectionError
        If the law is not solved with e = 0; see `project_frictional`.
    """
    still = np.zeros(len(J)) if rate is None else rate
    tolerance = 0.5 * ROUNDING * float(x @ metric.apply(x))

    def impact(share: float) -> tuple[FrictionalProjection | None, float]:
        lower = -still
        lower[::3] -= share * e * (before + still[::3])
        try:
            found = project_frictional(x, metric, J, lower, friction, residual, start)
        except ProjectionError:
            if share == 0.0:
                raise
            return None, np.inf
        return found, energy_gain(found, still)

    found, asked = impact(1.0)
    below, above = 1.0, 1.0
    if asked > tolerance:
        for share in _SHARES[1:]:
            found, gain = impact(share)
            below = share
            if gain <= tolerance:
                break
            above = share
        for _ in range(_BISECTIONS):
            middle = 0.5 * (below + above)
            trial, gain = impact(middle)
            if gain <= tolerance:
                below, found = middle, trial
            else:
                above = middle
    assert found is not None
    return CappedImpact(found, below * e, asked)
