"""Solver for few rows that shares percussions evenly among dependent ones."""

from __future__ import annotations

from dataclasses import dataclass

from .nonnegative import nonnegative_least_squares
from .scaled_qp import Candidate, ScaledQP, WarmStart


@dataclass(frozen=True)
class NonnegativeLeastSquares:
    """Nonnegative least squares on G: a compiled dual active-set method, then the least percussions on all tight rows.

    The dual problem min u' G u / 2 - d' u over u >= 0 is a nonnegative least-squares problem: |A u|^2 / 2 - d' u. Where
    rows depend on each other, its velocity is unique but its percussions are not. The dual active-set method leaves
    some rows without any; the equations of all tight rows, solved by the least u, share it evenly. Where that u is
    negative somewhere, the nearest one to its positive part is taken, and again until none is.
    """

    def solve(self, qp: ScaledQP, start: WarmStart | None) -> Candidate | None:
        """Return shared percussions, or None if G has lost the digits that they need; see `Solver`."""
        u = nonnegative_least_squares(qp.G, qp.d)
        return None if u is None else Candidate(qp.combine(u), u, stationary=True)
