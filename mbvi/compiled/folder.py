"""The folder in which mbvi keeps what it has computed for this machine: compiled kernels and the results of checks."""

from __future__ import annotations

import os
import sys
from pathlib import Path


def cache_folder() -> Path:
    """Return the folder: NUMBA_CACHE_DIR where it is set, else one of the user's, which all copies of mbvi share.

    Where the user's folder cannot be made it is one beside this file.
    """
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    if chosen:
        return Path(chosen)
    try:
        folder = _folder_of_user()
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, RuntimeError):
        # RuntimeError: the user has no home
        return Path(__file__).parent / "__pycache__"
    return folder


def _folder_of_user() -> Path:
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData/Local")
    elif sys.platform == "darwin":
        base = Path.home() / "Library/Caches"
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base / "mbvi"
