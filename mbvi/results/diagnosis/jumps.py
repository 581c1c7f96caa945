"""Finds steps with friction in which a velocity jumps although no contact approaches.

Without friction the law is a projection: what changes in a step is at most what forces and closing speeds change. With
friction there may be more. In Painlevé's configuration only a percussion stops what slides. Elsewhere Coulomb's law has
several solutions, and a run leaves the one that it followed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from ...system.free.sparse_rows import dense

if TYPE_CHECKING:
    from ...constraints import Rows
    from ...problem import Problem
    from ...projection import Metric
    from ...schemes import Step

Array = np.ndarray

# a step is looked at if a part of the system changes its velocity by more than so many times what it changed in the
# step before and what its forces changed since; steps of regular motion do not
_SUDDEN = 2.0
# changes below this part of what the forces alone would change count as none
_LITTLE = 1e-3
# percussion and jump that exceed those of the frictionless law so many times have no cause in forces and approaches;
# the coupling of one contact exceeds it where mu |G_nt| > 0.9 G_nn
_BEYOND = 10.0
# speeds of approach and of slip that count as none, errors of a second solution, which hold those of the velocities
# of a run (1e-6 at each contact), and its least distance from that of the run; all relative to the largest change by
# forces
_APPROACH, _STILL, _ERROR, _OTHER = 0.05, 1e-3, 2e-5, 1e-4
# directions in which a sticking contact may be held; most changes of the directions of slip, and angle at their end
_DIRECTIONS, _TURNS, _TURNED = 16, 20, 1e-6


@dataclass(frozen=True)
class Jump:
    """A step in which velocities jump though no contact approaches.

    Attributes
    ----------
    time : float
        End of the step [s].
    constraints : tuple of str
        The contacts and limits that bear, among those of bodies that touch each other.
    change : float
        Largest change of a velocity at these contacts [m/s].
    second_solution : bool
        Whether Coulomb's law has another solution here, with which all contacts would go on as before. If False, none
        was found, and the percussion exceeds many times what forces and closing speeds explain.
    """

    time: float
    constraints: tuple[str, ...]
    change: float
    second_solution: bool


class _Contacts(NamedTuple):
    """Contacts of bodies that touch each other; velocities have a normal and two tangents, shape (k, 3).

    `wide` holds their whitened rows, shape (3 k, nv), and `free`, `before`, `after` the velocities that forces alone
    lead to, before and after the step; `least` the normal speeds that the law demands, `closed` which have no gap.
    """

    wide: Array
    mu: Array
    free: Array
    before: Array
    after: Array
    least: Array
    closed: Array


class Jumps:
    """Looks for jumps, one state after the other.

    Parameters
    ----------
    problem : Problem
        The problem that was run.
    """

    def __init__(self, problem: Problem) -> None:
        self._problem, self._parts = problem, problem.constraints.part
        self._changed, self._pushed = np.zeros(self._parts[-1] + 1), np.zeros(problem.system.nv)
        self.found: list[Jump] = []

    def add(
        self, t: float, before: Array, after: Array, metric: Metric, impulse: Array, away: float,
        step: Callable[[], Step | None],
    ) -> None:  # fmt: skip
        """Look at a step that ends at t.

        Parameters
        ----------
        before, after : ndarray, shape (nv,)
            Velocities.
        metric : Metric
            Of the step.
        impulse : ndarray, shape (nv,)
            Of the forces within the step.
        away : float
            Time from where the law acted to the end of the step [s].
        step : function
            Takes the step again; returns None if it is not solved.
        """
        change, pushed = metric.whiten(metric.apply(after - before)), metric.whiten(impulse)
        changed, explained = self._norms(change), self._changed + self._norms(pushed - self._pushed)
        sudden = (changed > _SUDDEN * explained) & (changed > _LITTLE * self._norms(pushed))
        self._changed, self._pushed = changed, pushed
        if not sudden.any():
            return
        again = step()
        if again is None or again.slip is None or not (again.percussion > 0.0).any():
            return
        active, rows = again.active, _whitened(metric, again.active)
        same = np.abs(after - again.v).max() <= 1e-6 * np.abs(after - before).max()
        _, label = connected_components(abs(csr_array(rows)) @ abs(csr_array(rows)).T, directed=False)
        acts = self._norms(rows) > 0.0
        for group in np.unique(label[::3]):
            some = label[::3] == group
            wide = rows[np.repeat(some, 3)]
            if not acts[np.repeat(some, 3)][:, sudden].any():
                continue
            contacts = _contacts(self._problem, again, after, away, wide, some)
            touched = wide.any(axis=0)
            strange = same and _beyond(contacts, again.percussion[some], change[touched], pushed[touched])
            other = _goes_on(contacts)
            if strange or other:
                bears = some & (again.percussion > 0.0)
                names = dict.fromkeys(map(self._problem.constraints.name, active.constraint[bears].tolist()))
                jump = float(np.linalg.norm(contacts.after - contacts.before, axis=1).max())
                self.found.append(Jump(t, tuple(names), jump, other))

    def _norms(self, whitened: Array) -> Array:
        """Return the norms of each part of the system, shape (..., n)."""
        squares = np.atleast_2d(whitened) ** 2
        sums = np.zeros((len(squares), self._parts[-1] + 1))
        np.add.at(sums.T, self._parts, squares.T)
        return np.sqrt(sums if whitened.ndim == 2 else sums[0])


def _whitened(metric: Metric, active: Rows) -> Array:
    """Return whitened rows, each normal followed by its tangents, shape (3 k, nv)."""
    assert active.tangents is not None
    J, T = dense(active.jacobian), dense(active.tangents.jacobian)
    wide = np.concatenate([J[:, None], T.reshape(len(J), 2, -1)], axis=1).reshape(3 * len(J), -1)
    return metric.whiten(wide.T).T


def _contacts(problem: Problem, step: Step, v: Array, away: float, wide: Array, some: Array) -> _Contacts:
    """Return some contacts of a step that ended with the velocity v, `away` [s] after the law acted."""
    active = step.active
    assert active.tangents is not None and step.slip is not None
    speeds = np.concatenate([step.rates[1:, :, None], step.slip[1:]], axis=2)
    after = np.column_stack([active.speeds(v), active.tangents.slip(v)])
    least = -active.restitution * step.before
    # the law acted before the step was over
    gap = active.gap - away * step.after
    closed = problem.constraints.levers(active.constraint) * gap <= problem.tolerance
    mu = active.tangents.friction
    return _Contacts(wide, mu[some], speeds[0][some], speeds[2][some], after[some], least[some], closed[some])


def _beyond(contacts: _Contacts, percussion: Array, change: Array, pushed: Array) -> bool:
    """Return whether percussions and jump exceed those of the frictionless law, which stops what approaches."""
    # imported here for its weight
    from scipy.optimize import nnls

    normals = contacts.wide[::3]
    # whitened velocities with these normal speeds
    needed = np.linalg.lstsq(normals, contacts.least - contacts.free[:, 0])[0]
    smooth, _ = nnls(normals.T, needed)
    explained = np.linalg.norm(pushed) + np.linalg.norm(smooth @ normals)
    return bool(percussion.sum() > _BEYOND * smooth.sum() and np.linalg.norm(change) > _BEYOND * explained)


def _goes_on(contacts: _Contacts) -> bool:
    """Return whether a solution of Coulomb's law keeps all contacts as they are, and the step took another.

    Contacts that are closed and do not part stay closed, those that stick go on sticking, and those that slip go on
    slipping: the percussions of these cases are a cone, in which those are sought that leave no error.
    """
    mu, free, before, after = contacts.mu, contacts.free, contacts.before, contacts.after
    unit = np.abs(free - before).max()
    held = contacts.closed & (before[:, 0] <= _APPROACH * unit)
    if (before[:, 0] < -_APPROACH * unit).any() or not held.any():
        return False
    slips = held & (mu > 0.0) & (np.linalg.norm(before[:, 1:], axis=1) > _STILL * unit)
    slip = before[:, 1:]
    for _ in range(_TURNS):
        other, left = _with_cases(contacts, held, slips, slip)
        across, along = np.abs(slip[:, 0] * other[:, 2] - slip[:, 1] * other[:, 1]), np.vecdot(slip, other[:, 1:])
        if left > _ERROR * unit or (along[slips] <= 0.0).any():
            return False
        slip = other[:, 1:]
        if (across[slips] <= _TURNED * along[slips]).all():
            parts = held | (other[:, 0] >= np.minimum(after[:, 0], contacts.least) - _ERROR * unit)
            return bool(parts.all() and np.abs(other - after).max() > _OTHER * unit)
    return False


def _with_cases(contacts: _Contacts, held: Array, slips: Array, slip: Array) -> tuple[Array, float]:
    """Return velocities where some contacts are held closed, and of them some slip, others stick; and the error left.

    Friction acts against `slip`.
    """
    from scipy.optimize import nnls

    wide, mu, columns, equations = contacts.wide, contacts.mu, [], []
    for a in np.flatnonzero(held):
        directions = _directions(slip[a] if slips[a] else None, mu[a])
        columns.append(np.hstack([np.ones((len(directions), 1)), -mu[a] * directions]) @ wide[3 * a : 3 * a + 3])
        equations += [3 * a] if slips[a] or mu[a] == 0.0 else [3 * a, 3 * a + 1, 3 * a + 2]
    pushes = np.concatenate(columns).T
    wanted = np.zeros_like(contacts.free)
    wanted[:, 0] = contacts.least
    weights, left = nnls(wide[equations] @ pushes, (wanted - contacts.free).ravel()[equations])
    return contacts.free + (wide @ (pushes @ weights)).reshape(-1, 3), left


def _directions(slip: Array | None, mu: float) -> Array:
    """Return unit directions in which a contact may slip, against which friction acts; all if it sticks."""
    if mu == 0.0:
        return np.zeros((1, 2))
    if slip is not None:
        return (slip / np.linalg.norm(slip))[None]
    angles = np.arange(_DIRECTIONS) * 2.0 * np.pi / _DIRECTIONS
    return np.column_stack([np.cos(angles), np.sin(angles)])
