"""The cluster of a sweep: the client that is given, the current one, or processes on this machine."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress
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


def leave_interrupts() -> None:
    """Let Ctrl-C, which all processes of a terminal get, end this process only where the client ends it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


@contextmanager
def client_of(given: Client | None) -> Iterator[tuple[Client, int]]:
    """Yield the client, and how often a process may end in a run."""
    import dask
    from distributed import Client

    with suppress(ValueError):
        given = given or Client.current()
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
    try:
        with dask.config.set(_QUIET):
            cluster = LocalCluster(
                n_workers=workers or count,
                threads_per_worker=1,
                dashboard_address="127.0.0.1:0",
                # a killed worker is a row, not a message
                silence_logs=logging.CRITICAL,
            )
    except RuntimeError as error:
        raise InputError(
            f"worker processes do not start: {error} In a script, call it below `if __name__ == '__main__':`, because "
            "worker processes import the script"
        ) from error
    try:
        with Client(cluster, set_as_default=False) as client:
            # for processes that are started again, too
            client.register_worker_callbacks(setup=leave_interrupts)
            yield client
    finally:
        try:
            cluster.close()
        except KeyError:
            # Dask may have forgotten a worker that was killed; all processes have ended
            cluster.status = Status.closed
