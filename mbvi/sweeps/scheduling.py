"""The loop of the client: batches of the runs that are missing, as many as keep the workers busy."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from itertools import islice
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import InputError
from .batch import Done, run_batch, size_of_marks
from .points import Points
from .study import StudyFolder

if TYPE_CHECKING:
    from distributed import Client, Future

# seconds that a batch shall take, and towards the end at least: a task costs the scheduler about a millisecond
_BATCH, _LEAST = 7.5, 0.5
# batches that wait or run for each worker, and at least, for clusters that grow while tasks wait
_AHEAD, _LEAST_AHEAD = 2, 64
_MOST_RUNS = 100_000
Numbered = tuple[int, Mapping[str, Any]]


class BatchSizes:
    """How many runs the next batch gets, from the time that the last ones took."""

    def __init__(self) -> None:
        self._runs = self._seconds = 0.0

    def add(self, done: Done) -> None:
        """Take a finished batch into account; the last ones count most."""
        self._runs = 0.8 * self._runs + done.computed
        self._seconds = 0.8 * self._seconds + done.seconds

    def next(self, left: int, workers: int) -> int:
        """Return a number of runs, given how many are left for how many workers."""
        if self._runs == 0.0:
            return 1
        mean = max(self._seconds / self._runs, 1e-6)
        # towards the end smaller ones, so that all workers end together
        last = max(math.ceil(left / (3 * workers)), int(_LEAST / mean))
        return max(1, min(int(_BATCH / mean), last, _MOST_RUNS))


class Submission:
    """Batches of a study that are on the cluster.

    Parameters
    ----------
    client : Client
        Client of a Dask cluster.
    folder : StudyFolder
        The study.
    name : str
        Name of the tasks on Dask's dashboard.
    allowed : int
        How often a process may end in a run before it is given up.
    """

    def __init__(self, client: Client, folder: StudyFolder, name: str, allowed: int) -> None:
        from distributed import as_completed

        self._client, self._folder, self._name, self._allowed = client, folder, name, allowed
        self._batches: dict[str, tuple[list[Numbered], tuple[int, int], Future]] = {}
        # batches whose workers ended before they began it, until it is known whether others go on
        self._held: list[list[Numbered]] = []
        self._ended = 0
        self._completed = as_completed(loop=client.loop)
        self._stamp, self._count = time.time_ns(), 0
        self._workers, self._counted = 0, -math.inf

    def __len__(self) -> int:
        return len(self._batches) + len(self._held)

    @property
    def workers(self) -> int:
        """The number of threads of the cluster, at least 1; it may grow and shrink."""
        now = time.monotonic()
        if now - self._counted > 1.0:
            self._workers, self._counted = sum(self._client.nthreads().values()), now
        return max(self._workers, 1)

    def add(self, batch: list[Numbered]) -> None:
        """Submit a batch."""
        first, self._count = batch[0][0], self._count + 1
        # Dask groups tasks by what stands before the first hyphen
        key = f"{self._name}-{self._stamp:x}-{self._count}-{first}"
        begun = self._begun()
        future = self._client.submit(
            run_batch, str(self._folder.path), batch, self._allowed, key=key, pure=False, priority=-self._count
        )
        self._batches[key] = batch, begun, future
        self._completed.add(future)

    def next(self) -> tuple[Done, list[Numbered]] | None:
        """Wait for a batch, and return the runs that it left over; None if its workers ended and it is tried again.

        Workers also end while a batch waits on them, in runs of others; Dask counts these ends against it.

        Raises
        ------
        InputError
            If workers end and no run is begun meanwhile.
        """
        from distributed import KilledWorker

        future = next(self._completed)
        batch, begun, _ = self._batches.pop(future.key)
        try:
            done: Done = future.result()
        except KilledWorker as error:
            if self._begun() != begun:
                self.add(batch)
            elif self._batches:
                self._held.append(batch)
            else:
                raise InputError(
                    f"workers end before they begin a run; their log says why: {error}; they must see the folder "
                    f"{self._folder.path} and have memory for make"
                ) from error
            return None
        finally:
            future.release()
        self._ended += 1
        while self._held:
            self.add(self._held.pop())
        return done, batch[len(batch) - done.left :]

    def _begun(self) -> tuple[int, int]:
        """Return numbers that change whenever a worker begins a batch, or ends one."""
        return self._ended, size_of_marks(self._folder)

    def cancel(self) -> None:
        """Cancel what has not ended."""
        futures = [future for _, _, future in self._batches.values()]
        if futures and self._client.status == "running":
            self._client.cancel(futures, force=True)


def run_missing(
    submission: Submission,
    points: Points,
    missing: np.ndarray,
    report: Callable[[Done], None],
    sizes: Any = None,
) -> None:
    """Run the points that have no rows yet.

    Parameters
    ----------
    submission : Submission
        Where to.
    points : Points
        All points.
    missing : ndarray of int
        Numbers of the runs.
    report : callable
        Called with what each batch has done.
    sizes : BatchSizes, optional
        Sizes of the batches.
    """
    sizes = BatchSizes() if sizes is None else sizes
    # points are made when they are submitted: a million of them would be large
    points_left: Iterator[Numbered] = ((int(k), points[int(k)]) for k in missing)
    again, count, least = deque[Numbered](), len(missing), 0
    try:
        while True:
            while count and len(submission) < max(_AHEAD * submission.workers, least):
                size = sizes.next(count, submission.workers)
                batch = [again.popleft() for _ in range(min(size, len(again)))]
                batch = batch or list(islice(points_left, size))
                count -= len(batch)
                submission.add(batch)
            if not len(submission):
                return
            ended = submission.next()
            if ended is not None:
                done, left_over = ended
                again.extend(left_over)
                count += len(left_over)
                sizes.add(done)
                report(done)
                # from now on it is known how long a run takes
                least = _LEAST_AHEAD
    finally:
        submission.cancel()
