"""Nodes of the viewer: names and shadows."""

from __future__ import annotations

from typing import Any

import meshcat
from meshcat.commands import SetProperty


class _Property(SetProperty):
    """A property with its exact name, which meshcat would convert to lower case."""

    def lower(self) -> dict[str, Any]:
        return {**super().lower(), "property": self.key}


def cast_shadow(node: meshcat.Visualizer, value: bool) -> None:
    """Let a node cast a shadow, or not."""
    node.window.send(_Property("castShadow", value, node.path))


def label(number: int, name: str) -> str:
    """Return a unique name of a node without slashes, which meshcat reads as a path."""
    return f"{number} {name}".replace("/", " ")
