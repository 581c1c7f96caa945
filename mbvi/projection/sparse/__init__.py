"""Solvers for the sparse rows of many bodies."""
