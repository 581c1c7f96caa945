"""The result of a run as users see it: states, impacts, energies, contacts, files and replays."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, overload

import numpy as np

from ..arguments import between, file_path, number
from ..errors import InputError
from .contact_forces import ContactNames, durations, force_on, forces_between, recorded_contacts
from .diagnosis.diagnose import diagnose
from .diagnosis.energies import energies_of_run, projection_energies
from .error_estimate import ErrorEstimate, estimate_error
from .files.hdf5 import save
from .loop_forces import loop_forces
from .outputs import Outputs
from .run_data import Array, by_problem
from .summary import notebook, summary

if TYPE_CHECKING:
    from ..constraints.contact import Contact
    from .diagnosis.diagnosis import Diagnosis


@dataclass(frozen=True)
class Trajectory(Outputs):
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
        Name of the scheme.
    step : float
        Time step [s]; 0 for a scheme that chooses its own steps.
    notes : tuple of str
        Notes on how to read the result.
    problem : Problem or None
        The problem that was simulated, with the connections of its start; None where a file could not bring it back.
    complete : bool
        Whether the run reached its end; False for the file of an interrupted run.
    record : RunRecord
        The scheme object and its timing, dense output, recorded contacts, and `switches` of connections.
    """

    def __repr__(self) -> str:
        """Return a summary of the run in five lines."""
        return summary(self)

    def _repr_html_(self) -> str:
        """Return the summary and the strongest impacts for a notebook."""
        return notebook(self)

    def energies(self) -> tuple[Array, Array]:
        """Return kinetic and potential energy, shapes (n + 1,) [J].

        Both are evaluated in the middle of the displacement that v_i causes, where configuration and velocity belong to
        the same time: with `Paoli` at q_i + h v_i / 2, half a step after t_i; with `Centered` and Moreau's midpoint at
        t_i; with `SchatzmanPaoli` half a step before.

        Raises
        ------
        InputError
            If the run came from a file without its problem or its energies.
        """
        both = energies_of_run(self)
        return both[:, 0], both[:, 1]

    def energy(self) -> Array:
        """Return the total energy, shape (n + 1,) [J], at the consistent times of `energies`."""
        kinetic, potential = self.energies()
        return kinetic + potential

    def projection_energy(self) -> Array:
        """Return the energy that position projection added in the step to each state, shape (n + 1,) [J].

        It is that of the displacement which moves bodies out of each other at the end of the step: it lifts them
        against gravity, and it changes M, and so the kinetic energy of the velocity, which is kept. No step of
        `Centered(project_positions=True)` with e = 0 or one e for all contacts, and without controls or moving walls,
        raises the energy by more than this and the error of the integrator. The number means nothing in steps that were
        shortened, which `notes` counts.

        Raises
        ------
        InputError
            If the run was thinned by `every`, or came from a file without its problem.
        """
        return projection_energies(self)

    def penetration(self) -> Array:
        """Return the deepest penetration of contacts since the state before, shape (n + 1,), >= 0 [m].

        It is that of the contacts of each step's law, moved to its end by their rates; with `every` that of the step
        with the deepest. Of given functions it is that of their gaps, in the functions' own units.
        """
        return self.record.penetration

    def limit_violation(self) -> Array:
        """Return the greatest violation of joint limits since the state before, shape (n + 1,), >= 0.

        With `every` it is that of the step with the greatest [rad; of sliding joints m].
        """
        return self.record.limit_violation

    def loop_gap(self) -> Array:
        """Return the largest gap of connections, couplings and mimic joints at each time, shape (n + 1,) [m, rad].

        Steps close them to rounding; 0 where the problem has none, or all are switched off.

        Raises
        ------
        InputError
            If the run came from a file without its problem.
        """
        if self.problem is None:
            raise InputError("this file holds no problem, whose loops could be measured")
        gaps = np.zeros(len(self.t))
        for problem, which in by_problem(self.problem, self.record.switches, self.t):
            gaps[which] = [np.abs(problem.system.gaps(q)).max(initial=0.0) for q in self.q[which]]
        return gaps

    def loop_forces(self, name: str) -> Array:
        """Return the forces of a connection or a coupling in each step; zero at the start.

        Means over the step that led to each state, impacts included, from the balance of its percussions. Where rows
        depend on each other they are not unique: the least ones are returned. Where joints have dry friction, so do
        its torques count. Zero while it is switched off; the percussion of switching it on is in `impacts` only.

        Parameters
        ----------
        name : str
            What `Scene.connect`, `hinge`, `weld` or `couple` returned, or "robot_joint" of a mimic joint.

        Returns
        -------
        ndarray, shape (n + 1, 6) or (n + 1,)
            Of a connection force and moment on the second body in the world, about the point that both share
            [N, N m]; of a coupling the torque or force on the first joint [N m, N]. NaN where a step was retaken.

        Raises
        ------
        InputError
            If there is none of that name, the scheme chose its own steps, or the run came from a file
            without its problem.
        """
        return loop_forces(self, name)

    def contacts(self, t: float) -> tuple[Contact, ...]:
        """Return the contacts between the recorded states before and after t, joint limits among them.

        Parameters
        ----------
        t : float
            Time [s], in [t_0, t_n]; the interval is (t_{i-1}, t_i], and at t_0 there are none.

        Returns
        -------
        tuple of Contact
            Those with a percussion in that interval: of one step, or with `every` of several, whose percussions are
            added up; force is the mean over the interval. Under `EventDriven` and `Adaptive` percussions of impacts
            are in `impacts` only, with fixed steps here too.

        Raises
        ------
        InputError
            If the run did not record contacts, or t lies outside the run.
        """
        table, t = recorded_contacts(self), number(t, "t")
        if not self.t[0] <= t <= self.t[-1]:
            raise InputError(f"t = {t} lies outside the run, [{self.t[0]:g}, {self.t[-1]:g}] s")
        i = int(np.searchsorted(self.t, t))
        return table.interval(i, float(durations(self)[i]))

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
            Force, and moment about the origin of the world, on the named thing by all its contacts [N, N m]. Without a
            name those on the first part of each pair in contact by the second, with the parts' names as in impacts.
            Row i is the mean over (t_{i-1}, t_i], as for `contacts`. Row 0 is zero; where t_i = t_{i-1}, at impacts of
            `EventDriven` and `Adaptive`, row i repeats the row before. Contacts between parts of the named thing
            cancel. Joint limits and given functions do not count.

        Raises
        ------
        InputError
            If the run did not record contacts, or nothing has that name.
        """
        table, times = recorded_contacts(self), durations(self)
        names = ContactNames(self.problem, table.names)
        return forces_between(table, names, times) if name is None else force_on(table, names, name, times)

    def diagnosis(self, tolerance: float = 1e-3) -> Diagnosis:
        """Return which results of this run may be trusted, and until when; costs about the time of the run.

        Parameters
        ----------
        tolerance : float
            Largest cosine of a kinetic angle that counts as a right angle in condition (12), and largest distance
            between the outcomes of one impact, relative to its jump, that counts as zero. A tolerance below the
            accuracy of the run shows discretisation errors, not ambiguity.

        Returns
        -------
        Diagnosis
            Instants with several active constraints, the horizon, variation and energy; printed, it is a report.

        Raises
        ------
        InputError
            If the run carries no problem, or the tolerance is not between 0 and 1.
        """
        return diagnose(self, between(tolerance, "tolerance", 0.0, 1.0, ends=False))

    def error_estimate(self) -> ErrorEstimate:
        """Return the estimated error of the configurations, and until when there is one; simulates the problem again.

        A run with fixed steps is compared with one of steps 7/65 as long, at every seventh recorded state; a run of
        `EventDriven` with one at a thousandth of its tolerance, of `Adaptive` at a hundredth. That is the error of the
        discretisation, not of the model. It exists until the first fork that `diagnosis()` finds.

        Returns
        -------
        ErrorEstimate
            Errors over time, in lengths of the scene and rad; printed, it is two sentences.

        Raises
        ------
        InputError
            If the run is not complete, carries no problem, or its file lacks functions that acted.
        UnsuitableError
            If its tolerance is below 1e-12, with `Adaptive` below 1e-5.
        ProjectionError, DivergedError
            As `simulate`, for the second run.
        """
        return estimate_error(self)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the run and its problem to an HDF5 file.

        Raises
        ------
        TrajectoryFileError
            If the file cannot be written.
        """
        save(self, file_path(path))
