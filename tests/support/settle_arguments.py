"""Random arguments of the kernels that measure displacements."""

import numpy as np


def largest_travel(rng):
    n = int(rng.integers(1, 9))
    return rng.random((2, n)), 1e-3 * rng.normal(size=n)


def largest_bend(rng):
    squares, displacement = largest_travel(rng)
    return np.where(rng.random(squares.shape) < 0.5, 0.0, squares), displacement


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


GIVEN = largest_travel, largest_bend, find_moved_groups, restore_columns, write_along_axes
SETTLE_ARGUMENTS = {kernel.__name__: kernel for kernel in GIVEN}
