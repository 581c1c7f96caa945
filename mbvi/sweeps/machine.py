"""The machine a run was made on."""

from __future__ import annotations

import ctypes
import platform
from functools import cache
from pathlib import Path

import numpy as np


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
