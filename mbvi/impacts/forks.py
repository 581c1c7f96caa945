"""Forks: all outcomes of an impact whose constraints close one after the other, in any order."""

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

# all relative to the kinetic norm of v: closing speed below which a row counts as still; distance within which two
# velocities of the search are the same, less than any impact changes them; the same for two outcomes
_STILL, _SAME_STATE, _SAME_OUTCOME = 1e-12, 1e-13, 1e-8
# most single impacts of a search, and most outcomes of all islands together
_MOST_IMPACTS, _MOST_OUTCOMES = 20_000, 10_000
# most entries of gradients that the search of a large island may read
_MOST_WORK = 200_000_000


@dataclass(frozen=True)
class Forks:
    """The outcomes of one impact under arbitrarily small perturbations, and that of the simultaneous law.

    Attributes
    ----------
    outcomes : ndarray, shape (k, nv)
        Velocities after all orders of successive single impacts, without duplicates [m/s, rad/s].
    law : ndarray, shape (nv,)
        Velocity after the simultaneous law (8).
    spread : float
        Largest distance between any two of `outcomes` and `law` in the kinetic norm [J^(1/2)]; nan where no outcome was
        found, and a lower bound where the search is not complete.
    complete : bool
        Whether every sequence of single impacts was followed to its end and all outcomes are listed.
    reason : str
        Why the search is not complete; empty where it is.
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
    followed. Where condition (12) holds, all of them, endless ones too, lead to the outcome of the law (8).

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
        The outcomes, that of the law, their spread, and whether the search is complete.

    Raises
    ------
    InputError, ProjectionError
        As `impact`.

    Notes
    -----
    In exact arithmetic an arbitrarily small perturbation is enough; a time-stepping scheme perturbs by the travel in a
    step. Endless sequences (e < 1) end where no row closes faster than 1e-12 |v|_M. Where three constraints or more
    close repeatedly, an order may be listed that no perturbation brings about.
    """
    v, J, e = checked_impact(v, J, e)
    metric = as_metric(M, v.size)
    return follow(metric, J, v, e, _MOST_IMPACTS)


def follow(metric: Metric, J: Array, v: Array, e: Array, most: int) -> Forks:
    """Return the forks of checked data, following at most `most` single impacts of each island."""
    law = Projector().project(v, metric, J, -e * (J @ v)).velocity
    columns, lengths = unit_gradients(metric, J)
    kept = np.flatnonzero(lengths > 0.0)
    columns, e = columns[:, kept], e[kept]
    before, jump = (metric.whiten(metric.apply(w)) for w in (v, law - v))
    scale = float(np.sqrt(before @ before))
    ends, reasons, spread = [], [], 0.0
    cosines = cosines_between(columns)
    for rows in islands(cosines):
        # the gradients of one island span a small subspace, in which its impacts are computed
        basis, R = np.linalg.qr(columns[:, rows])
        start = basis.T @ before
        if condition_12_violation(cosines[np.ix_(rows, rows)], e[rows], 0.0).any():
            found, reason = _single_impacts(R, e[rows], start, scale, most)
        else:
            # the percussions of single impacts then only grow, towards the least with which no row closes: the law's
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


def _single_impacts(R: Array, e: Array, start: Array, scale: float, most: int) -> tuple[list[Array], str]:
    """Return the velocities after all sequences of single impacts, and why the search is incomplete, or "".

    Parameters
    ----------
    R : ndarray, shape (r, k)
        Unit gradients, one a column, in coordinates where M is the identity.
    e : ndarray, shape (k,)
        Restitution.
    start : ndarray, shape (r,)
        Velocity before.
    scale : float
        Kinetic norm of the whole velocity.
    most : int
        Single impacts after which the search ends.
    """
    still, seen = _STILL * scale, _KnownPoints(_SAME_STATE * scale, len(start))
    most = min(most, max(100, _MOST_WORK // R.size))
    pending, ends, count = deque[tuple[int, int]](), list[Array](), 0
    # the states that follow each state by one single impact
    followers: dict[int, list[int]] = {}

    def visit(z: Array) -> int:
        """Return the number of a state; if it is new, add its closing rows to `pending`."""
        number, new = seen.add(z)
        if new:
            followers[number] = []
            rates = z @ R
            closing = np.flatnonzero(rates < -still)
            if not closing.size:
                ends.append(z)
            # the fastest row is followed at once, so that some sequence ends early; the others wait, shortest first
            order = closing[np.argsort(rates[closing], kind="stable")].tolist()
            pending.extendleft((number, a) for a in order[:1])
            pending.extend((number, a) for a in order[1:])
        return number

    visit(start)
    while pending and count < most:
        number, a = pending.popleft()
        z = seen.points[number]
        followers[number].append(visit(z - (1.0 + e[a]) * (z @ R[:, a]) * R[:, a]))
        count += 1
    closing_still = max((-float(seen.points[number] @ R[:, a]) for number, a in pending), default=0.0)
    outcomes = _KnownPoints(_SAME_OUTCOME * scale, len(start))
    ends = [z for z in ends if outcomes.add(z)[1]]
    if pending:
        return ends, (
            f"the search was ended after {count} single impacts, with rows still closing at up to {closing_still:.3g} "
            "in the kinetic norm"
        )
    if _has_cycle(followers):
        return ends, "a sequence of single impacts returns to an earlier velocity and repeats without end"
    return ends, ""


def _has_cycle(followers: dict[int, list[int]]) -> bool:
    """Return whether a directed graph has a cycle: whether removing nodes without predecessors leaves some."""
    predecessors = dict.fromkeys(followers, 0)
    for numbers in followers.values():
        for number in numbers:
            predecessors[number] += 1
    removed = [number for number, count in predecessors.items() if not count]
    for number in removed:
        for following in followers[number]:
            predecessors[following] -= 1
            if not predecessors[following]:
                removed.append(following)
    return len(removed) < len(followers)


def _diameter(points: Array) -> float:
    """Return the largest distance between two points."""
    return max(float(np.linalg.norm(points - z, axis=1).max()) for z in points)


class _KnownPoints:
    """A list of points without duplicates within a tolerance.

    Points are sorted into cells of their coordinate along a random direction, so that few are compared.
    """

    def __init__(self, tolerance: float, size: int) -> None:
        self._tolerance = max(tolerance, 1e-300)
        direction = np.random.default_rng(0).normal(size=size)
        self._direction = direction / max(float(np.linalg.norm(direction)), 1e-300)
        self._cells: defaultdict[int, list[int]] = defaultdict(list)
        self.points: list[Array] = []

    def add(self, z: Array) -> tuple[int, bool]:
        """Return the number of a point, and whether it is new."""
        cell = int(np.floor(z @ self._direction / self._tolerance))
        for other in (cell, cell - 1, cell + 1):
            for number in self._cells.get(other, ()):
                if np.linalg.norm(self.points[number] - z) <= self._tolerance:
                    return number, False
        self._cells[cell].append(len(self.points))
        self.points.append(z)
        return len(self.points) - 1, True
