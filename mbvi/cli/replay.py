"""Replay on the command line: the choice of shapes, playing, writing a page, printing warnings as notes."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError, MbviWarning

if TYPE_CHECKING:
    from ..results.trajectory import Trajectory


class Shapes(StrEnum):
    """Which shapes of robots a replay shows."""

    visual = "visual"
    collision = "collision"


def page_name(value: Path | None) -> Path | None:
    """Refuse a name that no browser opens as a page."""
    if value is not None and value.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"a replay is a page, and its name ends with .html; got {value.name}")
    return value


def write_page(run: Trajectory, page: Path, shapes: Shapes) -> None:
    """Write a page that plays a run, and print its name."""
    with warnings_as_notes():
        run.replay_html(page, shapes.value)
    print(f"replay       {page} (opens in any browser)")


def play(run: Trajectory, shapes: Shapes) -> None:
    """Show a run in the browser until the user interrupts; its page can be closed and opened again."""
    from ..results.replay.live import replay

    with suppress(KeyboardInterrupt):
        with warnings_as_notes():
            server = replay(run, shapes=shapes.value)
        print("Ctrl-C ends; a page that is open goes on playing", flush=True)
        server.wait()


@contextmanager
def warnings_as_notes() -> Iterator[None]:
    """Print warnings of mbvi, each once, in the format of a run's notes."""
    said: set[str] = set()

    def show(message: Warning | str, *_: Any, **__: Any) -> None:
        if str(message) not in said:
            said.add(str(message))
            print(f"note         {message}", flush=True)

    with warnings.catch_warnings():
        warnings.simplefilter("always", MbviWarning)
        warnings.showwarning = show
        yield
