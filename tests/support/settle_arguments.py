"""Random arguments of the kernels that measure displacements."""

import numpy as np


def largest_travel(rng):
    n = int(rng.integers(1, 9))
    return rng.random((2, n)), 1e-3 * rng.normal(size=n)


def largest_bend(rng):
    squares, displacement = largest_travel(rng)
    return np.where(rng.random(squares.shape) < 0.5, 0.0, squares), displacement


SETTLE_ARGUMENTS = {kernel.__name__: kernel for kernel in (largest_travel, largest_bend)}
