"""A batch of runs: what a worker does in one task."""

from __future__ import annotations

import fcntl
import os
import struct
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..compiled import seconds_compiling
from ..errors import InputError
from ..results.files.versions import versions
from .one_run import killed_row, row_of
from .rows import STATUS, Row, read_file, write_rows
from .study import StudyFolder, written

# rows are written once the runs since the last time took as long as this [s]
_WRITE_EVERY = 1.0
# a batch is given back after this time, so that other workers share it [s]
_LONGEST = 20.0
# the first run of a process waits for another process to compile, no longer than this without compiling [s]
_ALONE = 10.0
_INDEX = struct.Struct("<q")


@dataclass(frozen=True)
class Done:
    """What a batch has done.

    Attributes
    ----------
    runs, failed : int
        Number of rows, and of those whose status is not "ok".
    seconds : float
        Time without that of compiling kernels [s].
    computed : int
        Number of rows that this time was spent on.
    left : int
        Number of runs at its end that were not made, because they take longer than expected.
    """

    runs: int
    failed: int
    seconds: float
    computed: int
    left: int = 0


def run_batch(folder: str, numbered: Sequence[tuple[int, Mapping[str, Any]]], allowed: int) -> Done:
    """Run some points of a study and write their rows.

    Parameters
    ----------
    folder : str
        Folder of the study, which this process must see too.
    numbered : sequence of (int, mapping)
        Numbers of the runs and their points.
    allowed : int
        How often a process may end in a run; once more, and the run is not tried again.

    Raises
    ------
    InputError
        If the study cannot be loaded here, or the versions of packages here are not those of the study.
    TrajectoryFileError
        If rows or kept runs cannot be written.
    """
    here = StudyFolder(Path(folder))
    _check_versions(here)
    study, first = here.study(), numbered[0][0]
    path = here.rows / f"{first:09d}.parquet"
    # rows of an earlier attempt, whose process ended
    rows: list[Row] = read_file(path) if path.exists() else []
    have, before = {row["run"] for row in rows}, len(rows)
    begin = time.perf_counter() - seconds_compiling().wall
    since = begin
    with Marks(here.rows / f"{first:09d}.running") as marks:
        for index, point in numbered:
            if index in have:
                continue
            deaths = marks.deaths[index]
            if deaths > allowed:
                rows.append(killed_row(index, deaths))
            else:
                marks.begin(index)
                with first_run_alone():
                    rows.append(row_of(study, index, point, here.runs, ends_process=_has_nanny()))
            now = time.perf_counter() - seconds_compiling().wall
            if now - begin > _LONGEST:
                break
            if now - since >= _WRITE_EVERY:
                write_rows(path, rows)
                since = now
        write_rows(path, rows)
    spent = time.perf_counter() - seconds_compiling().wall - begin
    failed = sum(row["status"] != STATUS.ok for row in rows)
    return Done(len(rows), failed, spent, len(rows) - before, len(numbered) - len(rows))


class Marks:
    """A file that says which run a process is at, so that a run that ends its process is known.

    Parameters
    ----------
    path : Path
        The file: for every process that began the batch the run that it was at last.

    Attributes
    ----------
    deaths : Counter
        How many processes ended in each run.
    """

    def __init__(self, path: Path) -> None:
        self._path = path

    def __enter__(self) -> Marks:
        with written(self._path.parent.parent):
            self._file = os.open(self._path, os.O_RDWR | os.O_CREAT)
            found = os.read(self._file, 1 << 20)
        self.deaths = Counter(index for (index,) in _INDEX.iter_unpack(found[: len(found) // 8 * 8]))
        self._place = len(found) // 8 * 8
        return self

    def begin(self, index: int) -> None:
        """Note that a run begins."""
        with written(self._path.parent.parent):
            os.pwrite(self._file, _INDEX.pack(index), self._place)

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        os.close(self._file)
        if kind is None:
            self._path.unlink(missing_ok=True)


def size_of_marks(folder: StudyFolder) -> int:
    """Return a number that grows with every process that begins a batch, and falls where a batch has ended."""
    found = 0
    for path in folder.rows.glob("*.running"):
        # its batch may end just now
        with suppress(FileNotFoundError):
            found += path.stat().st_size
    return found


_first_run = True


@contextmanager
def first_run_alone() -> Iterator[None]:
    """Let one process of a machine at a time make its first run, which compiles the kernels, so that others load them.

    Processes that waited go on together.
    """
    global _first_run
    if not _first_run:
        yield
        return
    _first_run = False
    ended = threading.Event()
    with open(Path(tempfile.gettempdir()) / f"mbvi-first-run-{os.getuid()}.lock", "w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            fcntl.flock(lock, fcntl.LOCK_SH)
            fcntl.flock(lock, fcntl.LOCK_UN)
        runs = threading.get_ident()
        begin = time.perf_counter() - seconds_compiling(runs).wall

        def release() -> None:
            # a long run compiles at its beginning
            while not ended.wait(0.2):
                if time.perf_counter() - seconds_compiling(runs).wall - begin > _ALONE:
                    fcntl.flock(lock, fcntl.LOCK_UN)
                    return

        thread = threading.Thread(target=release, daemon=True)
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join()


def _check_versions(folder: StudyFolder) -> None:
    there, here = folder.about()["versions"], versions()
    different = [f"{name} is {here.get(name)}, not {there[name]}" for name in there if there[name] != here.get(name)]
    if different:
        raise InputError(f"a worker has other versions than the study: {'; '.join(different)}")


def _has_nanny() -> bool:
    """Return whether this process is a worker that is started again where it ends."""
    from distributed import get_worker

    try:
        return get_worker().nanny is not None
    except ValueError:
        return False
