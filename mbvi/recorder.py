"""Keeps what a run leaves behind, and tells an impact from a contact that merely goes on pressing."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np

from .compiled import kernel
from .errors import MbviWarning
from .problem import Problem
from .schemes import Scheme, Step
from .schemes.step import STILL, closes
from .trajectory import Array, Impact, Trajectory

# two contact points of one pair nearer than this, in lengths of the scene, are the same point a step later
_SAME_POINT = 0.1
# the rows before the first step: numbers, points, rates
_NOTHING = np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros((4, 0))
# a run may repeat itself at every step
_MOST_NOTES = 20


def _note_plain(k: int, gap: Array, rates: Array, residual: float, penetration: Array, residuals: Array) -> bool:
    """Note the depth of step k and the largest residual since the last that was kept; tell if an impact is possible.

    One is where a row that presses approaches faster than the forces of one step explain.

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
    return bool(closes(rates).any())


@kernel("b1(i8, f8[::1], f8[:,::1], f8, f8[::1], f8[::1])", plain=_note_plain)
def _note(k: int, gap: Array, rates: Array, residual: float, penetration: Array, residuals: Array) -> bool:
    residuals[k] = max(residuals[k], residual)
    deepest, impact = 0.0, False
    for a in range(len(gap)):
        deepest = max(deepest, -gap[a])
        percussion, free, before = rates[0, a], rates[1, a], rates[3, a]
        impact = impact or (percussion > 0.0 and before + 2.0 * abs(free - before) < -STILL)
    penetration[k] = deepest
    return impact


def _struck_plain(
    number: Array, point: Array, rates: Array, e: Array,
    last_number: Array, last_point: Array, last_rates: Array, far: float, chosen: Array,
) -> tuple[int, float]:  # fmt: skip
    """Choose the rows of an impact, if there is one, and add up its energy.

    A row closes when it presses, approaches faster than the forces of one step explain and did not press just before.
    Where one does, all that press more than twice as hard as the step before take part.

    Parameters
    ----------
    number, point, rates, e
        Constraints, contact points, rates and restitution of a step's rows.
    last_number, last_point, last_rates
        Those of the step before, numbers ascending.
    far : float
        Points of one constraint farther apart than this are not the same [m].
    chosen : ndarray of bool, shape (k,)
        Receives which rows take part.

    Returns
    -------
    count : int
        How many rows take part; 0 if nothing closes.
    energy : float
        Kinetic energy gained by the law (8) [J]; see `Impact`.
    """
    percussion, free, after, before = rates
    # every row now beside every row of the same constraint that pressed then
    then = np.flatnonzero(last_rates[0] > 0.0)
    then = then[np.argsort(last_number[then], kind="stable")]
    first, end = (np.searchsorted(last_number[then], number, side) for side in ("left", "right"))
    row = np.repeat(np.arange(len(number)), end - first)
    other = then[np.arange(len(row)) + np.repeat(first - np.cumsum(end - first) + end - first, end - first)]
    shift = last_point[other] - point[row]
    # limits have no points: NaN is near
    near = ~(np.vecdot(shift, shift) > far**2)
    pressed = np.bincount(row[near], last_rates[0, other[near]], minlength=len(number))
    closing = closes(rates) & (pressed == 0.0)
    chosen[:] = (percussion > 0.0) & (percussion > 2.0 * pressed) & closing.any()
    pushed = (free - before) * (1.0 - e) / (1.0 + e)
    return int(chosen.sum()), 0.5 * float(percussion @ (before + after + pushed))


@kernel(
    "Tuple((i8, f8))(i8[::1], f8[:,::1], f8[:,::1], f8[::1], i8[::1], f8[:,::1], f8[:,::1], f8, b1[::1])",
    plain=_struck_plain,
)
def _struck(
    number: Array, point: Array, rates: Array, e: Array,
    last_number: Array, last_point: Array, last_rates: Array, far: float, chosen: Array,
) -> tuple[int, float]:  # fmt: skip
    count, energy, closes = 0, 0.0, False
    for a in range(len(number)):
        percussion, free, after, before = rates[0, a], rates[1, a], rates[2, a], rates[3, a]
        energy += 0.5 * percussion * (before + after + (free - before) * (1.0 - e[a]) / (1.0 + e[a]))
        pressed = 0.0
        if percussion > 0.0:
            for b in range(np.searchsorted(last_number, number[a]), len(last_number)):
                if last_number[b] != number[a]:
                    break
                if last_rates[0, b] > 0.0:
                    apart = 0.0
                    for c in range(3):
                        apart += (last_point[b, c] - point[a, c]) ** 2
                    # limits have no points: NaN is near
                    if not apart > far * far:
                        pressed += last_rates[0, b]
        closes = closes or (percussion > 0.0 and pressed == 0.0 and before + 2.0 * abs(free - before) < -STILL)
        chosen[a] = percussion > 0.0 and percussion > 2.0 * pressed
        count += chosen[a]
    if not closes:
        for a in range(len(number)):
            chosen[a] = False
        return 0, energy
    return count, energy


class Recorder:
    """States in arrays made once, impacts in a list.

    Parameters
    ----------
    problem : Problem
        What runs.
    count : int
        How many states there will be.
    jump : float
        That of the scheme.
    notes : sequence of str
        What is known before the run.
    """

    def __init__(self, problem: Problem, count: int, jump: float = 1.0, notes: Sequence[str] = ()) -> None:
        self.problem = problem
        self.jump = jump
        self.t = np.empty(count)
        self.q = np.empty((count, problem.system.nq))
        self.v = np.empty((count, problem.system.nv))
        self.penetration = np.zeros(count)
        self.residual = np.zeros(count)
        self.dense = None
        self.impacts: list[Impact] = []
        self.notes = list(notes)
        self._warned = False
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

    def trajectory(self, scheme: Scheme, h: float) -> Trajectory:
        """Return what was recorded."""
        return Trajectory(
            self.t,
            self.q,
            self.v,
            tuple(self.impacts),
            self.residual,
            type(scheme).__name__,
            h,
            tuple(self.notes),
            self.problem,
            True,
            self.penetration,
            _scheme=scheme,
            _jump=self.jump,
        )

    def _impact(self, step: Step) -> None:
        """Record an instant at which a constraint closed, with all that passed the blow on."""
        active, rates, last = step.active, step.rates, self._last
        number, point, e = active.constraint, active.point, active.restitution
        chosen = np.empty(len(number), bool)
        before, places, pressed = _NOTHING if last is None else (last.active.constraint, last.active.point, last.rates)
        if (before[1:] < before[:-1]).any():
            order = np.argsort(before, kind="stable")
            before, places, pressed = before[order], places[order], np.ascontiguousarray(pressed[:, order])
        far = _SAME_POINT * self.problem.length
        count, energy = _struck(number, point, rates, e, before, places, pressed, far, chosen)
        if not count:
            return
        scale = step.percussion @ (np.abs(step.before) + np.abs(step.after))
        if energy > 1e-9 * scale and e.min() < e.max():
            self._say(
                f"at t = {step.t:.6g} s a simultaneous impact with different restitutions raised the energy by "
                f"{energy:.3g} J: Newton's law with several e promises no loss"
            )
        names = tuple(map(self.problem.constraints.name, number[chosen].tolist()))
        percussion, _, after, speed = rates[:, chosen]
        self.impacts.append(
            Impact(step.t, names, percussion, speed, after, point[chosen], active.normal[chosen], energy)
        )

    def _say(self, note: str) -> None:
        if not self._warned:
            self._warned = True
            warnings.warn(note, MbviWarning, stacklevel=6)
        if len(self.notes) < _MOST_NOTES:
            self.notes.append(note)
