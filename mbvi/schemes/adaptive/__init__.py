"""Error control of `Centered` on any scene: steps taken twice, and cut where bodies land."""

from .scheme import Adaptive

__all__ = ["Adaptive"]
