"""Coulomb friction in the event-driven scheme: modes of closed contacts, their events, and the law that decides."""
