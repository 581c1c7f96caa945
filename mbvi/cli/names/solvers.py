"""Names of the projection solvers on the command line."""

from __future__ import annotations

from enum import StrEnum

from ...projection import ChosenSolver, DualActiveSet, ProxQP, SparsePCG


class SolverName(StrEnum):
    """The name of a projection solver on the command line; `solver` is the object."""

    solver: ChosenSolver

    proxqp = "proxqp", ProxQP()
    dual_active_set = "dual-active-set", DualActiveSet()
    sparse_pcg = "sparse-pcg", SparsePCG()

    def __new__(cls, word: str, solver: ChosenSolver) -> SolverName:
        """Return the member of a name."""
        name = str.__new__(cls, word)
        name._value_, name.solver = word, solver
        return name
