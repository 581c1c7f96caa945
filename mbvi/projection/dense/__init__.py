"""Solvers for dense rows."""
