"""The robots that mbvi ships."""

from __future__ import annotations

from pathlib import Path

from ...arguments import shown
from ...errors import InputError

_PACKAGE = Path(__file__).resolve().parents[2]


def robot(name: str) -> Path:
    """Return the path of a robot that mbvi ships, for `Scene.add_urdf`.

    Parameters
    ----------
    name : str
        "arm", "biped", "double_pendulum", "hopper" or "quadruped".

    Returns
    -------
    Path
        Its URDF.

    Raises
    ------
    InputError
        If no robot has that name.
    """
    known = shipped_robots()
    if not isinstance(name, str) or name not in known:
        raise InputError(f"no shipped robot {shown(name)}; known are {', '.join(sorted(known)) or 'none'}")
    return known[name]


def shipped_robots() -> dict[str, Path]:
    """Return the URDFs of all shipped robots by their names."""
    # a wheel has the robots inside the package, a clone beside it
    folders = [folder for folder in (_PACKAGE.parent / "robots", _PACKAGE / "robots") if folder.is_dir()]
    return {file.stem: file for folder in folders for file in folder.glob("*/*.urdf")}
