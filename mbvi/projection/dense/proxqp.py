"""ProxQP solver: ProxSuite on the dual of the scaled QP."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from proxsuite import proxqp

from ..metric import Array
from .scaled_qp import Candidate, ScaledQP, WarmStart

# residual at which ProxSuite stops; the largest violation is between 0.5 and 1
_ACCURACY = 1e-12
# limit of iterations up to 100 rows; beyond it falls with m^3, the cost of an iteration, to the second number
_ITERATIONS, _FEWEST_ITERATIONS = 200, 10
# percussions below this share of the largest are set to zero
_NEGLIGIBLE = 1e-11
# upper bound of u, which stands for none
_UNBOUNDED = 1e20
# rows with a slack of this many times the largest violation are left out until violated; most solutions until then
_FAR, _MOST_TRIES = 1e8, 10


@dataclass(frozen=True)
class ProxQP:
    """ProxSuite's primal-dual augmented Lagrangian method on min u' G u / 2 - d' u, u >= 0.

    An outer loop of proximal steps adds a multiple of the identity to G, so that singular and nearly singular problems
    are solved like others; an inner semi-smooth Newton method solves each step. It stops at a residual of 1e-12 of the
    largest violation, where ProxSuite's iterations allow it. Every projection makes an object of its own, started from
    the last percussions: what an object keeps from earlier problems would change the last digits of the answer. On
    processors with AVX-512 they also depend on where ProxSuite's memory lies.

    Notes
    -----
    A. Bambade, S. El-Kazdadi, A. Taylor and J. Carpentier, PROX-QP: Yet another Quadratic Programming Solver for
    Robotics and beyond, RSS (2022).
    """

    def solve(self, qp: ScaledQP, start: WarmStart | None) -> Candidate | None:
        """Return ProxSuite's answer, negative percussions set to zero; see `Solver`."""
        u, stopped = np.zeros(len(qp.d)), ""
        near = qp.d > -_FAR
        for _ in range(_MOST_TRIES):
            u[near], stopped = _solve(qp.G[np.ix_(near, near)], qp.d[near], None if start is None else start.u[near])
            violated = ~near & (qp.G @ u < qp.d)
            if not violated.any():
                break
            near |= violated
        u[u <= _NEGLIGIBLE * u.max()] = 0.0
        return Candidate(qp.combine(u), u, True, stopped)


def _solve(G: Array, d: Array, start: Array | None) -> tuple[Array, str]:
    """Return ProxSuite's u, shape (m,), negative entries zero, and whether its limit of iterations `stopped` it."""
    m = len(d)
    solver = proxqp.dense.QP(m, 0, 0, True)
    settings = solver.settings
    settings.eps_abs, settings.eps_rel = _ACCURACY, 0.0
    settings.max_iter = max(_FEWEST_ITERATIONS, int(_ITERATIONS * min(1.0, (100 / m) ** 3)))
    settings.max_iter_in = max(30, settings.max_iter)
    # complementarity: without this a row that does not touch may keep a percussion of 1e-9
    settings.check_duality_gap, settings.eps_duality_gap_abs, settings.eps_duality_gap_rel = True, _ACCURACY, 0.0
    settings.default_mu_in = 1e-3
    settings.compute_preconditioner = False
    solver.init(H=G, g=-d, l_box=np.zeros(m), u_box=np.full(m, _UNBOUNDED))
    if start is not None and start.any():
        settings.initial_guess = proxqp.InitialGuess.WARM_START
        solver.solve(start, None, None)
    else:
        solver.solve()
    u = np.maximum(np.array(solver.results.x), 0.0)
    u[~np.isfinite(u)] = 0.0
    iterations = solver.results.info.iter_ext
    return u, f"after {iterations} iterations" if iterations >= settings.max_iter else ""
