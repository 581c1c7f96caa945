"""Random arguments of the kernels of the position projection: rows of a robot after the law, some of them sunk."""

import numpy as np

import mbvi
from support.robot_arguments import cone, restitution

TOLERANCE, STEP = 1e-8, 1e-3


class Landing:
    """A step in which some rows take part in the law, and some have sunk at its end.

    Parameters
    ----------
    rng : numpy.random.Generator
        Draws everything.
    """

    def __init__(self, rng):
        self.J, metric, self.v, self.x = cone(rng)
        m, n = self.J.shape
        self.A, self.W = metric.solve_rows(self.J), np.ascontiguousarray(metric.whiten(self.J.T).T)
        self.law = rng.random(m) < 0.7
        self.e = np.where(rng.random() < 0.7, 0.0, restitution(rng, m)) * np.ones(m)
        rows = self.J[self.law]
        found = mbvi.project(self.x, metric, rows, -self.e[self.law] * (rows @ self.v))
        self.w, self.rates = found.velocity, np.zeros((4, m))
        self.rates[:, self.law] = found.percussion, rows @ self.x, rows @ self.w, rows @ self.v
        self.displacement = 0.5 * STEP * (self.w - self.v)
        # gaps at the end are some of the tolerance or far beyond it
        end = rng.choice([-1e-4, -1e-6, 1e-9, 1e-5], size=m) * rng.random(m)
        self.gap = end - self.J @ self.displacement
        self.number = rng.integers(0, 3, size=m)
        self.point = np.where(rng.random((m, 1)) < 0.2, np.nan, rng.normal(size=(m, 3)))
        self.lever, self.squares = rng.choice([1.0, 0.3], size=m), rng.random((2, n))
        # where the law acts gradients differ a little
        self.law_J = self.J + 1e-3 * rng.normal(size=self.J.shape)
        self.law_A = metric.solve_rows(self.law_J)
        self.law_W = np.ascontiguousarray(metric.whiten(self.law_J.T).T)
        self.free = rng.random(n) < rng.choice([0.0, 0.5])
        self.near, self.closed = rng.random(m) < 0.7, self.law & (rng.random(m) < 0.7)

    @property
    def solved(self):
        return self.J, self.A, self.W


def empty(*shape):
    return np.full(shape, np.nan)


def landing_that_may_contradict(rng):
    """A landing in which now and then a sunk row has no gradient, so that nothing raises it."""
    of = Landing(rng)
    if rng.random() < 0.3:
        of.gap[0], of.near[0] = -1e-4, True
        for rows in of.solved:
            rows[0] = 0.0
    return of


def project_some(rng):
    of = landing_that_may_contradict(rng)
    m, n = of.J.shape
    return *of.solved, of.x, -of.gap - of.e * (of.J @ of.v), of.near, 0.0, empty(n), empty(3, m)


def raise_gaps(rng):
    of = landing_that_may_contradict(rng)
    m, n = of.J.shape
    bound = np.where(rng.random(m) < 0.5, 0.0, np.minimum(of.gap, 0.0))
    return *of.solved, of.gap, of.lever, bound, of.near, TOLERANCE, 1e-4, 0.0, empty(n)


def largest_travel(rng):
    of = Landing(rng)
    return of.squares, of.displacement


def largest_bend(rng):
    of = Landing(rng)
    return np.where(rng.random(of.squares.shape) < 0.5, 0.0, of.squares), of.displacement


def find_closed(rng):
    of = Landing(rng)
    end = of.gap + of.J @ of.displacement
    return of.gap, end, of.lever, of.e, of.law, of.rates, STEP, 0.5 * STEP, TOLERANCE, np.zeros(len(of.gap), bool)


def nearest_row(rng):
    of = Landing(rng)
    return of.number, of.point, int(rng.integers(len(of.gap))), of.law


def moved_from(rng):
    of = Landing(rng)
    return of.number, of.point, int(rng.integers(len(of.gap))), of.near, of.law


def follow_contacts(rng):
    of = Landing(rng)
    return of.number, of.point, of.J, of.v, of.near, of.law, of.closed, of.rates


def find_sunk(rng):
    of = Landing(rng)
    m = len(of.gap)
    rows = of.number, of.point, of.J, of.gap, of.lever, of.e
    masks = np.zeros(m, bool), empty(m), empty(m), np.zeros(m, bool)
    return *rows, of.v, of.w, of.displacement, of.law, of.rates, STEP, 0.5 * STEP, TOLERANCE, *masks


def join_rows(rng):
    of = Landing(rng)
    m, n = of.J.shape
    open_by = np.where(of.law, 0.0, 1e-5 * rng.random(m))
    return *of.solved, of.e, of.near, of.law, of.x, of.v, empty(n), open_by, 0.5 * STEP, 0.0, empty(4, m)


def tangent_velocity(rng):
    of = Landing(rng)
    times = 0.5 * STEP, TOLERANCE, 0.0
    masks = of.near, of.closed, of.law
    starts = of.x, of.x + 1e-3 * rng.normal(size=len(of.x)), of.v
    return *of.solved, of.gap, of.lever, of.e, *masks, *starts, *times, empty(len(of.v)), of.rates


def start_of_tangent(rng):
    of = Landing(rng)
    return of.A, of.law, of.rates, of.free, of.x, of.w, empty(len(of.v))


def settle_positions(rng):
    of = Landing(rng)
    m, n = of.J.shape
    opened = np.where(of.law, rng.choice([0.0, 0.1], size=m), 0.0)
    law = of.law_J, of.law_A, of.law_W
    rows = of.number, of.point, *of.solved, *law, of.gap, of.lever, of.e, opened, of.squares
    motion = of.x, of.v, of.w, of.displacement, of.law, np.zeros(m, bool), of.rates, empty(n), empty(n), of.free
    return *rows, *motion, STEP, 0.5 * STEP, TOLERANCE, float(rng.choice([1e-9, 1.0])), 1.0, 0.0


SETTLE_ARGUMENTS = {
    kernel.__name__: kernel
    for kernel in (
        project_some,
        raise_gaps,
        largest_travel,
        largest_bend,
        find_closed,
        nearest_row,
        moved_from,
        follow_contacts,
        find_sunk,
        join_rows,
        start_of_tangent,
        tangent_velocity,
        settle_positions,
    )
}
# how many of the last arguments mean something only where the kernel did not refuse
SETTLE_IF_ACCEPTED = {"project_some": 2, "raise_gaps": 1}
