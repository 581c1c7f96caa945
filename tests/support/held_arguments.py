"""Random arguments of the kernels that hold tangents: contacts of a robot, some of which stick."""

import numpy as np

from mbvi.projection.tree import TreeMetric, solve
from support.robot_arguments import moving_robot


class Standing:
    """Contacts of a robot with their tangents; now and then one contact twice, or one that no velocity moves.

    Parameters
    ----------
    rng : numpy.random.Generator
        Draws everything.
    """

    def __init__(self, rng):
        system, *_ = moving_robot(rng)
        self.metric = TreeMetric(np.array(system.evaluation.mass), system.evaluation.parent)
        m = int(rng.integers(1, 1 + max(1, system.nv // 6)))
        self.J = rng.normal(size=(3 * m, system.nv)) * (rng.random((3 * m, system.nv)) < 0.5)
        if m > 1 and rng.random() < 0.3:
            # nearly the same now and then
            self.J[3:6] = self.J[:3] + rng.choice([0.0, 1e-6, 1e-3]) * rng.normal(size=(3, system.nv))
        if rng.random() < 0.1:
            self.J[0] = 0.0
        self.A, self.W = np.empty(self.J.shape), np.empty(self.J.shape)
        solve(self.metric.lower, self.metric.parent, self.J, self.W, self.A)
        self.near, self.sticks = rng.random(m) < 0.8, rng.random(m) < 0.6

    @property
    def size(self):
        return self.W.shape[1]

    def room(self):
        most = 2 * len(self.near) + 1
        return np.zeros((most, most)), np.zeros((2 * most, self.size))


def held_tangents(rng):
    of = Standing(rng)
    return of.W, of.near, of.sticks, *of.room()


def strongest_tangents(rng):
    of = Standing(rng)
    return of.W, of.near, of.sticks, of.room()[1]


def diagonalise(rng):
    n = int(rng.integers(0, 9))
    rows = rng.normal(size=(n, max(1, n - int(rng.integers(0, 3)))))
    return rows @ rows.T, np.full((n, n), np.nan)


def turn_basis(rng):
    of = Standing(rng)
    L, Q = of.room()
    size = min(2, of.size)
    Q[:size] = np.linalg.qr(rng.normal(size=(of.size, of.size)))[0][:size]
    # all tangents are held: of fewer rows than the basis has, rounding would be left
    held = np.ones(len(of.near), bool)
    W = rng.normal(size=of.W.shape)
    return W, held, held, size, L, Q


def hold_rows(rng):
    of = Standing(rng)
    size = int(rng.integers(0, 1 + min(2, of.size)))
    Q = np.ascontiguousarray(np.linalg.qr(rng.normal(size=(of.size, of.size)))[0])
    rows = np.full((3, len(of.near), of.size), np.nan)
    return of.metric.lower, of.metric.parent, of.W, of.near, size, Q, *rows


def raises_near(rng):
    of = Standing(rng)
    moved = rng.choice([1e-3, 1.0]) * rng.normal(size=of.size)
    lower = of.J[::3][of.near] @ moved + rng.choice([0.0, 1e-9, 1e-3]) * rng.normal(size=int(of.near.sum()))
    return of.metric.lower, of.J, of.W, of.near, moved, lower, 1e-8


HELD_ARGUMENTS = {
    kernel.__name__: kernel
    for kernel in (held_tangents, strongest_tangents, diagonalise, turn_basis, hold_rows, raises_near)
}
