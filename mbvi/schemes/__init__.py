"""Time-stepping schemes and the event-driven scheme: one file each."""

from .centered import Centered
from .event_driven import EventDriven
from .moreau_jean import MoreauJean
from .paoli import Paoli
from .schatzman_paoli import SchatzmanPaoli
from .scheme import Scheme, SchemeBase, Timing
from .step import Step
from .stewart_trinkle import StewartTrinkle

# the library's schemes by name
SCHEMES: dict[str, type[SchemeBase]] = {
    scheme.__name__: scheme for scheme in (Paoli, MoreauJean, Centered, SchatzmanPaoli, StewartTrinkle, EventDriven)
}

__all__ = [
    "SCHEMES",
    "Centered",
    "EventDriven",
    "MoreauJean",
    "Paoli",
    "SchatzmanPaoli",
    "Scheme",
    "SchemeBase",
    "Step",
    "StewartTrinkle",
    "Timing",
]
