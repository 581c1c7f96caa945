"""The command `mbvi`, outside the package, so that Ctrl-C while the package is imported is one line as well."""

import atexit
import os
import signal
from types import FrameType
from typing import NoReturn


def main() -> NoReturn:
    """Run the command line; Ctrl-C while it is imported, or while Python ends, gives one line and the exit code 130."""
    before = signal.getsignal(signal.SIGINT)
    # in the background of a script interrupts are ignored
    interrupt = _leave if before is signal.default_int_handler else before
    signal.signal(signal.SIGINT, interrupt)
    if interrupt is _leave:
        # called last: Python itself would end by the signal from then on, without a line
        atexit.register(signal.signal, signal.SIGINT, signal.SIG_IGN)
    from mbvi.cli.main import main as command

    try:
        signal.signal(signal.SIGINT, before)
        command()
    except KeyboardInterrupt:
        # between the places that handle it
        _leave(signal.SIGINT, None)
    finally:
        signal.signal(signal.SIGINT, interrupt)


def _leave(number: int, frame: FrameType | None) -> NoReturn:
    # at once: where C++ is imported, an exception would be printed and lost
    os.write(2, b"mbvi: interrupted\n")
    os._exit(130)
