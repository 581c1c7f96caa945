"""What a run is shown in and written to: replays, reports, plots, tables and files of other programs."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..arguments import between, choice, file_path, number, positive
from ..errors import InputError
from .diagnosis.diagnose import given_or_computed
from .files.export import export
from .run_data import RunData
from .summary import impact_table
from .tables import to_pandas, to_xarray

if TYPE_CHECKING:
    import pandas
    import xarray
    from matplotlib.figure import Figure

    from .diagnosis.diagnosis import Diagnosis


@dataclass(frozen=True)
class Outputs(RunData):
    """The methods of a `Trajectory` that show it or write it for other programs."""

    def replay(self, speed: float = 1.0, shapes: str = "visual") -> None:
        """Show the run in a browser, or below the cell of a notebook.

        Returns when the browser has the page, which it can reopen while the program runs.

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
        from .replay.live import in_notebook, inline, replay

        shown = choice(shapes, "shapes", ("visual", "collision"))
        show = inline if in_notebook() else replay
        show(self, speed=between(positive(speed, "speed"), "speed", 1e-6, 1e6), shapes=shown)

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

        The plots are energies, percussions, gaps and joint limits, penetration and violation of limits, closed
        contacts, kinetic angles, and with friction the ratio |p_t| / p and the slip. Of long runs they show the least
        and the greatest value in each of 1000 intervals of time. The page holds the initial state as a file, from which
        the run can be made again.

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
            "v/body/vx", "penetration", "limit_violation", "residual", "energy/kinetic" and "energy/potential".
            Impacts and recorded contacts have a row for each contact point or limit.

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
        """Write the run to a file for the Rerun viewer: shapes, poses, impacts, contacts, energies and depths.

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
        from .files.rerun_file import write_rerun

        write_rerun(self, file_path(path))

    def impact_table(self, most: int = 20) -> str:
        """Return the impacts as a table, the `most` strongest if there are more."""
        return impact_table(self, most)
