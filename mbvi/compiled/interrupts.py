"""Interrupts (Ctrl-C) that wait until LLVM has finished."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any


@contextmanager
def interrupts_later() -> Iterator[None]:
    """Hold back interrupts (Ctrl-C) until the end of the block.

    LLVM calls Python while it compiles and loads; an exception raised there is printed and lost.
    """
    before = signal.getsignal(signal.SIGINT)
    # a handler that is no Python function interrupts nothing here, and only the main thread may set one
    if before is None or isinstance(before, int) or threading.current_thread() is not threading.main_thread():
        yield
        return
    handler, pending = before, list[Any]()
    signal.signal(signal.SIGINT, lambda _, frame: pending.append(frame))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if pending:
        handler(signal.SIGINT, pending.pop())
