"""Nodes of the viewer: poses, names, shadows, and tracks of keys."""

from __future__ import annotations

from typing import Any

import meshcat
import numpy as np
from meshcat.animation import AnimationTrack
from meshcat.commands import SetProperty
from meshcat.geometry import pack_numpy_array

Array = np.ndarray

# largest error of a track between its keys: in half diagonals of the motion, and in entries of a quaternion
SLACK = 1e-3


class Track(AnimationTrack):
    """A track that sends its keys as two arrays of floats, a quarter of the bytes of a list of keys."""

    def lower(self) -> dict[str, Any]:
        """Return the track as the viewer reads it."""
        return {
            "name": f".{self.name}",
            "type": self.jstype,
            "times": pack_numpy_array(self.frames)["array"],
            "values": pack_numpy_array(self.values.T)["array"],
        }


class Steps(Track):
    """A track that jumps at its keys."""

    def lower(self) -> dict[str, Any]:
        """Return the track as the viewer reads it."""
        # three.js numbers the kinds of interpolation
        return {**super().lower(), "interpolation": 2300}


class _Property(SetProperty):
    """A property with its exact name, which meshcat would convert to lower case."""

    def lower(self) -> dict[str, Any]:
        return {**super().lower(), "property": self.key}


def cast_shadow(node: meshcat.Visualizer, value: bool) -> None:
    """Let a node cast a shadow, or not."""
    node.window.send(_Property("castShadow", value, node.path))


def hide(node: meshcat.Visualizer) -> None:
    """Hide a node until its animation shows it; it casts no shadow."""
    node.set_property("visible", False)
    cast_shadow(node["<object>"], False)


def pose(rotation: Array, position: Array) -> Array:
    """Return a pose as a matrix, shape (4, 4); scales may be part of the rotation."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, position
    return matrix


def turn_to(direction: Array) -> Array:
    """Return a rotation, shape (3, 3), that rotates z to a unit direction."""
    other = np.eye(3)[int(np.argmin(np.abs(direction)))]
    side = np.cross(other, direction)
    side /= np.linalg.norm(side)
    return np.stack([side, np.cross(direction, side), direction], axis=1)


def label(number: int, name: str) -> str:
    """Return a unique name of a node without slashes, which meshcat reads as a path."""
    return f"{number} {name}".replace("/", " ")
