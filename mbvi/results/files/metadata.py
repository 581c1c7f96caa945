"""The metadata of a trajectory file: scheme, problem, notes, and the digest of the whole file."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass, field
from typing import Any

import h5py
import numpy as np

from ...errors import TrajectoryFileError
from .columns import Array, Sums

FORMAT = "mbvi trajectory 2"
# without checksums; it loads as well
OLD_FORMAT = "mbvi trajectory 1"
_UNITS = {"q0": "m, rad, unit quaternions (x, y, z, w)", "v0": "m/s, rad/s", "restitution": "1"}


@dataclass(frozen=True)
class ProblemData:
    """A problem as a file keeps it: the scene as JSON, and the initial state.

    Attributes
    ----------
    scene : str
        The text of `scene.description.describe`.
    q0, v0, restitution : ndarray
        Those of the problem.
    t0 : float
        Initial time [s].
    length : float or None
        Length of the scene [m]; None in files of before it was kept.
    """

    scene: str
    q0: Array
    v0: Array
    restitution: Array
    t0: float
    length: float | None

    def digest(self) -> str:
        """Return a digest of all of it."""
        length = "" if self.length is None else self.length.hex()
        arrays = [np.ascontiguousarray(a, dtype="<f8").tobytes() for a in (self.q0, self.v0, self.restitution)]
        return _hash(self.scene.encode(), *arrays, self.t0.hex().encode(), length.encode())


@dataclass(frozen=True)
class Metadata:
    """How a run was made.

    Attributes
    ----------
    scheme : str
        Name of the scheme.
    options : dict
        Arguments of a scheme of the library.
    step, jump : float
        Time step [s], and the part of it after which the scheme lets v jump.
    problem : ProblemData or None
        The problem that was run.
    complete : bool
        Whether the run reached its end, and the file was read back and found right.
    notes : tuple of str
        Those of the run.
    old : bool
        Whether the file is of the format without checksums.
    switches : tuple of str
        Connections that were switched; see `switches.texts_of`.
    """

    scheme: str
    options: dict[str, Any]
    step: float
    jump: float
    problem: ProblemData | None
    complete: bool = False
    notes: tuple[str, ...] = field(default=())
    old: bool = False
    switches: tuple[str, ...] = field(default=())

    def digest(self, columns: Sums, problem: str) -> str:
        """Return a digest of all of it and of the columns; `problem` is the digest of the problem."""
        said = [self.scheme, self.options, self.step.hex(), self.jump.hex(), self.complete, self.notes, problem]
        # earlier versions had none
        said += [self.switches] if self.switches else []
        return _hash(json.dumps([said, columns], sort_keys=True).encode())

    def write(self, file: h5py.File) -> None:
        """Write it to a new file; the digest is written by `write_state`."""
        file.attrs.update({"format": FORMAT, "scheme": self.scheme, "step": self.step, "jump": self.jump})
        file.attrs["scheme_options"] = json.dumps(self.options)
        group = file.create_group("problem")
        group.attrs["description"] = "the scene as JSON (SI units), initial state, restitution and order of q and v"
        given = self.problem
        if given is None:
            return
        group.create_dataset("scene", data=np.bytes_(given.scene.encode()))
        for name, unit in _UNITS.items():
            values = getattr(given, name)
            options = {"chunks": values.shape, "fletcher32": True} if values.size else {}
            group.create_dataset(name, data=values, dtype=np.float64, **options).attrs["unit"] = unit
        group.attrs.update({"t0": given.t0, "length": given.length})

    def write_state(self, file: h5py.File, columns: Sums, problem: str) -> None:
        """Write whether the run is complete, its notes and switches, and the digest."""
        if bool(file.attrs.get("complete", not self.complete)) != self.complete:
            file.attrs["complete"] = self.complete
        for name, texts in (("notes", self.notes), ("switches", self.switches)):
            if (name == "notes" or texts) and (name not in file.attrs or tuple(file.attrs[name]) != texts):
                file.attrs.create(name, np.array(texts, dtype=object), dtype=h5py.string_dtype())
        file.attrs["digest"] = np.bytes_(self.digest(columns, problem))


def read_metadata(file: h5py.File) -> Metadata:
    """Return the metadata of a file.

    Raises
    ------
    TrajectoryFileError
        If the file is of another kind, or something is missing or of the wrong type.
    """
    attrs = file.attrs
    name = attrs.get("format")
    if not isinstance(name, str) or name not in (FORMAT, OLD_FORMAT):
        raise TrajectoryFileError("it is an HDF5 file but no mbvi trajectory")
    old = name == OLD_FORMAT
    # files of before there were several schemes have neither options nor a jump
    text = "{}" if old and "scheme_options" not in attrs else _text(attrs, "scheme_options")
    options = json.loads(text)
    if not isinstance(options, dict):
        raise TrajectoryFileError("its scheme_options are no JSON object")
    return Metadata(
        _text(attrs, "scheme"),
        options,
        _number(attrs, "step"),
        1.0 if old and "jump" not in attrs else _number(attrs, "jump"),
        _read_problem(file, old),
        _flag(attrs, "complete"),
        _texts(attrs, "notes"),
        old,
        _texts(attrs, "switches") if "switches" in attrs else (),
    )


def check_digest(file: h5py.File, metadata: Metadata, columns: Sums) -> None:
    """Raise `TrajectoryFileError` unless the digest matches the columns read; the old format has none."""
    if metadata.old and "digest" not in file.attrs:
        return
    kept = file.attrs["digest"]
    problem = "" if metadata.problem is None else metadata.problem.digest()
    if not isinstance(kept, bytes) or kept.decode("ascii", "replace") != metadata.digest(columns, problem):
        raise TrajectoryFileError("its contents differ from their digest: they were changed after they were written")


def _read_problem(file: h5py.File, old: bool) -> ProblemData | None:
    group = file["problem"]
    if not any(name in group for name in ("scene", *_UNITS)):
        return None
    scene = group["scene"][()]
    if not isinstance(scene, bytes):
        raise TrajectoryFileError("problem/scene is no text")
    length = None if old and "length" not in group.attrs else _number(group.attrs, "length")
    q0, v0, restitution = (_vector(group, name) for name in _UNITS)
    return ProblemData(scene.decode(), q0, v0, restitution, _number(group.attrs, "t0"), length)


def _vector(group: h5py.Group, name: str) -> Array:
    found = group[name]
    if found.dtype.kind != "f" or found.dtype.itemsize != 8 or found.ndim != 1:
        raise TrajectoryFileError(f"problem/{name} is no vector of numbers")
    values = np.ascontiguousarray(found[:], dtype=np.float64)
    if not np.isfinite(values).all():
        raise TrajectoryFileError(f"problem/{name} holds numbers that are not finite")
    return values


def _text(attrs: Any, name: str) -> str:
    value = attrs[name]
    if not isinstance(value, str):
        raise TrajectoryFileError(f"its attribute {name} is no text")
    return value


def _texts(attrs: Any, name: str) -> tuple[str, ...]:
    values = attrs[name]
    # an empty list of version 0.1 has no type
    if not isinstance(values, np.ndarray) or values.ndim != 1 or not all(isinstance(v, str) for v in values):
        raise TrajectoryFileError(f"its attribute {name} is no list of texts")
    return tuple(values.tolist())


def _number(attrs: Any, name: str) -> float:
    value = attrs[name]
    if not isinstance(value, np.floating | np.integer) or not np.isfinite(value):
        raise TrajectoryFileError(f"its attribute {name} is no finite number")
    return float(value)


def _flag(attrs: Any, name: str) -> bool:
    value = attrs[name]
    if not isinstance(value, np.bool_):
        raise TrajectoryFileError(f"its attribute {name} is neither true nor false")
    return bool(value)


def _hash(*parts: bytes) -> str:
    found = hashlib.sha256()
    for part in parts:
        found.update(len(part).to_bytes(8, "little"))
        found.update(part)
    return found.hexdigest()
