"""What problems need of the scene that they were built from."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

from .arguments import Array
from .constraints import Constraint
from .system import System

if TYPE_CHECKING:
    from .geometry.shapes.shapes import HalfSpace, PlacedShape


class BuiltScene(Protocol):
    """The scene a problem was built from, for reports, replays and files; `Scene.build()` makes it."""

    @property
    def items(self) -> Any:
        """The robots, bodies, walls and options that the user added."""

    @property
    def underway(self) -> bool:
        """Whether the start is a state of a run, which may penetrate."""

    @property
    def shapes(self) -> tuple[PlacedShape, ...]:
        """Every shape, with its place on the body that carries it."""

    @property
    def walls(self) -> dict[str, HalfSpace]:
        """Half-spaces by name."""

    @property
    def surfaces(self) -> list[Any]:
        """Meshes of the world."""

    @property
    def motions(self) -> list[Any]:
        """Prescribed motions of the world's parts, each once."""

    @property
    def omitted(self) -> tuple[Any, ...]:
        """The parts that were left out of the model."""

    @property
    def reduce(self) -> tuple[str, ...]:
        """Kinds of reductions of the model that are on."""

    @property
    def start(self) -> Any:
        """The initial configuration, where it was moved out of penetration, and by how much; else None."""

    @property
    def system(self) -> System:
        """The system the scene was built to."""

    @property
    def constraints(self) -> tuple[Constraint, ...]:
        """The constraints the scene was built to."""

    def picture(self, q: Array, t: float) -> str:
        """Return a picture of the scene at a configuration and a time [s], the text of an svg element."""

    def notes(self, problem: Any) -> list[str]:
        """Return what a run shall note about how the scene was built."""

    def state(self, problem: Any, q: Any, v: Any) -> tuple[Array, Array]:
        """Return q and v of a problem with values given by name."""

    def check_in_plane(self, problem: Any, q: Array) -> None:
        """Raise `InputError` if a configuration leaves the plane of a planar scene."""

    def report(self, problem: Any) -> str:
        """Return a text that lists the parts of the model, its reductions and their reasons."""
