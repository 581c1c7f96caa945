"""The machine a run was made on, and the versions that its numbers depend on."""

from __future__ import annotations

import ctypes
import platform
import sys
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np

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


@cache
def machine() -> str:
    """Return host, processor and the code that numpy's BLAS chose for it; equal processors give equal bytes."""
    return f"{platform.node()}: {_processor()}, {_blas()}"


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    return platform.processor() or platform.machine()


def _blas() -> str:
    """Return the kernels that OpenBLAS chose at its start, as "SkylakeX"."""
    for path in (Path(np.__file__).parents[1] / "numpy.libs").glob("*openblas*"):
        library = ctypes.CDLL(str(path))
        for name in ("scipy_openblas_get_corename64_", "scipy_openblas_get_corename", "openblas_get_corename"):
            if hasattr(library, name):
                corename = getattr(library, name)
                corename.restype = ctypes.c_char_p
                return f"OpenBLAS {(corename() or b'').decode()}"
    return "another BLAS"
