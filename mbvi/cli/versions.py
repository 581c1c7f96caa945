"""The versions of mbvi, of what it computes with, and of other engines that are installed."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version

_USED = ("pin", "coal", "proxsuite", "numpy", "scipy", "numba", "h5py", "meshcat")
_OPTIONAL = (
    "matplotlib", "mujoco", "drake", "dartpy", "pybullet", "jiminy-py", "dask", "xarray", "robot_descriptions",
)  # fmt: skip


def versions() -> str:
    """Return one line for each package that is installed; mbvi comes first."""
    from .. import __version__

    lines = [f"mbvi {__version__}", f"Python {platform.python_version()}"]
    for name in (*_USED, *_OPTIONAL):
        try:
            lines.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            continue
    return "\n".join(lines)
