"""Imports a file of Python that defines what a command needs."""

from __future__ import annotations

import importlib
import os
import sys
from pathlib import Path
from types import ModuleType

from ..arguments import not_found
from ..errors import InputError


def imported(path: Path) -> ModuleType:
    """Return the module of a file.

    Raises
    ------
    InputError
        If there is no such file, it has no name that can be imported, that of another module, or it raises.
    """
    if not os.path.exists(path):
        raise InputError(not_found(path))
    if path.suffix != ".py" or not path.is_file() or not path.stem.isidentifier():
        raise InputError(f"{path} must be a file of Python whose name can be imported, such as scene.py")
    # worker processes import it by its name from here
    sys.path.insert(0, str(path.resolve().parent))
    try:
        module = importlib.import_module(path.stem)
    except Exception as error:
        raise InputError(f"{path} cannot be imported: {type(error).__name__}: {error}") from error
    if Path(str(module.__file__)).resolve() != path.resolve():
        raise InputError(f"{path} has the name of another module, {module.__file__}: rename it")
    return module
