"""Faults of files, for tests and for the fuzz driver: flipped bytes, cuts, changed contents, limits of size.

Each function takes a path and a random generator, so that a seed names a fault.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np

import mbvi
from mbvi.results.files.columns import DENSE, FRICTION, RECORDED, TABLES, Sums, as_kept
from mbvi.results.files.metadata import read_metadata
from mbvi.results.files.pages import PAGE, find_record, pack, sums_of
from support.programs import LIMIT

# a change of a file in place: returns what was done
Mutation = Callable[[h5py.File, np.random.Generator], str]


def contents(run: mbvi.Trajectory) -> tuple[Any, ...]:
    """Return all that a file keeps of a run, to the bit and comparable."""
    arrays = [
        run.t,
        run.q,
        run.v,
        run.residual,
        run.penetration(),
        *([] if run.record.dense is None else [run.record.dense]),
    ]
    if run.problem is not None or run.record.energies is not None:
        arrays += run.energies()
    problem = run.problem
    kept = () if problem is None else (problem.report(), problem.q0.tobytes(), problem.v0.tobytes(), problem.t0)
    rows = ("percussion", "before", "after", "point", "normal")
    if run.impacts and run.impacts[0].regime is not None:
        rows += ("tangential", "slip_before", "slip_after", "e_used")
    impacts = [
        (i.time, i.constraints, i.energy_change, i.regime, *(getattr(i, name).tobytes() for name in rows))
        for i in run.impacts
    ]
    arrays_kept = [(a.shape, a.tobytes()) for a in arrays]
    return (arrays_kept, impacts, run.scheme, run.step, run.record.timing.jump, run.notes, run.complete, kept)


def loads_or_says(path: Path, expected: tuple[Any, ...]) -> str:
    """Load a faulty file: return "same" or the error's words; raise where it loads as anything else."""
    try:
        found = contents(mbvi.load(path))
    except mbvi.TrajectoryFileError as error:
        return str(error)
    assert found == expected, "the file loads as another run"
    return "same"


def restore(path: Path, whole: bytes) -> None:
    """Write a file again, in place: cut off first it would be flushed to the disk each time."""
    with path.open("rb+") as file:
        file.write(whole)
        file.truncate()


def flip_bytes(path: Path, rng: np.random.Generator, count: int = 1, end: int | None = None) -> list[int]:
    """Change `count` bytes of a file, among the first `end` if given; return where."""
    raw = bytearray(path.read_bytes())
    places = rng.integers(0, len(raw) if end is None else end, count).tolist()
    for place in places:
        raw[place] ^= int(rng.integers(1, 256))
    restore(path, raw)
    return places


def cut(path: Path, rng: np.random.Generator) -> int:
    """Cut a file off somewhere; return how many bytes are left."""
    length = int(rng.integers(0, path.stat().st_size))
    os.truncate(path, length)
    return length


def without_checksums(path: Path) -> None:
    """Cut off the checksums of the pages, as any program does that changes the file by HDF5."""
    with open(path, "rb+") as file:
        record, _ = find_record(file.fileno())
        if record is not None:
            os.ftruncate(file.fileno(), record.size)


def seal(path: Path) -> None:
    """Make digest and checksums those of what a file holds now, as one who changes it on purpose would."""
    without_checksums(path)
    with h5py.File(path, "r+") as file:
        try:
            metadata, sums = read_metadata(file), Sums()
            tables = TABLES | {name: columns for name, columns in RECORDED.items() if name in file}
            for name in FRICTION.keys() & tables.keys():
                tables[name] = tables[name] | (FRICTION[name] if "regime" in file[name] else {})
            places = {f"{t}/{n}".strip("/"): c for t, columns in tables.items() for n, c in columns.items()}
            places |= {"dense": DENSE} if "dense" in file else {}
            for place, column in places.items():
                values = file[place][:]
                sums.add(place, values.astype("S") if column.kind == "name" else as_kept(values.real, column))
            problem = "" if metadata.problem is None else metadata.problem.digest()
            file.attrs["digest"] = np.bytes_(metadata.digest(sums, problem))
        except Exception:
            # what cannot be read has no digest either
            pass
    image = path.read_bytes()
    sums_of_pages = sums_of(image[k : k + PAGE] for k in range(0, len(image), PAGE))
    path.write_bytes(image + pack(len(image), sums_of_pages, {}))


def mutations(path: Path) -> Iterator[tuple[str, Mutation]]:
    """Yield named changes of the contents of a well-formed file: of its data sets, attributes and scene."""
    datasets, attributes = [], []

    def visit(name: str, thing: Any) -> None:
        if isinstance(thing, h5py.Dataset):
            datasets.append(name)
        attributes.extend((name, key) for key in thing.attrs if key not in ("unit", "description", "digest"))

    with h5py.File(path, "r") as file:
        visit("/", file)
        file.visititems(visit)
        scene = json.loads(file["problem/scene"][()]) if "scene" in file["problem"] else {}
    for name in datasets:
        for change in _DATASET:
            yield f"{name}: {change.__name__}", _of_dataset(name, change)
    for name, key in attributes:
        for value in (None, 3.5, -1, np.nan, "text", b"bytes", [1, 2], ["a"], True, 10**12):
            yield f"{name}@{key} = {value!r}", _of_attribute(name, key, value)
    for key in scene:
        yield f"scene without {key}", _of_scene(lambda data, rng, key=key: data.pop(key))
        for value in (None, 1.5, "a", [], {}, [[1]], {"a": 1}):
            yield f"scene {key} = {value!r}", _of_scene(lambda data, rng, key=key, v=value: data.update({key: v}))
    for k in range(40):
        yield f"scene leaf {k}", _of_scene(_change_leaf)


def mutate(path: Path, change: Mutation, rng: np.random.Generator, *, sealed: bool) -> None:
    """Apply a mutation to a file; sealed, its digest and checksums are made to fit."""
    with h5py.File(path, "r+") as file:
        change(file, rng)
    if sealed:
        seal(path)


def run_limited(program: str, limit: int, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run a Python program that can write files of at most `limit` bytes."""
    # the limit is set by the program: JAX warns of a process that forks
    first = f"import resource\nresource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, {limit}))\n"
    return subprocess.run(
        [sys.executable, "-c", first + program, *arguments],
        capture_output=True,
        text=True,
        timeout=LIMIT,
        check=False,
    )


def _of_dataset(name: str, change: Callable[[np.ndarray, np.random.Generator], Any]) -> Mutation:
    def apply(file: h5py.File, rng: np.random.Generator) -> str:
        values = change(np.asarray(file[name][()]), rng)
        attrs = dict(file[name].attrs)
        del file[name]
        if isinstance(values, str):
            file.create_group(name)
        elif values is not None:
            text = values.dtype.kind in "OSU"
            kind = h5py.string_dtype() if values.dtype.kind in "OU" else None
            options = {} if text or not values.size or not values.ndim else {"fletcher32": True, "chunks": values.shape}
            file.create_dataset(name, data=values, dtype=kind, **options).attrs.update(attrs)
        return name

    return apply


def _missing(values: np.ndarray, rng: np.random.Generator) -> None:
    return None


def _a_group(values: np.ndarray, rng: np.random.Generator) -> str:
    return "group"


def _reversed(values: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return values[::-1] if values.ndim else values


def _swapped(values: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    if not values.ndim or len(values) < 3:
        return values[::-1] if values.ndim else values
    order, k = np.arange(len(values)), int(rng.integers(1, len(values) - 1))
    order[[k, k + 1]] = k + 1, k
    return values[order]


def _shorter(values: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return values[:-1] if values.ndim else np.bytes_(bytes(values[()])[:-1])


def _longer(values: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return np.concatenate([values, values[-1:]]) if values.ndim else np.array([values[()]] * 2)


def _empty(values: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return values[:0] if values.ndim else np.zeros(0)


def _narrower(values: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return values[..., :-1] if values.ndim > 1 else values.reshape((*values.shape, 1))


def _wider(values: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return np.concatenate([values, values[..., -1:]], axis=-1) if values.ndim > 1 else np.stack([values, values], -1)


def _flat(values: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return values.ravel() if values.ndim > 1 else values[..., None, None]


def _single(values: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return values.astype(np.float32) if values.dtype.kind in "fi" else np.zeros(values.shape or (1,), np.float32)


def _complex(values: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return values.astype(complex) if values.dtype.kind in "fi" else np.zeros(values.shape or (1,), complex)


def _integers(values: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return np.zeros(values.shape or (1,), np.int32) if values.dtype.kind != "i" else values.astype(np.float64)


def _objects(values: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return np.full(values.shape or (1,), "nobody | nothing", dtype=object)


def _one(value: float) -> Callable[[np.ndarray, np.random.Generator], np.ndarray]:
    def change(values: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        changed = np.array(values)
        if changed.dtype.kind == "f" and changed.size:
            changed.flat[int(rng.integers(changed.size))] = value
            return changed
        return _missing(values, rng)

    change.__name__ = f"one {value:g}"
    return change


_DATASET = (
    _missing, _a_group, _reversed, _swapped, _shorter, _longer, _empty, _narrower, _wider, _flat, _single, _complex,
    _integers, _objects, _one(np.nan), _one(np.inf), _one(-1e300),
)  # fmt: skip


def _of_attribute(name: str, key: str, value: Any) -> Mutation:
    def apply(file: h5py.File, rng: np.random.Generator) -> str:
        del file[name].attrs[key]
        if value is not None:
            file[name].attrs[key] = value
        return key

    return apply


def _of_scene(change: Callable[[dict[str, Any], np.random.Generator], Any]) -> Mutation:
    def apply(file: h5py.File, rng: np.random.Generator) -> str:
        data = json.loads(file["problem/scene"][()])
        change(data, rng)
        del file["problem/scene"]
        file["problem"].create_dataset("scene", data=np.bytes_(json.dumps(data).encode()))
        return "scene"

    return apply


def _change_leaf(data: Any, rng: np.random.Generator) -> None:
    """Change something deep inside: leave out a key, add one, or put a value of another kind."""
    kind = int(rng.integers(4))
    while True:
        keys = list(data) if isinstance(data, dict) else list(range(len(data)))
        if not keys:
            return
        key = keys[int(rng.integers(len(keys)))]
        if isinstance(data[key], (dict, list)) and data[key] and rng.random() < 0.9:
            data = data[key]
            continue
        if kind == 0:
            data.pop(key)
        elif kind == 1 and isinstance(data, dict):
            data["extra"] = 1
        else:
            data[key] = [None, "a", [1, 2], {"a": 1}, -1e300][int(rng.integers(5))]
        return
