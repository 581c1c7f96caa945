"""Kernels of the cases of Coulomb's law: which is nearest to the percussions of each contact, and how far it is off."""

from __future__ import annotations

import numpy as np

from ....compiled import kernel
from ...metric import Array

OPEN, STICK, SLIP = 0, 1, 2


@kernel("void(f8[:,::1], f8[::1])")
def tangential_scale(G: Array, scale: Array) -> None:
    """Write the inverse of the largest eigenvalue of each contact's tangential block, shape (m,): any axes give it."""
    for a in range(len(scale)):
        i = 3 * a
        mean, half = 0.5 * (G[i + 1, i + 1] + G[i + 2, i + 2]), 0.5 * (G[i + 1, i + 1] - G[i + 2, i + 2])
        largest = mean + np.sqrt(half * half + G[i + 1, i + 2] ** 2)
        scale[a] = 1.0 / largest if largest > 0.0 else 1.0


@kernel("void(f8[::1], f8[::1], f8[::1], f8[::1], i8[::1])")
def find_cases(u: Array, p: Array, mu: Array, scale: Array, case: Array) -> None:
    """Write which case of the law each contact is nearest to, shape (m,): OPEN, STICK or SLIP.

    u, p, mu: see `coulomb_defect`; `scale`: see `tangential_scale`. A closed contact without friction slips.
    """
    for a in range(len(mu)):
        i = 3 * a
        normal = p[i] - u[i]
        t, s = p[i + 1] - scale[a] * u[i + 1], p[i + 2] - scale[a] * u[i + 2]
        if normal <= 0.0:
            case[a] = OPEN
        else:
            case[a] = STICK if mu[a] != 0.0 and np.sqrt(t * t + s * s) <= abs(mu[a]) * normal else SLIP


@kernel("f8(f8[::1], f8[::1], f8[::1], f8[::1], i8[::1], f8[::1])")
def case_error(u: Array, p: Array, mu: Array, scale: Array, case: Array, error: Array) -> float:
    """Write by how much each contact violates the equations of its case, shape (3 m,); return the sum of squares."""
    total = 0.0
    for a in range(len(mu)):
        i = 3 * a
        if case[a] == OPEN:
            error[i], error[i + 1], error[i + 2] = p[i], p[i + 1], p[i + 2]
        else:
            error[i] = u[i]
            error[i + 1], error[i + 2] = scale[a] * u[i + 1], scale[a] * u[i + 2]
            if case[a] == SLIP:
                t, s = p[i + 1] - error[i + 1], p[i + 2] - error[i + 2]
                length = np.sqrt(t * t + s * s)
                factor = abs(mu[a]) * (p[i] - u[i]) / length if length > 0.0 else 0.0
                error[i + 1], error[i + 2] = p[i + 1] - factor * t, p[i + 2] - factor * s
        total += error[i] ** 2 + error[i + 1] ** 2 + error[i + 2] ** 2
    return total
