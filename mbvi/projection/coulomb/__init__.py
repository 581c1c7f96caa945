"""Solvers of Coulomb's law."""
