"""ProxSuite on the dual box form min p' G p / 2 - d' p, p >= 0, kept warm per number of rows."""

from __future__ import annotations

import numpy as np
from proxsuite import proxqp

from .metric import Array

_ACCURACY = 1e-9
_MAX_KEPT = 64


class ProxQP:
    """One dense ProxQP object per number of rows, each started from its last result."""

    def __init__(self) -> None:
        self._kept: dict[int, proxqp.dense.QP] = {}

    def solve(self, G: Array, d: Array) -> Array:
        """Return approximate multipliers, shape (m,), of any sign within the solver's accuracy.

        Parameters
        ----------
        G : ndarray, shape (m, m)
            Delassus matrix with unit diagonal.
        d : ndarray, shape (m,)
            Missing rates, the largest of them 1.
        """
        m = len(d)
        qp = self._kept.get(m)
        if qp is None:
            qp = self._new(m)
            qp.init(H=G, g=-d, l_box=np.zeros(m), u_box=np.full(m, 1e20))
        else:
            qp.update(H=G, g=-d, update_preconditioner=False)
        qp.solve()
        p = np.array(qp.results.x)
        if qp.results.info.status != proxqp.PROXQP_SOLVED:
            # a failed object must not start the next problem from where it stopped
            self._kept.pop(m, None)
            p[~np.isfinite(p)] = 0.0
        return p

    def _new(self, m: int) -> proxqp.dense.QP:
        if len(self._kept) >= _MAX_KEPT:
            self._kept.clear()
        qp = proxqp.dense.QP(m, 0, 0, True)
        settings = qp.settings
        settings.eps_abs = _ACCURACY
        settings.eps_rel = 0.0
        settings.max_iter = 1000
        settings.default_mu_in = 1e-3
        settings.compute_preconditioner = False
        settings.initial_guess = proxqp.InitialGuess.WARM_START_WITH_PREVIOUS_RESULT
        self._kept[m] = qp
        return qp
