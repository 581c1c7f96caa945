"""The limit of a run's CPU time, for runs in any thread."""

from __future__ import annotations

import ctypes
import faulthandler
import sys
import threading
import time
from collections.abc import Callable
from functools import partial
from types import TracebackType

from ..compiled import seconds_compiling

# seconds after which a process is ended whose thread answers no more, for instance inside a kernel without end
_STUCK = 30.0
# more turns than a thread takes to see an exception that was raised in it
_ARRIVES = 100
# an exception must not be raised in these, which call Python from C++
_COMPILING = ("numba", "llvmlite", "mbvi.compiled")


class OverBudget(BaseException):
    """A run has used more CPU time than it may; no `Exception`, so that a user's handlers do not catch it."""


def stop_watching() -> None:
    """Let the process go on, however long a thread does not answer."""
    faulthandler.cancel_dump_traceback_later()


class Limit:
    """A context that raises `OverBudget` in its thread after a number of seconds of that thread's CPU time.

    Parameters
    ----------
    seconds : float or None
        CPU time without that of compiling kernels [s]; None is no limit.
    ends_process : bool
        Whether to end the process where the thread cannot be interrupted.
    """

    def __init__(self, seconds: float | None, ends_process: bool = False) -> None:
        self._seconds, self._ends_process = seconds, ends_process
        self._lock, self._over, self._raised = threading.Lock(), threading.Event(), False
        self._cpu: Callable[[], float] = time.process_time

    def __enter__(self) -> None:
        if self._seconds is None:
            return
        self._thread = threading.get_ident()
        # macOS has the clock of the process only
        clock = time.pthread_getcpuclockid(self._thread) if hasattr(time, "pthread_getcpuclockid") else None
        if clock is not None:
            self._cpu = partial(time.clock_gettime, clock)
        self._begin = self._spent()
        self._alive()
        threading.Thread(target=self._watch, args=(self._seconds,), daemon=True).start()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._seconds is None:
            return
        try:
            with self._lock:
                self._over.set()
            # one that was raised too late arrives here. To take it back would leave Python looking for it for ever:
            # the process would be slower, and hang where it is traced
            for _ in range(_ARRIVES if self._raised and kind is not OverBudget else 0):
                time.sleep(0.0)
        except OverBudget:
            self._over.set()
        if self._ends_process:
            stop_watching()

    def _spent(self) -> float:
        return self._cpu() - seconds_compiling(self._thread).cpu

    def _alive(self) -> None:
        if self._ends_process:
            # it ends the process from a thread that needs no lock of Python
            faulthandler.dump_traceback_later(_STUCK, exit=True, file=sys.__stderr__ or 2)

    def _watch(self, seconds: float) -> None:
        pause = min(max(seconds / 50.0, 1e-3), 1.0)
        while not self._over.wait(pause):
            with self._lock:
                if self._over.is_set():
                    return
                # what it compiles just now is not in its sum yet
                if not self._compiling() and self._spent() - self._begin > seconds:
                    self._raised, raised = True, ctypes.py_object(OverBudget)
                    ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(self._thread), raised)
                    return
                self._alive()

    def _compiling(self) -> bool:
        frame = sys._current_frames().get(self._thread)
        while frame is not None:
            if str(frame.f_globals.get("__name__")).startswith(_COMPILING):
                return True
            frame = frame.f_back
        return False
