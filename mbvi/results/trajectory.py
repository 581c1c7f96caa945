"""The result of a run as users see it: states, impacts, energies, contacts, files and replays."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, overload

import numpy as np

from ..arguments import between, choice, file_path, number, positive
from ..errors import InputError
from .contact_forces import ContactNames, durations, force_on, forces_between, recorded_contacts
from .diagnose import diagnose, given_or_computed
from .energies import energies_of_run, projection_energies
from .export import export
from .hdf5 import save
from .run_data import Array, RunData
from .summary import impact_table, notebook, summary
from .tables import to_pandas, to_xarray

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.figure import Figure

    from ..constraints.contact import Contact
    from .diagnosis import Diagnosis


@dataclass(frozen=True)
class Trajectory(RunData):
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
        The problem that was simulated; None where a file could not bring it back.
    complete : bool
        Whether the run reached its end; False for the file of an interrupted run.
    record : RunRecord
        The scheme object and its timing, dense output and recorded contacts.
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
        """Return the deepest penetration at each time, shape (n + 1,), >= 0 [m or rad]."""
        return self.record.penetration

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
            added up; force is the mean over the interval. Under `EventDriven` it is that of the smooth motion, and
            percussions of impacts are in `impacts` only.

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
            `EventDriven`, row i repeats the row before. Contacts between parts of the named thing cancel. Joint limits
            and given functions do not count.

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

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the run and its problem to an HDF5 file.

        Raises
        ------
        TrajectoryFileError
            If the file cannot be written.
        """
        save(self, file_path(path))

    def replay(self, speed: float = 1.0, shapes: str = "visual") -> None:
        """Show the run in a browser; returns when the browser has the page, which it can reopen while the program runs.

        Parameters
        ----------
        speed : float
            Seconds of the run per second of the replay, until the user chooses another.
        shapes : "visual" or "collision"
            As for `replay_html`.

        Raises
        ------
        InputError
            If the run has no scene to show, the speed is not positive, or `shapes` is another word.
        """
        from .replay.live import replay

        shown = choice(shapes, "shapes", ("visual", "collision"))
        replay(self, speed=between(positive(speed, "speed"), "speed", 1e-6, 1e6), shapes=shown)

    def replay_video(
        self,
        path: str | os.PathLike[str],
        t: float | tuple[float, float] | None = None,
        speed: float = 1.0,
        shapes: str = "visual",
    ) -> None:
        """Write a picture (.png) or a video (.mp4, .gif) of the replay, by an installed Chromium.

        Parameters
        ----------
        path : path
            The file; its name ends with .png, .gif or .mp4. A .mp4 needs ffmpeg, a .gif pillow or ffmpeg.
        t : float or pair of float, optional
            Of a picture its instant, the last one by default; of a video its first and last instant, the whole run by
            default [s].
        speed : float
            Seconds of the run per second of the video.
        shapes : "visual" or "collision"
            As for `replay_html`.

        Raises
        ------
        InputError
            If the run has no scene to show, `t` lies outside the run, the name ends otherwise, or Chromium or ffmpeg is
            not installed.
        TrajectoryFileError
            If the file cannot be written.
        """
        from .replay.video import replay_video

        if isinstance(t, tuple | list):
            if len(t) != 2:
                raise InputError(f"t of a video is a pair, its first and its last instant; got {t}")
            span: float | tuple[float, float] | None = (number(t[0], "t"), number(t[1], "t"))
        else:
            span = None if t is None else number(t, "t")
        rate = between(positive(speed, "speed"), "speed", 1e-6, 1e6)
        replay_video(self, file_path(path), span, rate, choice(shapes, "shapes", ("visual", "collision")))

    def replay_html(self, path: str | os.PathLike[str], shapes: str = "visual") -> None:
        """Write one HTML page that plays the run without a server or a network.

        Parameters
        ----------
        path : path
            The page; an old one is replaced.
        shapes : "visual" or "collision"
            Whether robots show at first the visual shapes of their URDFs or the collision shapes that impacts happen
            on; a button of the page switches. A robot without visual shapes shows its collision shapes, and so does one
            whose mesh files cannot be read any more, with an `MbviWarning`. The colours of a DAE or OBJ file go before
            those of the URDF.

        Raises
        ------
        InputError
            If the run has no scene to show, or `shapes` is another word.
        TrajectoryFileError
            If the page cannot be written.
        """
        from .replay.replay import replay_html

        replay_html(self, file_path(path), choice(shapes, "shapes", ("visual", "collision")))

    def report(self, path: str | os.PathLike[str], diagnosis: Diagnosis | None = None) -> None:
        """Write one HTML page about the run, without a server or a network: replay, plots, impacts, diagnosis, model.

        The plots are energies, percussions, gaps, penetration, closed contacts, kinetic angles, and with friction
        the ratio |p_t| / p and the slip. Of long runs they show the least and the greatest value in each of 1000
        intervals of time. The page holds the initial state as a file, from which the run can be made again.

        Parameters
        ----------
        path : path
            The page; an old one is replaced.
        diagnosis : Diagnosis, optional
            What `diagnosis()` returned. By default it is computed, unless more than 32 constraints take part in one
            impact, where it may cost much more than the run.

        Raises
        ------
        InputError
            If an argument is of another kind.
        TrajectoryFileError
            If the page cannot be written.
        """
        from .report.page import write_report

        write_report(self, file_path(path), self.replay_html, *given_or_computed(self, diagnosis))

    def plot(self, diagnosis: Diagnosis | None = None) -> Figure:
        """Return the plots of `report` as a matplotlib figure; `diagnosis` is as there.

        Raises
        ------
        InputError
            If matplotlib is not installed, the run has one state only, or the argument is of another kind.
        """
        from .plots.figure import figure

        return figure(self, *given_or_computed(self, diagnosis))

    def to_pandas(self, table: str = "states") -> pandas.DataFrame:
        """Return a table of the run as a DataFrame; its `attrs["units"]` has the unit of each column.

        Parameters
        ----------
        table : "states", "impacts" or "contacts"
            States have the times as index "t", and the columns "q/robot/joint", "q/body/x", "v/robot/joint",
            "v/body/vx", "penetration", "residual", "energy/kinetic" and "energy/potential". Impacts and recorded
            contacts have a row for each contact point or limit.

        Raises
        ------
        InputError
            If `table` is another word, the run did not record contacts, or pandas is not installed.
        """
        return to_pandas(self, table)

    def to_xarray(self) -> xarray.Dataset:
        """Return states, impacts and recorded contacts as a Dataset.

        Its dimensions are "t", "coordinate" and "velocity", which have the names of the entries of q and v, "impact"
        and "contact", which have a row for each contact point or limit, and "axis". Units are in the variables'
        `attrs["units"]`, those of q and v along "coordinate_unit" and "velocity_unit".

        Raises
        ------
        InputError
            If xarray is not installed.
        """
        return to_xarray(self)

    def export(self, path: str | os.PathLike[str], table: str | None = None) -> None:
        """Write the run to a CSV, Parquet or MCAP file; numbers read from it have the same bits.

        Parameters
        ----------
        path : path
            A file that ends in .csv, .parquet or .mcap; an old one is replaced. CSV and Parquet hold one table with
            the columns of `to_pandas`: CSV under a header row of names with units, Parquet with units as metadata of
            the fields. MCAP, the log format of ROS 2 and Foxglove, holds states, impacts, shapes and poses.
        table : "states", "impacts" or "contacts", optional
            The table of a CSV or Parquet file, states by default.

        Raises
        ------
        InputError
            If the path has another end, `table` is another word or does not fit, the run did not record contacts, or a
            package is not installed.
        TrajectoryFileError
            If the file cannot be written.
        """
        export(self, file_path(path), table)

    def to_rerun(self, path: str | os.PathLike[str]) -> None:
        """Write the run to a file for the Rerun viewer: shapes, poses, impacts, contacts, energies and penetration.

        Parameters
        ----------
        path : path
            The file, "run.rrd"; an old one is replaced.

        Raises
        ------
        InputError
            If the run has no scene to show, or rerun-sdk is not installed.
        TrajectoryFileError
            If the file cannot be written.
        """
        from .rerun_file import write_rerun

        write_rerun(self, file_path(path))

    def impact_table(self, most: int = 20) -> str:
        """Return the impacts as a table, the `most` strongest if there are more."""
        return impact_table(self, most)
