"""What else could have happened: every outcome of an impact that is taken one constraint after the other."""

from __future__ import annotations

from collections import defaultdict, deque
from dataclasses import dataclass
from itertools import product
from math import prod

import numpy as np

from ..projection.metric import Array, Metric, as_metric
from ..projection.project import checked_impact
from ..projection.projector import Projector
from .angles import condition_12_violation, cosines_between, islands, unit_gradients

# relative to the kinetic norm of v: normal speeds below this close nothing; states nearer than that were met before,
# less than any impact moves; outcomes nearer than that are one
_STILL, _MET, _SAME = 1e-12, 1e-13, 1e-8
# single impacts followed altogether, and outcomes listed
_MOST_IMPACTS, _MOST_OUTCOMES = 20_000, 10_000
# numbers an impact of a large island may touch altogether
_MOST_WORK = 200_000_000


@dataclass(frozen=True)
class Forks:
    """The outcomes of one impact under arbitrarily small perturbations, beside the law's own.

    Attributes
    ----------
    outcomes : ndarray, shape (k, nv)
        Velocities after all orders of successive single impacts, without duplicates [m/s, rad/s].
    law : ndarray, shape (nv,)
        Velocity after the simultaneous law (8).
    spread : float
        Largest distance between any two of all these, in the kinetic norm [J^(1/2)]; nan where no outcome was found,
        and a lower bound where the search is not complete.
    complete : bool
        Whether every cascade was followed to its end and all outcomes are listed.
    reason : str
        Why not; empty where it is complete.
    """

    outcomes: Array
    law: Array
    spread: float
    complete: bool
    reason: str = ""


def forks(M: Array | Metric, J: Array, v: Array, e: Array | float) -> Forks:
    """Return all outcomes that arbitrarily small perturbations of the data can lead to.

    A perturbation lets constraints that close together close one after the other: v becomes
    v - (1 + e_a) (J_a v / G_aa) M^-1 J_a' for one closing row a, then for another, until none closes. All orders are
    followed. Where condition (12) holds, all of them lead to the law (8), the endless ones too.

    Parameters
    ----------
    M : ndarray, shape (nv, nv), or Metric
        Mass matrix.
    J : ndarray, shape (m, nv)
        Gradients of the active constraints.
    v : ndarray, shape (nv,)
        Velocity before, v-.
    e : float or ndarray, shape (m,)
        Restitution in [0, 1], one for all or one each.

    Returns
    -------
    Forks
        Outcomes, the law's own, their spread, and whether that is all.

    Raises
    ------
    InputError, ProjectionError
        As `impact`.

    Notes
    -----
    In exact arithmetic any perturbation will do; a time-stepping scheme perturbs by what it travels in a step.
    Endless cascades (e < 1) end where nothing closes faster than 1e-12 |v|_M. Where three constraints or more strike
    repeatedly, an order may be listed that no perturbation brings about.
    """
    v, J, e = checked_impact(v, J, e)
    metric = as_metric(M, v.size)
    return follow(metric, J, v, e, _MOST_IMPACTS)


def follow(metric: Metric, J: Array, v: Array, e: Array, most: int) -> Forks:
    """Return the forks of checked data, following at most so many single impacts an island."""
    law = Projector().project(v, metric, J, -e * (J @ v)).velocity
    columns, lengths = unit_gradients(metric, J)
    kept = np.flatnonzero(lengths > 0.0)
    columns, e = columns[:, kept], e[kept]
    before, jump = (metric.whiten(metric.apply(w)) for w in (v, law - v))
    scale = float(np.sqrt(before @ before))
    ends, reasons, spread = [], [], 0.0
    cosines = cosines_between(columns)
    for rows in islands(cosines):
        # rows of one island span few directions
        basis, R = np.linalg.qr(columns[:, rows])
        start = basis.T @ before
        if condition_12_violation(cosines[np.ix_(rows, rows)], e[rows], 0.0).any():
            found, reason = _cascades(R, e[rows], start, scale, most)
        else:
            # percussions of single impacts then only grow, up to the least that leave nothing closing: the law's own
            found, reason = [start + basis.T @ jump], ""
        reasons += [reason] if reason else []
        spread += _diameter(np.array([*found, start + basis.T @ jump])) ** 2
        ends.append([basis @ (z - start) for z in found])
    if prod(map(len, ends)) > _MOST_OUTCOMES:
        reasons.append(f"impacts far from each other combine to more than {_MOST_OUTCOMES} outcomes")
        most_each = max(1, int(_MOST_OUTCOMES ** (1.0 / len(ends))))
        ends = [part[:most_each] for part in ends]
    moves = [sum(parts, np.zeros(len(v))) for parts in product(*ends)]
    outcomes = np.array([v + metric.unwhiten(move) for move in moves]).reshape(-1, len(v))
    if not len(outcomes):
        spread = np.nan
    return Forks(outcomes, law, float(np.sqrt(spread)), not reasons, "; ".join(dict.fromkeys(reasons)))


def _cascades(R: Array, e: Array, start: Array, scale: float, most: int) -> tuple[list[Array], str]:
    """Return where single impacts lead in all orders, and why the search was cut, if it was.

    Parameters
    ----------
    R : ndarray, shape (r, k)
        Unit gradients.
    e : ndarray, shape (k,)
        Restitution.
    start : ndarray, shape (r,)
        Velocity before.
    scale : float
        Kinetic norm of the whole velocity.
    most : int
        Single impacts after which the search ends.
    """
    still, seen = _STILL * scale, _Seen(_MET * scale, len(start))
    most = min(most, max(100, _MOST_WORK // R.size))
    pending, ends, count = deque[tuple[int, int]](), list[Array](), 0
    then: dict[int, list[int]] = {}

    def look(z: Array) -> int:
        number, new = seen.add(z)
        if new:
            then[number] = []
            rates = z @ R
            closing = np.flatnonzero(rates < -still)
            if not closing.size:
                ends.append(z)
            # straight on by the fastest, so that some cascade ends early; the others wait, shortest cascades first
            order = closing[np.argsort(rates[closing], kind="stable")].tolist()
            pending.extendleft((number, a) for a in order[:1])
            pending.extend((number, a) for a in order[1:])
        return number

    look(start)
    while pending and count < most:
        number, a = pending.popleft()
        z = seen.points[number]
        then[number].append(look(z - (1.0 + e[a]) * (z @ R[:, a]) * R[:, a]))
        count += 1
    closing_still = max((-float(seen.points[number] @ R[:, a]) for number, a in pending), default=0.0)
    outcomes = _Seen(_SAME * scale, len(start))
    ends = [z for z in ends if outcomes.add(z)[1]]
    if pending:
        return ends, (
            f"the search was cut after {count} single impacts, with rows still closing at up to {closing_still:.3g} "
            "in the kinetic norm"
        )
    return ends, "a cascade comes back to where it was and goes round for ever" if _goes_round(then) else ""


def _goes_round(then: dict[int, list[int]]) -> bool:
    """Tell whether a directed graph has a cycle: taken in turn, those with nothing before them leave some."""
    before = dict.fromkeys(then, 0)
    for numbers in then.values():
        for number in numbers:
            before[number] += 1
    free = [number for number, count in before.items() if not count]
    for number in free:
        for following in then[number]:
            before[following] -= 1
            if not before[following]:
                free.append(following)
    return len(free) < len(then)


def _diameter(points: Array) -> float:
    return max(float(np.linalg.norm(points - z, axis=1).max()) for z in points)


class _Seen:
    """Points already met, to a tolerance: sorted into cells of one random coordinate, in which only near ones share."""

    def __init__(self, tolerance: float, size: int) -> None:
        self._tolerance = max(tolerance, 1e-300)
        direction = np.random.default_rng(0).normal(size=size)
        self._direction = direction / max(float(np.linalg.norm(direction)), 1e-300)
        self._cells: defaultdict[int, list[int]] = defaultdict(list)
        self.points: list[Array] = []

    def add(self, z: Array) -> tuple[int, bool]:
        """Return the number of a point, and whether it is met for the first time."""
        cell = int(np.floor(z @ self._direction / self._tolerance))
        for other in (cell, cell - 1, cell + 1):
            for number in self._cells.get(other, ()):
                if np.linalg.norm(self.points[number] - z) <= self._tolerance:
                    return number, False
        self._cells[cell].append(len(self.points))
        self.points.append(z)
        return len(self.points) - 1, True
