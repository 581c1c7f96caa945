"""Arguments of the kernels that find the first gap of a mechanism that closes within a step."""

import numpy as np

from mbvi.constraints.features.feature_kernels import EDGES, POINTS, VERTEX_FACE, Surfaces
from mbvi.constraints.mechanism.held_rows import LIMIT, RowParts, row_room
from mbvi.schemes.event_driven.finding.closing_roots import ClosingRows
from mbvi.schemes.event_driven.finding.interpolants import COARSE, FINE
from mbvi.schemes.event_driven.rows.known_pairs import NO_PAIR, UNKNOWN_ROW
from mbvi.schemes.event_driven.runge_kutta import DEGREE
from mbvi.schemes.event_driven.stages import smooth_motion


def random_surfaces(rng, count):
    """Surfaces of some rows: faces, and directions that bound normals."""
    ranges = np.sort(rng.integers(0, 9, size=(count, 3, 2)), axis=2)
    bounds = np.column_stack([ranges[:, 2], rng.integers(0, 2, size=count)])
    return Surfaces(rng.normal(size=(8, 4)), ranges[:, :2].copy(), rng.normal(size=(8, 3)), bounds)


def closing_arguments(near):
    """Functions of rng and seed, by kernel; `near` returns a mechanism, its shapes and two pairs of them."""

    def parts_of():
        parts = np.zeros((2, 2, 2, 3))
        parts[:, 0, 0, 0], parts[:, 0, 0, 1] = (1.0, -1.0), (2.0, 1.5)
        return RowParts(np.full(2, LIMIT), np.array([[7, 6], [8, 7]]), parts, *np.zeros((2, 2)))

    def rows_of(rng, nv):
        pair = np.array([NO_PAIR, NO_PAIR, 0, int(rng.choice([1, 1, UNKNOWN_ROW]))])
        columns = np.array([True, True, False, False]), np.array([np.inf, np.inf, 1e-3, 1.0]), np.full(4, 1e-14)
        bounds = rng.choice([0.0, 0.01, 0.1, 1.0], size=4)
        reach = rng.choice([0.0, 0.5, 1.0], size=(2, nv)), np.array([0, 0, 1, 1])
        fall = rng.choice([0.5, 2.0], size=4)
        return ClosingRows(
            pair, *columns, *reach, bounds, fall, np.full(4, np.nan), np.zeros(4, np.int64), np.full((2, 4), np.nan)
        )

    def within_a_step(rng, seed):
        mechanism, shapes, pairs = near(seed)
        q, nv = mechanism.placed.copy(), len(mechanism.parent)
        way = rng.normal(size=(2, nv, DEGREE)), 0.1, q, rng.normal(size=nv)
        return (smooth_motion(mechanism, len(q), nv), parts_of(), shapes, pairs, rows_of(rng, nv), *way)

    def sum_at_nodes(rng, count, nodes):
        k = np.arange(1, 4)
        return np.cos(np.outer(nodes, k) + k) @ rng.normal(size=(3, count))

    def gaps_at_share(rng, seed):
        index = np.array([0, 1, 2])[: 1 + int(rng.integers(3))]
        return *within_a_step(rng, seed), rng.random(), index, float(rng.choice([0.0, np.inf])), np.full(3, np.nan)

    def smooth_root(rng, seed):
        known = sum_at_nodes(rng, 1, FINE.nodes)[:, 0].copy()
        return *within_a_step(rng, seed), FINE, np.array([int(rng.integers(2))]), 1e-3, known

    def root_by_slope(rng, seed):
        return *within_a_step(rng, seed), np.array([int(rng.integers(2))]), 1e-3, 1.0, float(rng.choice([3.0, 30.0]))

    def first_smooth_root(rng, seed):
        known = sum_at_nodes(rng, 3, COARSE.nodes)
        known[:, 2] = np.nan
        return *within_a_step(rng, seed), COARSE, FINE, np.arange(3), np.full(3, 1e-3), known

    def earliest_root(rng, seed):
        return *within_a_step(rng, seed), COARSE, FINE, np.arange(3), rng.choice([0.0, 1.0], size=3)

    def first_closing(rng, seed):
        found = within_a_step(rng, seed)
        travel = rng.choice([0.0, 0.01, 0.1], size=len(found[-1]))
        return *found, travel, COARSE, FINE, np.arange(int(rng.integers(2)))

    def row_at(rng, seed):
        motion, parts, shapes, pairs, _, *way = within_a_step(rng, seed)
        row = int(rng.integers(4))
        bodies = np.array([[2, 3], [4, 5]])
        return (motion, parts, row_room(), shapes, pairs, bodies, row % 2, row - 2 if row > 1 else NO_PAIR), way

    def write_gradient_at(rng, seed):
        found, (_, _, q, v) = row_at(rng, seed)
        return *found, q, np.full(len(v), np.nan)

    def crossing_share(rng, seed):
        found, (dense, h, q, v) = row_at(rng, seed)
        return *found, dense, h, rng.random(), q, v, 1e-12, 1.1, 4

    def write_differences(rng, seed):
        motion, _, shapes, pairs, _, dense, h, q, v = within_a_step(rng, seed)
        features = rng.normal(size=(3, 2, 2, 3))
        features[:, :, 1] /= np.linalg.norm(features[:, :, 1], axis=2, keepdims=True)
        kind, sides = np.array([VERTEX_FACE, EDGES, POINTS]), np.array([[2, 3], [2, 3], [4, 5]])
        parts = RowParts(kind, sides, features, *rng.random((2, 3)))
        which = motion, parts, shapes, pairs, np.arange(2), np.arange(3), np.array([0, 0, 1])
        return *which, random_surfaces(rng, 3), dense, h, rng.random(), q, v, np.full(2, np.nan)

    def nearest_contact(rng, seed):
        shapes, pairs = near(seed)[1:]
        return shapes, pairs, int(rng.integers(2)), np.inf, *np.full((2, 3), np.nan)

    return {
        "gaps_at_share": gaps_at_share,
        "smooth_root": smooth_root,
        "root_by_slope": root_by_slope,
        "first_smooth_root": first_smooth_root,
        "earliest_root": earliest_root,
        "first_closing": first_closing,
        "write_gradient_at": write_gradient_at,
        "crossing_share": crossing_share,
        "write_differences": write_differences,
        "nearest_contact": nearest_contact,
        "write_placed_distances": lambda rng, seed: (
            *near(seed)[1:],
            rng.permutation(2),
            float(rng.choice([0.0, np.inf])),
            np.full(2, np.nan),
        ),
    }
