"""A progress bar on the terminal for long runs."""

from __future__ import annotations

import sys
import time
from types import TracebackType

from ..arguments.bar import Bar

# seconds after which the length of a run is estimated, and the length from which a bar is shown
_PATIENCE, _LONG = 0.5, 3.0


class Progress:
    """A progress bar; a context that closes it.

    Parameters
    ----------
    total : int
        Number of steps.
    shown : bool or None
        True: always; False: never; None: on a terminal, if the run is estimated to be long.
    """

    def __init__(self, total: int, shown: bool | None) -> None:
        self._total = total
        self._bar: Bar | None = None
        self._start = time.perf_counter()
        wanted = sys.stderr.isatty() if shown is None else shown
        self._next = (self._start + (0.0 if shown else _PATIENCE)) if wanted else float("inf")
        self._always = bool(shown)

    def __enter__(self) -> Progress:
        return self

    def poll(self, done: int) -> float:
        """Show that `done` steps are taken; return the time of the next update."""
        now = time.perf_counter()
        if now < self._next:
            return self._next
        self._next = now + 0.1
        # the compiled loop may have left even the first step to Python
        expected = (now - self._start) / max(done, 1) * self._total
        if self._bar is None and (self._always or expected > _LONG):
            self._bar = Bar(total=self._total, unit="step", unit_scale=True)
        if self._bar is not None:
            self._bar.update(done - self._bar.n)
        return self._next

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._bar is not None:
            if error is None:
                self._bar.update(self._total - self._bar.n)
            self._bar.close()
