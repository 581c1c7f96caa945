"""Outcomes of an impact with Coulomb friction whose contacts close one after the other, in some orders."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ...constraints.rows import take
from ...errors import ProjectionError
from ...impacts import Forks
from ...projection import Projector

if TYPE_CHECKING:
    from ...constraints import Rows
    from ...projection import Metric

Array = np.ndarray

# most contacts of an impact, and most single impacts of all its orders
_MOST_CONTACTS, _MOST_IMPACTS = 16, 300
# speed relative to the largest one below which a contact does not close, and within which velocities are the same
_STILL, _SAME = 1e-9, 1e-7


def orders_with_friction(metric: Metric, active: Rows, before: Array) -> Forks | None:
    """Return what an impact leads to if its contacts close one after the other, in orders of up to 300 impacts in all.

    Contacts that have closed and stay so take part in each later impact. None where fewer than two contacts close, more
    than 16 take part, walls move, joints or torsional or rolling friction act, or a law is not solved.

    Parameters
    ----------
    metric : Metric
        M.
    active : Rows
        The rows of the impact, with tangents.
    before : ndarray, shape (nv,)
        Velocity before.
    """
    tangents, J = active.tangents, active.jacobian
    if tangents is None or not isinstance(J, np.ndarray) or not 2 <= len(J) <= _MOST_CONTACTS:
        return None
    if active.rate is not None or tangents.rate is not None or tangents.resistance is not None:
        return None
    if tangents.bound is not None or (tangents.friction < 0.0).any():
        return None
    speeds = J @ before
    still = _STILL * np.abs(speeds).max()
    if np.count_nonzero(speeds < -still) < 2:
        return None
    try:
        law, (outcomes, complete) = _law(metric, active, before), _outcomes(metric, active, before, still)
    except ProjectionError:
        return None
    changes = [end - other for k, end in enumerate(outcomes) for other in (law, *outcomes[:k])]
    spread = max((float(np.sqrt(z @ metric.apply(z))) for z in changes), default=np.nan)
    reason = "" if complete else f"more than {_MOST_IMPACTS} single impacts with friction follow each other"
    return Forks(np.array(outcomes).reshape(-1, len(before)), law, spread, complete, reason)


def _law(metric: Metric, rows: Rows, v: Array) -> Array:
    """Return the velocity after an impact of some rows at once."""
    lower = -rows.restitution * np.minimum(rows.jacobian @ v, 0.0)
    return Projector().frictional(v, metric, rows, lower).velocity


def _outcomes(metric: Metric, active: Rows, v: Array, still: float) -> tuple[list[Array], bool]:
    """Return the velocities after orders of single impacts, and whether all orders were followed to their ends."""
    found = list[Array]()
    # what rests already is closed
    waiting, done = [(v, np.abs(active.jacobian @ v) <= still)], 0
    while waiting:
        v, closed = waiting.pop()
        speeds = active.jacobian @ v
        closing = np.flatnonzero(speeds < -still)
        if not len(closing):
            size = _SAME * np.abs(v).max()
            found += [] if any(np.abs(v - end).max() <= size for end in found) else [v]
            continue
        # the fastest one is followed first
        for k in closing[np.argsort(-speeds[closing])].tolist():
            if done == _MOST_IMPACTS:
                return found, False
            now = closed | (np.arange(len(speeds)) == k)
            after, done = _law(metric, take(active, now), v), done + 1
            waiting.append((after, now & (active.jacobian @ after <= still)))
    return found, True
