"""The folder in which mbvi keeps what it has computed for this machine: compiled kernels and the results of checks."""

from __future__ import annotations

import os
import stat
import sys
import tempfile
from pathlib import Path


def cache_folder() -> Path:
    """Return the folder: NUMBA_CACHE_DIR where it is set, else one of the user's, which all copies of mbvi share.

    Where nothing can be kept in the user's folder it is one beside this file, or else one of temporary files.
    """
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    if chosen:
        return Path(chosen)
    beside = Path(__file__).parent / "__pycache__"
    for place in (_folder_of_user, lambda: beside, _temporary_folder):
        try:
            folder = place()
            folder.mkdir(parents=True, exist_ok=True)
            # what was filled before it became read-only serves as well
            if os.access(folder, os.W_OK) or any(folder.glob("*.nbi")):
                return folder
        except (OSError, RuntimeError):
            # RuntimeError: the user has no home
            continue
    return beside


def _folder_of_user() -> Path:
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData/Local")
    elif sys.platform == "darwin":
        base = Path.home() / "Library/Caches"
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base / "mbvi"


def _temporary_folder() -> Path:
    """Return a folder that the user alone can write to: what is in it is run."""
    if sys.platform == "win32":
        # temporary files are the user's own there
        return Path(tempfile.gettempdir(), "mbvi")
    folder = Path(tempfile.gettempdir(), f"mbvi-{os.getuid()}")
    folder.mkdir(mode=0o700, exist_ok=True)
    # of a link, not of where it leads
    found = folder.lstat()
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid() or stat.S_IMODE(found.st_mode) & 0o077:
        raise PermissionError(f"{folder} is not the user's own")
    return folder
