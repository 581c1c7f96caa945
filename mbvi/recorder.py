"""Keeps what a run leaves behind, and tells an impact from a contact that merely goes on pressing."""

from __future__ import annotations

import warnings

import numpy as np

from .compiled import kernel
from .errors import MbviWarning
from .problem import Problem
from .schemes import Step
from .trajectory import Array, Impact, Trajectory

# two contact points of one pair nearer than this, in lengths of the scene, are the same point a step later
_SAME_POINT = 0.1
# [m/s, rad/s]; what approaches more slowly does not close
_STILL = 1e-12
# a run may repeat itself at every step
_MOST_NOTES = 20


def _note_plain(k: int, gap: Array, rates: Array, residual: float, penetration: Array, residuals: Array) -> bool:
    """Note the depth of step k and the largest residual since the last that was kept; tell if an impact is possible.

    A row closes when it approaches faster than the forces of one step explain.

    Parameters
    ----------
    k : int
        Where to note it.
    gap, rates, residual
        Of a `Step`.
    penetration, residuals : ndarray, shape (n,)
        Where these are kept.
    """
    residuals[k] = max(residuals[k], residual)
    penetration[k] = max((-gap).max(initial=0.0), 0.0)
    percussion, free, _, before = rates
    closing = before + 2.0 * np.abs(free - before) < -_STILL
    return bool((closing & (percussion > 0.0)).any())


@kernel("b1(i8, f8[::1], f8[:,::1], f8, f8[::1], f8[::1])", plain=_note_plain)
def _note(k: int, gap: Array, rates: Array, residual: float, penetration: Array, residuals: Array) -> bool:
    residuals[k] = max(residuals[k], residual)
    deepest, impact = 0.0, False
    for a in range(len(gap)):
        deepest = max(deepest, -gap[a])
        percussion, free, before = rates[0, a], rates[1, a], rates[3, a]
        impact = impact or (percussion > 0.0 and before + 2.0 * abs(free - before) < -_STILL)
    penetration[k] = deepest
    return impact


class Recorder:
    """States in arrays made once, impacts in a list.

    Parameters
    ----------
    problem : Problem
        What runs.
    count : int
        How many states there will be.
    """

    def __init__(self, problem: Problem, count: int) -> None:
        self.problem = problem
        self.t = np.empty(count)
        self.q = np.empty((count, problem.system.nq))
        self.v = np.empty((count, problem.system.nv))
        self.penetration = np.zeros(count)
        self.residual = np.zeros(count)
        self.impacts: list[Impact] = []
        self.notes: list[str] = []
        self.count = 0
        self._last: Step | None = None

    def step(self, step: Step, keep: bool) -> None:
        """Take note of a step: its impacts always, its state if `keep`."""
        t, q, v, active, rates, residual = step
        k, gap = self.count, active.gap
        if not gap.size:
            self.penetration[k] = 0.0
        elif _note(k, gap, rates, residual, self.penetration, self.residual):
            self._impact(step)
        if keep:
            self.t[k] = t
            self.q[k] = q
            self.v[k] = v
            self.count = k + 1
        self._last = step

    def trajectory(self, scheme: str, h: float) -> Trajectory:
        """Return what was recorded."""
        return Trajectory(
            self.t,
            self.q,
            self.v,
            tuple(self.impacts),
            self.residual,
            scheme,
            h,
            tuple(self.notes),
            self.problem,
            True,
            self.penetration,
        )

    def _impact(self, step: Step) -> None:
        """Record an instant at which a constraint closed, with all that passed the blow on.

        A row closes when it approaches faster than the forces of one step explain and did not press just before. Others
        took part if they press more than twice as hard as the step before.
        """
        pressing = step.percussion > 0.0
        closing = pressing & (step.before + 2.0 * np.abs(step.free - step.before) < -_STILL)
        before = self._pressed_before(step)
        if not (closing & (before == 0.0)).any():
            return
        chosen = np.flatnonzero(pressing & (step.percussion > 2.0 * before))
        impact = self._make(step, chosen)
        scale = step.percussion @ (np.abs(step.before) + np.abs(step.after))
        if impact.energy_change > 1e-9 * scale and step.active.restitution.min() < step.active.restitution.max():
            self._say(
                f"at t = {step.t:.6g} s a simultaneous impact with different restitutions raised the energy by "
                f"{impact.energy_change:.3g} J: Newton's law with several e promises no loss"
            )
        self.impacts.append(impact)

    def _make(self, step: Step, chosen: Array) -> Impact:
        active, e = step.active, step.active.restitution
        names = tuple(self.problem.constraints.name(int(c)) for c in active.constraint[chosen])
        p, before, after = (part[chosen] for part in (step.percussion, step.before, step.after))
        pushed = (step.free - step.before) * (1.0 - e) / (1.0 + e)
        energy_change = 0.5 * float(step.percussion @ (step.before + step.after + pushed))
        return Impact(step.t, names, p, before, after, active.point[chosen], active.normal[chosen], energy_change)

    def _pressed_before(self, step: Step) -> Array:
        """Return the percussion each row had in the last step, 0 where it had none."""
        last = self._last
        if last is None or not last.percussion.any():
            return np.zeros(len(step.percussion))
        # every row now beside every row of the same constraint that pressed then
        then = np.flatnonzero(last.percussion > 0.0)
        then = then[np.argsort(last.active.constraint[then], kind="stable")]
        number = last.active.constraint[then]
        first, end = (np.searchsorted(number, step.active.constraint, side) for side in ("left", "right"))
        count = end - first
        row = np.repeat(np.arange(len(count)), count)
        other = then[np.arange(len(row)) + np.repeat(first - np.cumsum(count) + count, count)]
        shift = last.active.point[other] - step.active.point[row]
        # limits have no points: NaN is near
        near = ~(np.vecdot(shift, shift) > (_SAME_POINT * self.problem.length) ** 2)
        return np.bincount(row[near], last.percussion[other[near]], minlength=len(count))

    def _say(self, note: str) -> None:
        if not self.notes:
            warnings.warn(note, MbviWarning, stacklevel=6)
        if len(self.notes) < _MOST_NOTES:
            self.notes.append(note)
