"""The command line `mbvi`: its commands, and how errors leave it."""

from __future__ import annotations

import io
import logging
import sys
from collections.abc import Callable, Sequence
from typing import Annotated, Any, NoReturn

import typer

from ..errors import DivergedError, MbviError, ProjectionError
from .commands import Commands
from .demo import demo
from .help_texts import examples
from .play import replay
from .run import run
from .simulate import inspect, simulate
from .sweep import sweep
from .versions import versions

app = typer.Typer(
    cls=Commands, help="Rigid multibody systems with impacts.", pretty_exceptions_enable=False, rich_markup_mode=None
)
# a run that failed; anything else can be corrected in what was given
_FAILED = (ProjectionError, DivergedError)


@app.callback(
    invoke_without_command=True,
    epilog=examples("mbvi demo", "mbvi simulate robot.urdf --replay run.html", "mbvi COMMAND --help"),
)
def _main(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Show the versions of mbvi and all engines.")] = False,
    verbose: Annotated[bool, typer.Option("--verbose", help="Show the log of the library.")] = False,
) -> None:
    _log_to_stderr(logging.INFO if verbose else logging.WARNING)
    if version:
        print(versions())
    elif context.invoked_subcommand is None:
        print(context.get_help())


_COMMANDS: dict[Callable[..., None], tuple[str, ...]] = {
    demo: ("mbvi demo", "mbvi demo --out-dir results"),
    simulate: (
        "mbvi simulate robot.urdf --height 0.3 --friction 0.6 --replay run.html",
        "mbvi simulate arm.urdf --base fixed --joint elbow=1.2 --duration 5",
        "mbvi simulate robot.xml --out run.h5",
        "mbvi simulate robot:go2_description --tolerance 1e-8",
    ),
    run: (
        "mbvi run scene.py --set height=0.5 --set material=steel",
        "mbvi run scene.py --step 1e-3 --duration 5 --out run.h5",
    ),
    inspect: ("mbvi inspect robot.urdf", "mbvi inspect arm.urdf --base fixed --srdf arm.srdf"),
    replay: ("mbvi replay run.h5", "mbvi replay run.h5 --html run.html --shapes collision"),
    sweep: (
        "mbvi sweep study.py --workers 4",
        "mbvi sweep --status study",
        "mbvi sweep --resume study",
    ),
}
for _command, _lines in _COMMANDS.items():
    app.command(epilog=examples(*_lines))(_command)


class _Lines(logging.Handler):
    """Prints what is logged as lines on stderr."""

    def emit(self, record: logging.LogRecord) -> None:
        """Print a record."""
        print(f"mbvi: {record.getMessage()}", file=sys.stderr, flush=True)


def _log_to_stderr(level: int) -> None:
    """Print what the library logs as lines on stderr."""
    logger = logging.getLogger("mbvi")
    if not any(isinstance(handler, _Lines) for handler in logger.handlers):
        logger.addHandler(_Lines())
    logger.setLevel(level)


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run the command line and exit with 0, or with one line on stderr.

    The code is 1 if a run failed, 2 for errors that the user can correct, and 130 if the user interrupted it.

    Parameters
    ----------
    arguments : sequence of str, optional
        By default those of the process.
    """
    _print_any_character()
    try:
        code = app(args=None if arguments is None else list(arguments), prog_name="mbvi", standalone_mode=False)
    except (typer.Abort, KeyboardInterrupt):
        # typer leaves those to Python that come before it calls the command
        code = 130
    except Exception as error:
        if not _hides_an_interrupt(error):
            _fail_by(error)
        code = 130
    # some versions of typer raise on Ctrl-C, others return the shell's code for it
    if code == 130:
        _fail("interrupted", 130)
    sys.exit(code if isinstance(code, int) else 0)


def _print_any_character() -> None:
    """Print characters that the terminal has not as escapes: names may have any."""
    for stream in (sys.stdout, sys.stderr):
        # others were chosen by the user
        if isinstance(stream, io.TextIOWrapper) and stream.errors in ("strict", "surrogateescape"):
            stream.reconfigure(errors="backslashreplace")


def _hides_an_interrupt(error: BaseException | None) -> bool:
    """Return whether an error comes from Ctrl-C while a class was made, which Python 3.11 turns into a RuntimeError."""
    while error is not None:
        if isinstance(error, RuntimeError) and isinstance(error.__cause__, KeyboardInterrupt):
            return True
        error = error.__cause__ or error.__context__
    return False


def _fail_by(error: Exception) -> NoReturn:
    """Exit with the message and the code of an error that a user can cause; raise any other one."""
    # UsageError of the click that typer uses, its own copy or the installed one
    usage: Any = typer.BadParameter.__base__
    if isinstance(error, usage):
        # pydantic, inside typer, begins its messages so
        said = error.format_message().replace("Value error, ", "")
        _fail(f"{said} (see: {error.ctx.command_path if error.ctx else 'mbvi'} --help)")
    if isinstance(error, MbviError):
        _fail(str(error), 1 if isinstance(error, _FAILED) else 2)
    if isinstance(error, MemoryError):
        _fail(f"not enough memory: {error}; record less with --every, or simulate a shorter time")
    if isinstance(error, OSError):
        _fail(f"{error.strerror or error}" + (f": {error.filename}" if error.filename else ""))
    raise error


def _fail(message: str, code: int = 2) -> NoReturn:
    print("mbvi:", " ".join(message.split()), file=sys.stderr)
    sys.exit(code)
