"""A bar on the terminal for what takes more than a second beside a run: building, replays, reports."""

from __future__ import annotations

import sys
from collections.abc import Collection, Iterator
from typing import TypeVar

T = TypeVar("T")


def watched(items: Collection[T], what: str) -> Iterator[T]:
    """Yield items; on a terminal a bar shows how many are done, from the second second on until the last one."""
    if not sys.stderr.isatty():
        yield from items
        return
    from .bar import PATIENCE, Bar

    yield from Bar(items, desc=what, delay=PATIENCE, leave=False)
