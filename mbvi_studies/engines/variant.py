"""Ways to set another engine that runs the scenes of a chart."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

Scene = TypeVar("Scene")
State = TypeVar("State")
Read = TypeVar("Read", covariant=True)


class SceneEngine(Protocol[Read]):
    """An adapter of another engine with a scene."""

    def advance(self) -> None:
        """Advance by one step."""

    def read(self) -> Read:
        """Return the state."""


@dataclass(frozen=True)
class Variant(Generic[Scene, State]):
    """A way to set an engine.

    Attributes
    ----------
    line : str
        Name of its line in a chart: the engine with what is kept along the line.
    setting : str
        Its settings in words.
    make : callable
        make(scene, h) -> the adapter with the scene at its start and a time step [s].
    """

    line: str
    setting: str
    make: Callable[[Scene, float], SceneEngine[State]]
