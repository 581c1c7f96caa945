"""Coulomb's law where contacts that stick are eliminated."""
