"""Solver for few rows that shares percussions evenly among dependent ones."""

from __future__ import annotations

from dataclasses import dataclass

from .nonnegative import nonnegative_least_squares
from .scaled_qp import Candidate, ScaledQP, WarmStart


@dataclass(frozen=True)
class NonnegativeLeastSquares:
    """Nonnegative least squares on G: a compiled dual active-set method, then percussions of least norm.

    The dual problem min u' G u / 2 - d' u over u >= 0 is a nonnegative least-squares problem: |A u|^2 / 2 - d' u. If
    rows depend on each other, the velocity is unique but the percussions are not, and the dual active-set method leaves
    some rows without any. Therefore the equations of all tight rows are solved again, by the u of least norm, which
    shares percussions evenly. If that u has negative entries, the solution nearest to its positive part is taken; this
    is repeated until no entry is negative.
    """

    def solve(self, qp: ScaledQP, start: WarmStart | None) -> Candidate | None:
        """Return evenly shared percussions, or None if G is too ill-conditioned for them; see `Solver`."""
        u = nonnegative_least_squares(qp.G, qp.d)
        return None if u is None else Candidate(qp.combine(u), u, stationary=True)
