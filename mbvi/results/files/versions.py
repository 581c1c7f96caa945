"""The versions of the packages that numbers depend on."""

from __future__ import annotations

import platform
import sys
from functools import cache
from importlib.metadata import PackageNotFoundError, version

_PACKAGES = ("numpy", "scipy", "numba", "pin", "coal", "proxsuite")


@cache
def versions() -> dict[str, str]:
    """Return the versions of mbvi, Python and the packages that compute."""
    # the package is imported whole before any of its functions is called
    package = sys.modules[__name__.partition(".")[0]]
    found = {"mbvi": package.__version__, "python": platform.python_version()}
    for name in _PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            # installed by other means than pip
            found[name] = "unknown"
    return found
