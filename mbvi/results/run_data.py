"""The data of a run: states, impacts, and the record that files, the diagnosis and contact forces read."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field
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
    """One instant at which the velocity jumped, with every constraint that took part.

    Attributes
    ----------
    time : float
        When [s].
    constraints : tuple of str, length k
        Names, one for each contact point or limit.
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
class RunRecord:
    """Everything a run keeps beside its states and impacts.

    Attributes
    ----------
    penetration : ndarray, shape (n + 1,)
        Deepest penetration of contacts at each time [m].
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
        Greatest violation of joint limits at each time [rad, of sliding joints m].
    again : callable or None
        `simulate` with the residual, depth and solver of the run; None where the run was interrupted.
    settings : Settings or None
        The inputs and torques that were set in the run; None where those of the problem are.
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
        q, v = self.q[i], self.v[np.where(part >= self.record.timing.jump, later, i)]
        inside = np.flatnonzero(later > i)
        before, after, share = q[inside], self.q[later[inside]], part[inside, None]
        if self.problem is None:
            q[inside] += share * (after - before)
        elif len(inside):
            system = self.problem.system
            q[inside] = system.integrate_each(before, share * system.difference_each(before, after))
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
            return self.problem.system.integrate(self.q[i], dq), self.v[i] + dv
        v = self.v[i + (part >= self.record.timing.jump)].copy()
        if self.problem is None:
            return self.q[i] + part * (self.q[i + 1] - self.q[i]), v
        system = self.problem.system
        return system.integrate(self.q[i], part * system.difference(self.q[i], self.q[i + 1])), v

    @property
    def lacks_functions(self) -> bool:
        """Whether a file could not keep all functions of the problem, such as controls."""
        return self.problem is not None and bool(self.problem.not_kept)
