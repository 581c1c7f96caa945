"""Schemes: one file each, no physics inside."""

from .centered import Centered
from .event_driven import EventDriven
from .moreau_jean import MoreauJean
from .paoli import Paoli
from .schatzman_paoli import SchatzmanPaoli
from .step import Scheme, Step
from .stewart_trinkle import StewartTrinkle

__all__ = ["Centered", "EventDriven", "MoreauJean", "Paoli", "SchatzmanPaoli", "Scheme", "Step", "StewartTrinkle"]
