"""The folder of a study: what is studied, in `study.json`; its functions; rows and kept runs."""

from __future__ import annotations

import contextlib
import fcntl
import inspect
import json
import os
import pickle
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

from ..arguments import shown
from ..errors import InputError, TrajectoryFileError
from ..results.files.versions import versions
from .fingerprint import digest
from .points import Points

# the one before had rows without checksums
FORMAT = "mbvi study 2"
_KINDS = {"runs": int, "seed": int, "keep": str, "names": list, "grid": bool, "versions": dict}
_FILE, _FUNCTIONS, _POINTS, _LOCK = "study.json", "functions.pkl", "points.pkl", "study.lock"


@dataclass(frozen=True)
class Study:
    """What decides about the rows of a study.

    Attributes
    ----------
    make, measure : callable
        Functions of a point and of a run.
    seed : int
        Seed of all random numbers.
    keep : str
        Which runs are kept as files: "none", "failed" or "all".
    budget : float or None
        CPU time that a run may cost [s].
    options : dict
        Options of `simulate`.
    """

    make: Callable[..., Any]
    measure: Callable[..., Any]
    seed: int = 0
    keep: str = "none"
    budget: float | None = None
    options: Mapping[str, Any] = field(default_factory=dict)

    def identity(self, points: Points) -> dict[str, Any]:
        """Return what two calls must have in common to write into one folder, as JSON."""
        return {
            "format": FORMAT,
            "make": digest(self.make),
            "measure": digest(self.measure),
            "parameters": points.digest(),
            "runs": len(points),
            "seed": self.seed,
            "keep": self.keep,
            "budget": self.budget,
            "options": {name: _option(value) for name, value in sorted(self.options.items())},
            "versions": versions(),
        }


def _option(value: Any) -> Any:
    text = repr(value)
    return text if len(text) < 200 and " at 0x" not in text else digest(value)


class StudyFolder:
    """A folder that holds one study.

    Parameters
    ----------
    path : Path
        The folder; it need not exist.
    """

    def __init__(self, path: Path) -> None:
        self.path = path.absolute()
        self.rows, self.runs = self.path / "rows", self.path / "runs"

    def open(self, study: Study, points: Points) -> None:
        """Make the folder, or check that it holds this study.

        Raises
        ------
        InputError
            If it holds another study, whose difference is named, or other files. If the functions cannot be sent to
            other processes.
        TrajectoryFileError
            If it cannot be written.
        """
        identity = study.identity(points)
        if (self.path / _FILE).exists():
            self._check(identity)
            return
        packed = _pickled(study, "make, measure and the options")
        with written(self.path):
            self.path.mkdir(exist_ok=True)
            # those of a study that was killed when it began
            own = {self.rows.name, self.runs.name, _FUNCTIONS, _POINTS, _LOCK}
            other = [path.name for path in self.path.iterdir() if path.name not in own and path.suffix != ".part"]
            if other:
                raise InputError(
                    f"{self.path} is not empty and holds no study, but {shown(other[0])}: give another folder"
                )
            for folder in (self.rows, self.runs) if study.keep != "none" else (self.rows,):
                folder.mkdir(exist_ok=True)
            _write(self.path / _FUNCTIONS, packed)
            _write(self.path / _POINTS, _pickled(points, "parameters"))
            about = {**identity, "names": list(points.columns), "grid": points.grid, "module": _module_folder(study)}
            # what makes the folder a study is written last
            _write(self.path / _FILE, json.dumps(about, indent=1).encode())

    def about(self) -> dict[str, Any]:
        """Return the contents of `study.json`.

        Raises
        ------
        InputError
            If the folder holds no study.
        """
        try:
            found = json.loads((self.path / _FILE).read_bytes())
            if found["format"] != FORMAT:
                raise ValueError(f"its format is {shown(found['format'])}, not {FORMAT!r}")
            for name, kind in _KINDS.items():
                if not isinstance(found[name], kind):
                    raise ValueError(f"{name} is {shown(found[name])}")
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise InputError(f"{self.path} holds no study that mbvi.sweep wrote: {shown(error)}") from error
        return dict(found)

    def load(self) -> tuple[Study, Points]:
        """Return the study and its points, to go on with it or to repeat one of its runs.

        Raises
        ------
        InputError
            If its functions cannot be loaded, or have changed since; if it was made with other versions.
        """
        study = self.study()
        try:
            points = pickle.loads((self.path / _POINTS).read_bytes())
        except Exception as error:
            raise InputError(f"the parameters of {self.path} cannot be read: {shown(error)}") from error
        self._check(study.identity(points))
        return study, points

    def study(self) -> Study:
        """Return the study with its functions; a process loads each study once."""
        stamp = (self.path / _FUNCTIONS).stat().st_mtime_ns if (self.path / _FUNCTIONS).exists() else 0
        return _loaded(self.path, self.about().get("module"), stamp)

    def _check(self, identity: dict[str, Any]) -> None:
        found = {name: value for name, value in self.about().items() if name in identity}
        different = list(_differences(found, json.loads(json.dumps(identity))))
        if different:
            raise InputError(
                f"{self.path} holds another study: {'; '.join(different)}. Give another folder, or remove this one"
            )

    @contextlib.contextmanager
    def alone(self) -> Iterator[None]:
        """Keep other processes from running this study at the same time."""
        with contextlib.ExitStack() as stack:
            with written(self.path):
                lock = stack.enter_context(open(self.path / _LOCK, "w"))
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError as error:
                raise InputError(f"another process is running the study in {self.path}") from error
            yield


@contextlib.contextmanager
def written(path: Path) -> Iterator[None]:
    """Raise `TrajectoryFileError` where the operating system refuses to write."""
    try:
        yield
    except OSError as error:
        raise TrajectoryFileError(f"the study in {path} cannot be written: {error.strerror or error}") from error


def _differences(there: Mapping[str, Any], here: Mapping[str, Any], prefix: str = "") -> Iterator[str]:
    for name in dict.fromkeys([*there, *here]):
        old, new = there.get(name), here.get(name)
        if old == new:
            continue
        if isinstance(old, dict) and isinstance(new, dict):
            yield from _differences(old, new, "" if name == "options" else f"{name} ")
        elif name in ("make", "measure", "parameters"):
            yield f"{name} is another one there"
        else:
            yield f"{prefix}{name} is {old} there and {new} here"


def _pickled(value: Any, what: str) -> bytes:
    import cloudpickle

    try:
        found: bytes = cloudpickle.dumps(value)
    except Exception as error:
        raise InputError(f"{what} cannot be sent to other processes: {shown(error)}") from error
    return found


@lru_cache(maxsize=4)
def _loaded(path: Path, module: str | None, stamp: int) -> Study:
    if module is not None and module not in sys.path:
        sys.path.insert(0, module)
    try:
        found = pickle.loads((path / _FUNCTIONS).read_bytes())
    except Exception as error:
        raise InputError(
            f"the functions of the study in {path} cannot be loaded ({type(error).__name__}: {error}); they are "
            f"looked up in {module or 'the modules they were defined in'}"
        ) from error
    if not isinstance(found, Study):
        raise InputError(f"{path / _FUNCTIONS} holds no functions of a study")
    return found


def _module_folder(study: Study) -> str | None:
    """Return the folder of the module that defines `make`, if other processes must be told; else None."""
    name = getattr(study.make, "__module__", None)
    file = getattr(sys.modules.get(name or ""), "__file__", None)
    if name in (None, "__main__") or file is None or "." in str(name):
        return None
    folder = str(Path(inspect.getfile(sys.modules[str(name)])).resolve().parent)
    return None if "site-packages" in folder else folder


def _write(path: Path, data: bytes) -> None:
    """Write a file whole."""
    part = path.with_name(f"{path.name}.{os.getpid()}.part")
    part.write_bytes(data)
    os.replace(part, path)
