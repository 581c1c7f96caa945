"""Time-stepping schemes, one file each, and the schemes that choose their own steps."""

from .adaptive import Adaptive
from .centered import Centered
from .event_driven import EventDriven
from .moreau_jean import MoreauJean
from .paoli import Paoli
from .schatzman_paoli import SchatzmanPaoli
from .scheme import OwnStepsScheme, Scheme, SchemeBase, Timing
from .step import Step
from .stewart_trinkle import StewartTrinkle

# the library's schemes by name
SCHEMES: dict[str, type[SchemeBase]] = {
    scheme.__name__: scheme
    for scheme in (Paoli, MoreauJean, Centered, SchatzmanPaoli, StewartTrinkle, EventDriven, Adaptive)
}

__all__ = [
    "SCHEMES",
    "Adaptive",
    "Centered",
    "EventDriven",
    "MoreauJean",
    "OwnStepsScheme",
    "Paoli",
    "SchatzmanPaoli",
    "Scheme",
    "SchemeBase",
    "Step",
    "StewartTrinkle",
    "Timing",
]
