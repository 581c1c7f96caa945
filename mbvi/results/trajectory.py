"""What happened: states, impacts, percussions, energies, penetration."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from ..arguments import between, choice, file_path, integer, number, positive
from ..errors import InputError

if TYPE_CHECKING:
    from ..constraints.contact import Contact
    from ..problem import Problem
    from ..schemes import EventDriven, Scheme
    from .contacts import ContactTable
    from .diagnosis import Diagnosis

Array = np.ndarray


@dataclass(frozen=True)
class Impact:
    """One instant at which the velocity jumped, with every constraint that took part.

    Attributes
    ----------
    time : float
        When [s].
    constraints : tuple of str, length k
        Names, one a contact point or limit.
    percussion : ndarray, shape (k,)
        p >= 0 along each gradient [N s, N m s].
    before, after : ndarray, shape (k,)
        Normal velocity, negative when closing [m/s, rad/s].
    point, normal : ndarray, shape (k, 3)
        Contact point and unit normal in the world [m]; NaN where the constraint is no contact.
    energy_change : float
        Kinetic energy gained by the law (8) at this instant [J], never positive for one e: the sum over all pressing
        rows of p (1 - e) / 2 times the normal velocity that the law acts on, J v with 1 / (1 + e) of the step's force.
    """

    time: float
    constraints: tuple[str, ...]
    percussion: Array
    before: Array
    after: Array
    point: Array
    normal: Array
    energy_change: float


@dataclass(frozen=True)
class Trajectory:
    """The result of a run; arrays are read-only.

    Attributes
    ----------
    t : ndarray, shape (n + 1,)
        Times [s].
    q : ndarray, shape (n + 1, nq)
        Configurations.
    v : ndarray, shape (n + 1, nv)
        Velocities, each on [t_i, t_{i+1}).
    impacts : tuple of Impact
        Jumps of the velocity, in order.
    residual : ndarray, shape (n + 1,)
        Largest relative KKT residual of the projections since the state before.
    scheme : str
        Which scheme made it.
    step : float
        Its time step [s]; 0 of one that chooses its own.
    notes : tuple of str
        What a reader of the result should know.
    problem : Problem or None
        What was simulated; None where a file could not bring it back.
    complete : bool
        Whether the run reached its end; False for the file of a run that was cut off.
    """

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
    _penetration: Array = field(default_factory=lambda: np.zeros(0), repr=False)
    _energies: Array | None = field(default=None, repr=False)
    # None where a file names one that is not known
    _scheme: Scheme | EventDriven | None = field(default=None, repr=False)
    # that of the scheme
    _jump: float = field(default=1.0, repr=False)
    # polynomials of order four between the states, of schemes that give them
    _dense: Array | None = field(default=None, repr=False)
    # whether the problem lacks a control that a file could not keep
    _missing: bool = field(default=False, repr=False)
    # None where they were not recorded
    _contacts: ContactTable | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        for array in (self.t, self.q, self.v, self.residual, self._penetration):
            array.setflags(write=False)

    def __repr__(self) -> str:
        """Return in five lines what happened."""
        from .summary import summary

        return summary(self)

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        # a copied array may be written to
        self.__post_init__()

    def at(self, t: float) -> tuple[Array, Array]:
        """Return q_h(t) and v_h(t): for `Paoli` the approximants of Theorem 3.2, for `EventDriven` its dense output.

        Of a run of `EventDriven` that was thinned by `every` it is a cubic between the states kept, which keeps to the
        tolerance at these only.

        Parameters
        ----------
        t : float
            Time in [t_0, t_n] [s].

        Returns
        -------
        q : ndarray, shape (nq,)
            Between the recorded states, along the retraction: for `Paoli` q_i + (t - t_i) v_i.
        v : ndarray, shape (nv,)
            v_i until the part of the step after which the scheme lets it jump, then v_{i+1}: for `Paoli` v_i.

        Raises
        ------
        InputError
            If t lies outside the run.
        """
        t = number(t, "t")
        if not self.t[0] <= t <= self.t[-1]:
            raise InputError(f"t = {t} lies outside the run, [{self.t[0]:g}, {self.t[-1]:g}] s")
        i = int(np.searchsorted(self.t, t, side="right")) - 1
        if i == len(self.t) - 1:
            return self.q[i].copy(), self.v[i].copy()
        part = (t - self.t[i]) / (self.t[i + 1] - self.t[i])
        if self._dense is not None and self.problem is not None:
            dq, dv = (self.t[i + 1] - self.t[i]) * (self._dense[i] @ part ** np.arange(1, 1 + self._dense.shape[-1]))
            return self.problem.system.integrate(self.q[i], dq), self.v[i] + dv
        v = self.v[i + (part >= self._jump)].copy()
        if self.problem is None:
            return self.q[i] + part * (self.q[i + 1] - self.q[i]), v
        system = self.problem.system
        return system.integrate(self.q[i], part * system.difference(self.q[i], self.q[i + 1])), v

    def energies(self) -> tuple[Array, Array]:
        """Return kinetic and potential energy, shapes (n + 1,) [J].

        Both are taken in the middle of the stretch that v_i moves the configuration along, there the two belong
        together: with `Paoli` at q_i + h v_i / 2, half a step after t_i, for at t_i itself v_i is already half a step
        ahead; with `Centered` and Moreau's midpoint at t_i; with `SchatzmanPaoli` half a step before.

        Raises
        ------
        InputError
            If the run came from a file without its problem or its energies.
        """
        if self._energies is not None:
            return self._energies[:, 0].copy(), self._energies[:, 1].copy()
        if self.problem is None:
            raise InputError("this file holds neither energies nor a problem to compute them from")
        both = energies(self.problem, self.t, self.q, self.v, self.step, self._jump)
        return both[:, 0], both[:, 1]

    def _end_energies(self) -> tuple[float, float] | None:
        """Return the total energy of the first and the last state [J], None where it is not known; costs two states."""
        if self._energies is not None:
            both = self._energies[[0, -1]]
        elif self.problem is not None and len(self.t):
            ends = [0, -1]
            both = energies(self.problem, self.t[ends], self.q[ends], self.v[ends], self.step, self._jump)
        else:
            return None
        return float(both[0].sum()), float(both[1].sum())

    def energy(self) -> Array:
        """Return the total energy, shape (n + 1,) [J], at the consistent times of `energies`."""
        kinetic, potential = self.energies()
        return kinetic + potential

    def penetration(self) -> Array:
        """Return the deepest penetration at each time, shape (n + 1,), >= 0 [m or rad]."""
        return self._penetration

    def contacts(self, t: float) -> tuple[Contact, ...]:
        """Return the contacts between the recorded states before and after t, joint limits among them.

        Parameters
        ----------
        t : float
            Time in [t_0, t_n] [s]; the interval is (t_{i-1}, t_i], and at t_0 there are none.

        Returns
        -------
        tuple of Contact
            Those with a percussion in that interval: of one step, or with `every` of several, whose percussions are
            added up; force is the mean over the interval. Under `EventDriven` it is that of the smooth motion, and
            percussions of impacts are in `impacts` only.

        Raises
        ------
        InputError
            If the run did not record contacts, or t lies outside the run.
        """
        table, t = self._recorded_contacts(), number(t, "t")
        if not self.t[0] <= t <= self.t[-1]:
            raise InputError(f"t = {t} lies outside the run, [{self.t[0]:g}, {self.t[-1]:g}] s")
        i = int(np.searchsorted(self.t, t))
        return table.interval(i, float(self._durations()[i]))

    @overload
    def contact_forces(self, name: str) -> Array: ...

    @overload
    def contact_forces(self, name: None = None) -> dict[tuple[str, str], Array]: ...

    def contact_forces(self, name: str | None = None) -> Array | dict[tuple[str, str], Array]:
        """Return resultants of the contacts over time.

        Parameters
        ----------
        name : str, optional
            A robot, a link "robot/link", a body, a wall, spheres, or one of them "spheres[3]".

        Returns
        -------
        ndarray, shape (n + 1, 6), or dict of (str, str) to ndarray
            Force, and moment about the origin of the world, on what is named by all that touches it [N, N m]; with no
            name those on the first part of each pair in contact by the second, with the parts' names as in impacts.
            Row i is the mean over (t_{i-1}, t_i], as `contacts`; row 0 is zero, and where t_i = t_{i-1}, at impacts of
            `EventDriven`, it is the row before. Contacts within what is named cancel;
            joint limits and given functions are not counted.

        Raises
        ------
        InputError
            If the run did not record contacts, or nothing goes by that name.
        """
        from .contact_forces import ContactNames, force_on, forces_between

        table = self._recorded_contacts()
        names, durations = ContactNames(self.problem, table.names), self._durations()
        return forces_between(table, names, durations) if name is None else force_on(table, names, name, durations)

    def _recorded_contacts(self) -> ContactTable:
        if self._contacts is None:
            raise InputError('this run did not record contacts: simulate(..., record="contacts") does')
        return self._contacts

    def _durations(self) -> Array:
        """Return how long each interval between recorded states takes, shape (n + 1,) [s]; the first is empty."""
        durations = np.diff(self.t, prepend=self.t[:1])
        if self.step > 0.0:
            # differences of times have their rounding
            whole = self.step * np.rint(durations / self.step)
            durations = np.where(np.abs(durations - whole) < 1e-6 * self.step, whole, durations)
            if getattr(self._scheme, "whole_steps", False):
                # the last step goes on beyond the end of the run, and so do its percussions
                durations[-1:] = self.step * np.ceil(durations[-1:] / self.step)
        return durations

    def diagnosis(self, tolerance: float = 1e-3) -> Diagnosis:
        """Return what of this run may be trusted, and until when; takes about as long as the run did.

        Parameters
        ----------
        tolerance : float
            Largest cosine of a kinetic angle that counts as a right angle in condition (12), and largest distance
            between the outcomes of one impact, relative to its jump, that counts as none. Below the run's own accuracy
            it tells discretisation, not ambiguity.

        Returns
        -------
        Diagnosis
            Instants with several active constraints, the horizon, variation and energy; printed, it is a report.

        Raises
        ------
        InputError
            If the run carries no problem, or the tolerance is not between 0 and 1.
        """
        from .diagnose import diagnose

        return diagnose(self, between(tolerance, "tolerance", 0.0, 1.0, ends=False))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the run and its problem to an HDF5 file.

        Raises
        ------
        TrajectoryFileError
            If the file cannot be written.
        """
        from .hdf5 import save

        save(self, file_path(path))

    def replay(self, speed: float = 1.0, shapes: str = "visual") -> None:
        """Play the run in a browser through meshcat; `speed` 1 is true time, `shapes` is as for `replay_html`.

        Raises
        ------
        InputError
            If the run has no scene to show, the speed is not positive, or `shapes` is another word.
        """
        from .replay.replay import replay

        shown = choice(shapes, "shapes", ("visual", "collision"))
        replay(self, speed=between(positive(speed, "speed"), "speed", 1e-6, 1e6), shapes=shown)

    def replay_html(self, path: str | os.PathLike[str], shapes: str = "visual") -> None:
        """Write one page that plays the run by itself, with no server and no network.

        Parameters
        ----------
        path : path
            The page; an old one is replaced.
        shapes : "visual" or "collision"
            Whether robots show the visual shapes of their URDFs or the collision shapes that impacts happen on. A robot
            without visual shapes shows its collision shapes, and so does one whose mesh files cannot be read any more,
            with an `MbviWarning`. The colours of a DAE or OBJ file go before those of the URDF.

        Raises
        ------
        InputError
            If the run has no scene to show, or `shapes` is another word.
        TrajectoryFileError
            If the page cannot be written.
        """
        from .replay.replay import replay_html

        replay_html(self, file_path(path), choice(shapes, "shapes", ("visual", "collision")))

    def impact_table(self, most: int = 20) -> str:
        """Return the impacts as a table, the `most` strongest if there are more."""
        most = integer(most, "most")
        chosen = sorted(self.impacts, key=lambda i: -float(i.percussion.max()))[:most]
        lines = [f"{'time [s]':>10}  {'p [N s]':>10}  {'before':>9}  {'after':>9}  constraint"]
        for impact in sorted(chosen, key=lambda i: i.time):
            for k, name in enumerate(impact.constraints):
                time = f"{impact.time:10.4f}" if k == 0 else " " * 10
                lines.append(
                    f"{time}  {impact.percussion[k]:10.4g}  {impact.before[k]:9.4g}  {impact.after[k]:9.4g}  {name}"
                )
        left = len(self.impacts) - len(chosen)
        return "\n".join(lines + ([f"and {left} weaker ones"] if left else []))


def energies(problem: Problem, t: Array, q: Array, v: Array, h: float, jump: float = 1.0) -> Array:
    """Return kinetic and potential energy of each state, shape (n, 2) [J]; see `Trajectory.energies`."""
    system, values = problem.system, np.empty((len(t), 2))
    for i, (ti, qi, vi) in enumerate(zip(t, q, v, strict=True)):
        # nothing moved before the start
        shift = (jump - 0.5) * h if ti > problem.t0 else max(jump - 0.5, 0.0) * h
        middle = system.integrate(qi, shift * vi)
        values[i] = system.kinetic_energy(middle, vi), system.potential_energy(float(ti) + shift, middle)
    return values
