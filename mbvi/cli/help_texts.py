"""The examples below the help of each command."""

from __future__ import annotations


def examples(*lines: str) -> str:
    """Return the epilog of a command, which the help prints line by line."""
    return "\b\nExamples:\n" + "\n".join(f"  {line}" for line in lines)
