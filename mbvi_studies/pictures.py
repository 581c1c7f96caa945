"""Checks for pictures, made before the minutes of computing their numbers."""

from __future__ import annotations

from pathlib import Path

from mbvi.errors import InputError, TrajectoryFileError


def check_pictures(folder: Path) -> None:
    """Make the folder of a picture, and check that matplotlib is installed.

    Raises
    ------
    InputError
        If matplotlib is not installed.
    TrajectoryFileError
        If the folder cannot be made.
    """
    try:
        import matplotlib  # noqa: F401
    except ImportError as error:
        raise InputError('pictures need matplotlib: pip install "mbvi[studies]"') from error
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise TrajectoryFileError(f"the folder {folder} cannot be made: {error.strerror}") from error
