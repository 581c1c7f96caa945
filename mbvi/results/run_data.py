"""The data of a run: states, impacts, and the record that files, the diagnosis and contact forces read."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from ..arguments import array, number
from ..errors import InputError
from ..schemes import SchemeBase, Timing

if TYPE_CHECKING:
    from ..problem import Problem
    from ..system.settings import Settings
    from .contacts import ContactTable

Array = np.ndarray


@dataclass(frozen=True)
class Impact:
    """One instant at which the velocity jumped, with the constraints that took part.

    With fixed steps a contact that was closed before is left out where its percussion in the step before was at least
    half as large, as in a strong impact in that step. Contacts of fixed steps that are recorded with
    `record="contacts"` have these percussions, too; those of `EventDriven` and `Adaptive` do not.

    Attributes
    ----------
    time : float
        When [s].
    constraints : tuple of str, length k
        Names, one for each contact point or limit. A connection that is switched on has one for its percussion and one
        for the moment about the common point, of a weld about the second body's origin; that has no point, and neither
        has a coupling, whose percussion is that on its first joint.
    percussion : ndarray, shape (k,)
        p >= 0 along each gradient [N s, N m s].
    before, after : ndarray, shape (k,)
        Normal velocity, negative when closing [m/s, rad/s].
    point, normal : ndarray, shape (k, 3)
        Contact point and unit normal in the world [m]; NaN where the constraint is no contact.
    energy_change : float
        Kinetic energy gained by the law (8) at this instant [J], never positive for one e: the sum over all active
        rows of p (1 - e) / 2 times the normal velocity that the law acts on, J v with 1 / (1 + e) of the step's force.
        With friction, half the tangential percussion times the sum of the slips under forces alone and after is added;
        the sum can then be positive where e > 0 (Kane's paradox).
    tangential : ndarray, shape (k, 3), or None
        Tangential percussions on the body that the normal points to, in the world [N s]; None in problems without
        friction, and so are all attributes below. Of a constraint without a contact point the first two entries are
        those along its tangents.
    slip_before, slip_after : ndarray, shape (k, 3), or None
        Tangential velocities of that body relative to the other, in the world [m/s]; zero where mu = 0.
    regime : tuple of str, length k, or None
        "stick", "slip", or "open" without a percussion; where mu = 0 it is "slip".
    e_used : ndarray, shape (k,), or None
        Restitution that the law was applied with.
    angular : ndarray, shape (k, 3), or None
        Percussions of torsional and rolling friction on the body that the normal points to, in the world [N m s]; None
        in problems without.
    """

    time: float
    constraints: tuple[str, ...]
    percussion: Array
    before: Array
    after: Array
    point: Array
    normal: Array
    energy_change: float
    tangential: Array | None = None
    slip_before: Array | None = None
    slip_after: Array | None = None
    regime: tuple[str, ...] | None = None
    e_used: Array | None = None
    angular: Array | None = None


@dataclass(frozen=True)
class Switch:
    """Connections that were switched at a state of a run.

    Attributes
    ----------
    time : float
        When, the time of a recorded state [s].
    connections : dict of str to bool
        Those that were switched, and whether each is on since then.
    q : ndarray, shape (nq,)
        Configuration.
    before, after : ndarray, shape (nv,)
        Velocity before and after; the recorded one is that after. With `EventDriven` contacts that close at it strike
        afterwards, with a state of their own at the same time.
    problem : Problem or None
        The problem with these connections; None where a file could not bring it back.
    """

    time: float
    connections: dict[str, bool]
    q: Array
    before: Array
    after: Array
    problem: Problem | None = field(default=None, repr=False)

    def __str__(self) -> str:
        """Return what was switched when, such as "t = 0.5 s: grasp on, magnet off"."""
        words = ", ".join(f"{name} {'on' if on else 'off'}" for name, on in self.connections.items())
        return f"t = {self.time:.6g} s: {words}"


def by_problem(problem: Problem, switches: Sequence[Switch], times: Array) -> Iterator[tuple[Problem, Array]]:
    """Yield the problem of a run with the connections that hold from some times on, and which of the times."""
    number = np.searchsorted([one.time for one in switches], times, side="right")
    for k in np.unique(number).tolist():
        found = switches[k - 1].problem if k else problem
        assert found is not None
        yield found, np.flatnonzero(number == k)


@dataclass(frozen=True)
class RunRecord:
    """Everything a run keeps beside its states and impacts.

    Attributes
    ----------
    penetration : ndarray, shape (n + 1,)
        Deepest penetration of contacts since the state before [m].
    scheme : SchemeBase or None
        The scheme object; None where a file names an unknown scheme.
    timing : Timing
        The scheme's timing, also where the scheme object is unknown.
    dense : ndarray, shape (n, 2, nv, 7), or None
        Polynomials between the states, of schemes with dense output.
    energies : ndarray, shape (n + 1, 2), or None
        Kinetic and potential energy read from a file [J].
    contacts : ContactTable or None
        None where contacts were not recorded.
    limit_violation : ndarray, shape (n + 1,)
        Greatest violation of joint limits since the state before [rad, of sliding joints m].
    again : callable or None
        `simulate` with the residual, depth and solver of the run; None where the run was interrupted.
    settings : Settings or None
        The inputs and torques that were set in the run; None where those of the problem are.
    switches : tuple of Switch
        Connections that were switched, in order.
    growth : ndarray, shape (m,), or None
        By which factor variations of the start have grown at most, at the first m times, in lengths of the scene, rad
        and seconds; of runs of `sensitivity` by all of the state. Files do not hold it.
    """

    penetration: Array = field(default_factory=lambda: np.zeros(0))
    scheme: SchemeBase | None = None
    timing: Timing = field(default_factory=Timing)
    dense: Array | None = None
    energies: Array | None = None
    contacts: ContactTable | None = None
    limit_violation: Array = field(default_factory=lambda: np.zeros(0))
    again: Callable[..., RunData] | None = None
    settings: Settings | None = None
    switches: tuple[Switch, ...] = ()
    growth: Array | None = None

    def as_set(self) -> AbstractContextManager[None]:
        """Let the inputs and torques of the run act within a block."""
        return nullcontext() if self.settings is None else self.settings.restored()


@dataclass(frozen=True)
class RunData:
    """The fields of a `Trajectory`, which documents them, and the states between them, without its other methods."""

    t: Array
    q: Array
    v: Array
    impacts: tuple[Impact, ...]
    residual: Array
    scheme: str
    step: float
    notes: tuple[str, ...] = ()
    problem: Problem | None = field(default=None, repr=False)
    complete: bool = True
    record: RunRecord = field(default_factory=RunRecord, repr=False)

    def __post_init__(self) -> None:
        for values in (self.t, self.q, self.v, self.residual, self.record.penetration, self.record.limit_violation):
            values.setflags(write=False)

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        # the arrays of a copy are writeable
        RunData.__post_init__(self)

    def at(self, t: float | Sequence[float] | Array) -> tuple[Array, Array]:
        """Return q_h(t) and v_h(t): for `Paoli` the approximants of Theorem 3.2, for others dense output.

        The dense output of `EventDriven` thinned by `every`, and that of `Adaptive`, is a cubic between the recorded
        states; thinned, it satisfies the tolerance at these only.

        Parameters
        ----------
        t : float or array_like, shape (m,)
            Time, or times in any order [s], in [t_0, t_n].

        Returns
        -------
        q : ndarray, shape (nq,) or (m, nq)
            Between the recorded states, along the retraction: for `Paoli` q_i + (t - t_i) v_i.
        v : ndarray, shape (nv,) or (m, nv)
            v_i until the part of the step after which the scheme lets it jump, then v_{i+1}: for `Paoli` v_i.

        Raises
        ------
        InputError
            If t lies outside the run, or is neither a number nor a list of numbers.
        """
        try:
            several = np.ndim(t) > 0
        except Exception:
            # `number` says what is wrong with it
            several = False
        if not several:
            return self._at(number(cast("float", t), "t"))
        if np.shape(t) == (0,):
            return np.empty((0, self.q.shape[1])), np.empty((0, self.v.shape[1]))
        times = array(t, "t", ("m",))
        if self.record.dense is None:
            return self._several(times)
        q, v = zip(*(self._at(one) for one in times.tolist()), strict=True)
        return np.array(q), np.array(v)

    def _several(self, times: Array) -> tuple[Array, Array]:
        """Return q and v at times of a run without dense output."""
        for t in (times.min(), times.max()):
            self._check(float(t))
        i = np.searchsorted(self.t, times, side="right") - 1
        later = np.minimum(i + 1, len(self.t) - 1)
        part = np.divide(times - self.t[i], self.t[later] - self.t[i], out=np.zeros(len(i)), where=later > i)
        jumped = part >= self.record.timing.jump
        q, v = self.q[i], np.where(jumped[:, None], arriving(self)[later], self.v[i])
        inside = np.flatnonzero(later > i)
        before, after, share = q[inside], self.q[later[inside]], part[inside, None]
        if self.problem is None:
            q[inside] += share * (after - before)
            return q, v
        for problem, part in by_problem(self.problem, self.record.switches, times[inside]):
            ends = before[part], after[part]
            q[inside[part]] = problem.system.integrate_each(
                ends[0], share[part] * problem.system.difference_each(*ends)
            )
        return q, v

    def _check(self, t: float) -> None:
        if not self.t[0] <= t <= self.t[-1]:
            raise InputError(f"t = {t} lies outside the run, [{self.t[0]:g}, {self.t[-1]:g}] s")

    def _at(self, t: float) -> tuple[Array, Array]:
        """Return q and v at one time."""
        self._check(t)
        i = int(np.searchsorted(self.t, t, side="right")) - 1
        if i == len(self.t) - 1:
            return self.q[i].copy(), self.v[i].copy()
        part = (t - self.t[i]) / (self.t[i + 1] - self.t[i])
        dense = self.record.dense
        if dense is not None and self.problem is not None:
            dq, dv = (self.t[i + 1] - self.t[i]) * (dense[i] @ part ** np.arange(1, 1 + dense.shape[-1]))
            system = next(by_problem(self.problem, self.record.switches, self.t[i : i + 1]))[0].system
            return system.integrate(self.q[i], dq), self.v[i] + dv
        v = self.v[i + (part >= self.record.timing.jump)].copy()
        if part >= self.record.timing.jump:
            # before what is attached there
            v = next((one.before.copy() for one in self.record.switches if one.time == self.t[i + 1]), v)
        if self.problem is None:
            return self.q[i] + part * (self.q[i + 1] - self.q[i]), v
        system = next(by_problem(self.problem, self.record.switches, np.array([t])))[0].system
        return system.integrate(self.q[i], part * system.difference(self.q[i], self.q[i + 1])), v

    @property
    def lacks_functions(self) -> bool:
        """Whether a file could not keep all functions of the problem, such as controls."""
        return self.problem is not None and bool(self.problem.not_kept)


def arriving(run: RunData) -> Array:
    """Return the velocities that the steps to the states have led to, shape (n + 1, nv).

    They are those of the states, but where bodies are attached: those before.
    """
    if not run.record.switches:
        return run.v
    found = run.v.copy()
    found[states_at_switches(run)] = [one.before for one in run.record.switches]
    return found


def states_at_switches(run: RunData) -> list[int]:
    """Return the numbers of the states from which on connections were switched.

    Schemes that locate impacts have several states at one time: an impact may come just before a switch, or follow it.
    """
    found = list[int]()
    for one in run.record.switches:
        first, end = (int(np.searchsorted(run.t, one.time, side=side)) for side in ("left", "right"))
        same = (run.v[first:end] == one.after).all(axis=1)
        found.append(first + int(same.argmax()))
    return found


def legs(run: RunData) -> Iterator[tuple[int, RunData]]:
    """Yield the parts of a run between switches as runs of their own, and the number of the first state of each.

    An impact by which bodies were attached belongs to none; one of contacts that close at it belongs to the part after
    it. Contacts, energies and dense output are left out.
    """
    record, before, impacts = run.record, arriving(run), _impacts_of_legs(run)
    starts = [0, *states_at_switches(run)]
    problems = [run.problem, *(one.problem for one in record.switches)]
    for problem, start, end, own_impacts in zip(problems, starts, [*starts[1:], len(run.t) - 1], impacts, strict=True):
        part, v = slice(start, end + 1), np.concatenate([run.v[start:end], before[end : end + 1]])
        own = replace(
            record, penetration=record.penetration[part], limit_violation=record.limit_violation[part],
            dense=None, energies=None, contacts=None, again=None, switches=(),
        )  # fmt: skip
        yield start, replace(
            run, t=run.t[part], q=run.q[part], v=v, impacts=own_impacts, residual=run.residual[part], problem=problem,
            record=own,
        )  # fmt: skip


def _impacts_of_legs(run: RunData) -> list[tuple[Impact, ...]]:
    """Return the impacts of each of `legs`."""
    found, begin = list[tuple[Impact, ...]](), 0
    for one in run.record.switches:
        at = [k for k, impact in enumerate(run.impacts) if impact.time == one.time]
        attaching = [k for k in at if set(run.impacts[k].constraints) <= set(one.connections)]
        end = int(np.searchsorted([impact.time for impact in run.impacts], one.time, side="right"))
        after = end
        if attaching:
            end, after = attaching[0], attaching[-1] + 1
        elif at and (one.before != one.after).any():
            # contacts have closed where bodies were released
            end = after = at[-1]
        found.append(run.impacts[begin:end])
        begin = after
    return [*found, run.impacts[begin:]]
