"""Names of the schemes on the command line."""

from __future__ import annotations

from enum import StrEnum
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ...schemes import OwnStepsScheme, Scheme


class SchemeName(StrEnum):
    """The name of a scheme on the command line, with its class in `mbvi.schemes` and arguments of that."""

    class_name: str
    options: dict[str, Any]

    paoli = "paoli", "Paoli"
    moreau_jean = "moreau-jean", "MoreauJean"
    centered = "centered", "Centered"
    centered_projected = "centered-projected", "Centered", {"project_positions": True}
    schatzman_paoli = "schatzman-paoli", "SchatzmanPaoli"
    event_driven = "event-driven", "EventDriven"
    adaptive = "adaptive", "Adaptive"
    stewart_trinkle = "stewart-trinkle", "StewartTrinkle"

    def __new__(cls, word: str, class_name: str, options: dict[str, Any] | None = None) -> SchemeName:
        """Return the member of a name."""
        name = str.__new__(cls, word)
        name._value_, name.class_name, name.options = word, class_name, options or {}
        return name

    def make(self) -> Scheme | OwnStepsScheme:
        """Return the scheme."""
        # imported here for its weight: a text of help needs none
        from ... import schemes

        made: Scheme | OwnStepsScheme = getattr(schemes, self.class_name)(**self.options)
        return made
