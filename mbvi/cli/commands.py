"""The group of commands: those of mbvi, and those that other packages name as entry points of `mbvi.commands`."""

from __future__ import annotations

from importlib.metadata import EntryPoint, entry_points
from typing import Any

import typer
from typer.core import TyperGroup
from typer.main import get_command

from ..errors import InputError

# what users install for the commands of mbvi_studies, and the names of these commands
_STUDIES, _STUDY_COMMANDS = 'pip install "mbvi[studies]"', ("chart", "stress")


class Commands(TyperGroup):
    """A group that loads entry points when its commands are listed, or a name is none of its own.

    An entry point is a `typer.Typer` with one command.
    """

    def list_commands(self, ctx: Any) -> list[str]:
        """Return the names of all commands, those of entry points last."""
        self._add_others()
        return super().list_commands(ctx)

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """Return a command, None if there is none of this name."""
        if cmd_name not in self.commands:
            self._add_others()
        return super().get_command(ctx, cmd_name)

    def _add_others(self) -> None:
        found = {entry.name: entry for entry in entry_points(group="mbvi.commands")}
        for name in sorted({*found, *_STUDY_COMMANDS} - self.commands.keys()):
            self.commands[name] = _loaded(name, found.get(name))


def _loaded(name: str, entry: EntryPoint | None) -> Any:
    """Return the command of an entry point; if it cannot be imported, one that says so."""
    why = f"not installed: {_STUDIES}" if name in _STUDY_COMMANDS else "not installed"
    short = why
    try:
        if entry is not None:
            return get_command(entry.load())
    except (ImportError, AttributeError) as error:
        why += f" ({error})"
    refusing = typer.Typer(add_completion=False, rich_markup_mode=None)

    @refusing.command(
        name, help=why, short_help=short, context_settings={"allow_extra_args": True, "ignore_unknown_options": True}
    )
    def refuse() -> None:
        raise InputError(f"the command {name} is {why}")

    return get_command(refusing)
