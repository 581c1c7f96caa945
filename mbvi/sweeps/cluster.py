"""The cluster of a sweep: the client that is given, the current one, or processes on this machine."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from multiprocessing import resource_tracker
from typing import TYPE_CHECKING, Any

from ..arguments import shown
from ..errors import InputError

if TYPE_CHECKING:
    from distributed import Client

_PACKAGES = ("distributed", "xarray", "pandas", "pyarrow", "cloudpickle")
# how often a process on this machine may end in a run before the run is given up; others see Dask's allowed-failures
_ALLOWED_HERE = 1
# Dask looks at its processes up to a hundred times a second, which costs several per cent of the runs' time
_QUIET = {
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "5s",
    "distributed.worker.memory.monitor-interval": "1s",
}
# where runs end a process again and again, Dask would give it up while it starts for the next time
_PATIENT = {"distributed.deploy.lost-worker-timeout": "1 day"}


def check_packages() -> None:
    """Raise `InputError` unless the packages of the extra are installed."""
    from importlib.util import find_spec

    missing = [name for name in _PACKAGES if find_spec(name) is None]
    if missing:
        raise InputError(f"sweeps need {', '.join(missing)}: pip install 'mbvi[sweep]'")


def check_client(client: Any) -> None:
    """Raise `InputError` unless a client is None or one that can be waited for."""
    from distributed import Client

    if client is not None and not (isinstance(client, Client) and not client.asynchronous):
        raise InputError(f"client must be a distributed.Client that is not asynchronous; got {shown(client)}")


@contextmanager
def client_of(given: Client | None) -> Iterator[tuple[Client, int]]:
    """Yield the client, and how often a process may end in a run."""
    import dask
    from distributed import Client

    with suppress(ValueError):
        given = given or Client.current()
    with dask.config.set(_PATIENT):
        if given is not None:
            yield given, int(dask.config.get("distributed.scheduler.allowed-failures"))
            return
        with local_client() as client:
            yield client, _ALLOWED_HERE


@contextmanager
def local_client(workers: int | None = None) -> Iterator[Client]:
    """Yield the client of a cluster on this machine.

    Parameters
    ----------
    workers : int, optional
        Number of processes; by default that of the cores that this process may use.

    Raises
    ------
    InputError
        If the processes do not start.
    """
    import logging

    import dask
    from distributed import Client, LocalCluster, Status

    count = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    with dask.config.set(_QUIET), _without_interrupts():
        cluster = LocalCluster(
            n_workers=0,
            threads_per_worker=1,
            processes=True,
            dashboard_address="127.0.0.1:0",
            # a killed worker is a row, not a message
            silence_logs=logging.CRITICAL,
        )
    try:
        _start(cluster, workers or count or 1)
        with Client(cluster, set_as_default=False) as client:
            yield client
    finally:
        try:
            cluster.close()
        except KeyError:
            # Dask may have forgotten a worker that was killed; all processes have ended
            cluster.status = Status.closed


def _start(cluster: Any, workers: int) -> None:
    """Start worker processes, and wait until they have begun."""
    import asyncio

    import dask

    async def started() -> None:
        await cluster

    for _ in range(workers):
        cluster.worker_spec.update(cluster.new_worker_spec())
    with dask.config.set(_QUIET):
        starting = asyncio.run_coroutine_threadsafe(started(), cluster.loop.asyncio_loop)
        try:
            starting.result()
        except KeyboardInterrupt:
            # Dask cannot end processes that begin; a second interrupt ends this wait
            with suppress(Exception):
                starting.result()
            raise
        except RuntimeError as error:
            raise InputError(
                f"worker processes do not start: {error} In a script, call it below `if __name__ == '__main__':`, "
                "because worker processes import the script"
            ) from error


@contextmanager
def _without_interrupts() -> Iterator[None]:
    """Let threads that start here, and all processes that they start, not get the Ctrl-C of a terminal.

    The client ends them. This thread gets an interrupt at the end of the block.
    """
    # it would let these signals through again in the thread that starts it
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
