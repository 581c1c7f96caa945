"""Random arguments of the kernels that measure displacements."""

import numpy as np


def write_travels_of_parts(rng):
    n = int(rng.integers(1, 9))
    part = np.sort(rng.integers(0, 3, n)) if n > 1 else np.zeros(1, int)
    return rng.random((2, n)), 1e-3 * rng.normal(size=n), part, np.ones(part[-1] + 1)


def write_bends(rng):
    squares, *others = write_travels_of_parts(rng)
    return np.where(rng.random(squares.shape) < 0.5, 0.0, squares), *others


def write_margins(rng):
    *moved, margins = write_bends(rng)
    return *moved, 1e-8, rng.random(), margins


def mark_unknown(rng):
    n = int(rng.integers(1, 4))
    return rng.random(n), np.where(rng.random(n) < 0.3, 0.0, 0.5), *rng.random((2, n)), np.ones(n, bool)


def _rows_of_parts(rng):
    """Rows that act on some of six parts of two velocities."""
    J, *_ = find_moved_groups(rng)
    return J, np.repeat(np.arange(6), 2)


def write_largest_of_parts(rng):
    J, part = _rows_of_parts(rng)
    return J, part, rng.random(6), np.ones(len(J))


def write_largest_of_rows(rng):
    J, part = _rows_of_parts(rng)
    return J, part, rng.random(len(J)), np.ones(6)


def spread_reach(rng):
    J, part = _rows_of_parts(rng)
    return J, rng.random(len(J)), part, rng.random(6), np.ones(len(J), bool)


def write_largest_of_groups(rng):
    k = int(rng.integers(1, 9))
    group = np.array([rng.integers(0, a + 1) for a in range(k)])
    for a in range(k):
        group[a] = group[group[a]]
    return rng.normal(size=k), group, np.ones(k)


def find_moved_groups(rng):
    """Six parts of two velocities, connected by some rows."""
    k, part = int(rng.integers(0, 7)), np.repeat(np.arange(6), 2)
    J = np.zeros((k, 12))
    for row in J:
        row[rng.permutation(12)[: int(rng.integers(1, 4))]] = 1.0
    moved = np.where(rng.random(12) < 0.1, 1e-9, 0.0)
    return J, moved, 1e-12, part, np.ones(12, bool), np.ones(k, bool)


def restore_columns(rng):
    k, width = int(rng.integers(1, 6)), int(rng.integers(0, 4))
    return *rng.normal(size=(2, 4 * k * width)), rng.permutation(k), rng.random(k) < 0.5


def write_along_axes(rng):
    k, width = int(rng.integers(1, 6)), int(rng.choice([0, 2, 3]))
    values, axes = rng.normal(size=4 * k * width), rng.normal(size=(2, k + 1, 2, 3))
    return values, *axes, rng.permutation(k), np.zeros(len(values))


GIVEN = (
    write_travels_of_parts, write_bends, write_margins, mark_unknown, write_largest_of_parts, write_largest_of_rows,
    find_moved_groups, restore_columns, write_along_axes, spread_reach, write_largest_of_groups,
)  # fmt: skip
SETTLE_ARGUMENTS = {kernel.__name__: kernel for kernel in GIVEN}
