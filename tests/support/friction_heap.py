"""Heaps of spheres and boxes of contacts with friction: sparse rows, and the residual of Coulomb's law from outside."""

import numpy as np
from scipy.sparse import csr_array

from mbvi.projection import DiagonalMetric


def sphere_heap(rng, n, size=None):
    """Spheres thrown together: x, the metric, the rows of contacts of those that touch each other or the floor."""
    size = (1.2 * n) ** (1 / 3) if size is None else size
    centres = size * rng.random((n, 3))
    i, j = np.triu_indices(n, 1)
    near = np.linalg.norm(centres[j] - centres[i], axis=1) < 1.3
    low = np.flatnonzero(centres[:, 2] < 0.7)
    first, second = np.append(i[near], np.full(len(low), -1)), np.append(j[near], low)
    normal = centres[j[near]] - centres[i[near]]
    normal = np.vstack([normal / np.linalg.norm(normal, axis=1)[:, None], np.tile([0.0, 0.0, 1.0], (len(low), 1))])
    rows = np.zeros((len(normal), 3, 6 * n))
    for a, direction in enumerate(normal):
        frame = np.linalg.qr(np.column_stack([direction, rng.normal(size=(3, 2))]))[0].T
        frame[0] = direction
        for body, sign in ((first[a], -1.0), (second[a], 1.0)):
            if body >= 0:
                lever = -sign * 0.5 * direction
                rows[a, :, 6 * body : 6 * body + 6] = sign * np.hstack([frame, np.cross(lever, frame)])
    mass = 10.0 ** rng.uniform(-0.5, 0.5, n)
    metric = DiagonalMetric(np.column_stack([*[mass] * 3, *[0.1 * mass] * 3]).ravel())
    x = rng.normal(size=6 * n)
    x[2::6] -= 2.0
    return x, metric, csr_array(rows.reshape(3 * len(normal), -1))


def of_normals(values):
    """Bounds of all rows of contacts, shape (3 m,), of those of their normals; what they touch is at rest."""
    return np.column_stack([values, np.zeros((len(values), 2))]).ravel()


def law_residual(x, metric, J, lower, mu, p):
    """The natural-map residual of Coulomb's law, from nothing but the problem and its percussions."""
    m, full = len(mu), J.toarray()
    solved = metric.solve_rows(full)
    lengths = np.sqrt(np.einsum("ij,ij->i", full, solved)[::3])[:, None]
    shift = lower.reshape(m, 3)
    free = (full @ x).reshape(m, 3) / lengths
    u = ((full @ (x + p @ solved)).reshape(m, 3) - shift) / lengths
    q = p.reshape(m, 3) * lengths
    slipping = np.linalg.norm(u[:, 1:], axis=1)
    y = q - u - np.column_stack([mu * slipping, np.zeros((m, 2))])
    largest = max(np.abs(free).max(), np.abs(free - shift / lengths).max())
    return np.linalg.norm(q - onto_cone(y, mu), axis=1).max() / largest


def onto_cone(y, mu):
    """The nearest points of the cones |p_t| <= mu p_n, shape (m, 3)."""
    normal, across = y[:, 0], np.linalg.norm(y[:, 1:], axis=1)
    edge = np.maximum((normal + mu * across) / (1.0 + mu**2), 0.0)
    factor = mu * edge / np.where(across > 0.0, across, 1.0)
    on_edge = np.column_stack([edge, factor[:, None] * y[:, 1:]])
    inside = (normal >= 0.0) & (across <= mu * normal)
    return np.where(inside[:, None], y, on_edge)
