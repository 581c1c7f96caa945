"""Names of the schemes on the command line."""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum
from functools import partial

from ...schemes import Centered, EventDriven, MoreauJean, Paoli, SchatzmanPaoli, Scheme, StewartTrinkle


class SchemeName(StrEnum):
    """The name of a scheme on the command line; `make()` returns the scheme."""

    make: Callable[[], Scheme | EventDriven]

    paoli = "paoli", Paoli
    moreau_jean = "moreau-jean", MoreauJean
    centered = "centered", Centered
    centered_projected = "centered-projected", partial(Centered, project_positions=True)
    schatzman_paoli = "schatzman-paoli", SchatzmanPaoli
    event_driven = "event-driven", EventDriven
    stewart_trinkle = "stewart-trinkle", StewartTrinkle

    def __new__(cls, word: str, make: Callable[[], Scheme | EventDriven]) -> SchemeName:
        """Return the member of a name."""
        name = str.__new__(cls, word)
        name._value_, name.make = word, make
        return name
