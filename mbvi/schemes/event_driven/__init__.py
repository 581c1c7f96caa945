"""The event-driven scheme: a Runge-Kutta integrator between located impacts, closings and releases."""

from .scheme import EventDriven

__all__ = ["EventDriven"]
