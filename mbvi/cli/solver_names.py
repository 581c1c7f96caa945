"""Projection solvers by the words of the command line."""

from __future__ import annotations

from enum import StrEnum

from ..projection import ActiveSet, ChosenSolver, DualActiveSet, ProxQP, SparsePCG


class SolverName(StrEnum):
    """A word of the command line, and `solver`, which it stands for."""

    solver: ChosenSolver

    proxqp = "proxqp", ProxQP()
    active_set = "active-set", ActiveSet()
    dual_active_set = "dual-active-set", DualActiveSet()
    sparse_pcg = "sparse-pcg", SparsePCG()

    def __new__(cls, word: str, solver: ChosenSolver) -> SolverName:
        """Return the member of a word."""
        name = str.__new__(cls, word)
        name._value_, name.solver = word, solver
        return name
