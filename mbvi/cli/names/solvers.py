"""Names of the projection solvers on the command line."""

from __future__ import annotations

from enum import StrEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ...projection import ChosenSolver


class SolverName(StrEnum):
    """The name of a projection solver on the command line, with its class in `mbvi.projection`."""

    class_name: str

    proxqp = "proxqp", "ProxQP"
    dual_active_set = "dual-active-set", "DualActiveSet"
    sparse_pcg = "sparse-pcg", "SparsePCG"

    def __new__(cls, word: str, class_name: str) -> SolverName:
        """Return the member of a name."""
        name = str.__new__(cls, word)
        name._value_, name.class_name = word, class_name
        return name

    @property
    def solver(self) -> ChosenSolver:
        """The solver."""
        # imported here for its weight: a text of help needs none
        from ... import projection

        made: ChosenSolver = getattr(projection, self.class_name)()
        return made
