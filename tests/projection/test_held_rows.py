"""Rows along displacements that hold the tangents of sticking contacts are those that the pseudoinverse gives."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbvi.projection.positions.held_rows import (
    FARTHEST,
    HARDLY,
    held_tangents,
    hold_rows,
    raises_near,
    strongest_tangents,
)
from mbvi.projection.tree import TreeMetric, solve

PARENT = np.array([-1, 0, 1, 2, 3, 4, 5, 6, 5, 8])
SIZE = len(PARENT)


def standing(rng, contacts, repeated=0, apart=0.0):
    """A mechanism of two branches with contacts, near and sticking, of which some have nearly the same tangents."""
    tree = np.zeros((SIZE, SIZE))
    for k in range(SIZE):
        i = k
        while i >= 0:
            tree[k, i] = rng.normal()
            i = PARENT[i]
        tree[k, k] = 2.0 + rng.random()
    metric = TreeMetric(tree.T @ tree, PARENT)
    J = rng.normal(size=(contacts, 3, SIZE))
    J[1 : 1 + repeated, 1:] = J[0, 1:] + apart * J[1 : 1 + repeated, 1:]
    J = J.reshape(-1, SIZE)
    A, W = np.empty(J.shape), np.empty(J.shape)
    solve(metric.lower, PARENT, J, W, A)
    near = np.concatenate([[True], rng.random(contacts - 1) < 0.8])
    sticks = np.concatenate([[True], rng.random(contacts - 1) < 0.6])
    return metric, J, W, near, sticks


def held(metric, W, near, sticks):
    """What the kernels leave of the normal rows, M^-1 times that, and that whitened."""
    m = len(near)
    L, Q = np.zeros((2 * m + 1, 2 * m + 1)), np.zeros((4 * m + 2, SIZE))
    size = held_tangents(W, near, sticks, L, Q)
    rows = np.full((3, m, SIZE), np.nan)
    return rows[:, : hold_rows(metric.lower, PARENT, W, near, size, Q, *rows)]


def projected(metric, J, near, sticks):
    """The same rows by the pseudoinverse, and the squared slips of displacements along tangents."""
    T = J.reshape(-1, 3, SIZE)[near & sticks, 1:].reshape(-1, SIZE)
    solved, normals = metric.solve_rows(T), J[::3][near]
    G = solved @ T.T
    return normals - (normals @ solved.T) @ np.linalg.pinv(G, HARDLY, hermitian=True) @ T, np.linalg.eigvalsh(G)


@given(
    seed=st.integers(0, 2**32 - 1),
    contacts=st.integers(1, 4),
    repeated=st.integers(0, 2),
    apart=st.sampled_from([0.0, 1e-9, 1e-6]),
)
def test_rows_are_those_of_the_pseudoinverse(seed, contacts, repeated, apart):
    metric, J, W, near, sticks = standing(np.random.default_rng(seed), contacts, min(repeated, contacts - 1), apart)
    expected, squares = projected(metric, J, near, sticks)
    found = held(metric, W, near, sticks)
    # where a displacement is at the cutoff, rounding decides
    if (np.abs(squares / (HARDLY * squares.max()) - 1.0) < 1e-6).any():
        return
    for rows, plain in zip(found, (expected, metric.solve_rows(expected), metric.whiten(expected.T).T), strict=True):
        np.testing.assert_allclose(rows, plain, rtol=0.0, atol=1e-11 * np.abs(J).max() * max(1.0, np.abs(plain).max()))


def test_no_displacement_along_what_is_left_moves_tangents(rng):
    """Two contacts stick with four tangents, one is far and one slips."""
    metric, J, W, _, _ = standing(rng, 4)
    near, sticks = np.array([True, True, False, True]), np.array([True, True, True, False])
    rows, displacements, _ = held(metric, W, near, sticks)
    tangents = J.reshape(-1, 3, SIZE)[:2, 1:].reshape(-1, SIZE)
    np.testing.assert_allclose(tangents @ displacements.T, 0.0, atol=1e-13 * np.abs(displacements).max())
    # those of others do
    assert np.abs(J[10] @ displacements.T).min() > 1e-3 * np.abs(displacements).max()
    assert rows.shape == (3, SIZE)


@pytest.mark.parametrize(
    ("apart", "held_too"), [(0.0, False), (1e-5, False), (1.9e-2, False), (2.1e-2, True), (0.3, True)]
)
def test_displacements_that_hardly_slip_are_not_held(apart, held_too):
    """Of two tangents that are apart a little, their difference is held from the cutoff on."""
    J = np.zeros((6, SIZE))
    J[0, 0] = J[3, 1] = J[1, 2] = J[4, 2] = J[2, 3] = J[5, 3] = 1.0
    J[4, 4] = J[5, 5] = apart
    J[0, 4] = 1.0
    metric, both = TreeMetric(np.eye(SIZE), PARENT), np.ones(2, bool)
    found = held(metric, J.copy(), both, both)[0]
    expected, squares = projected(metric, J, both, both)
    assert (squares.min() > HARDLY * squares.max()) == held_too
    np.testing.assert_allclose(found, expected, atol=1e-12)
    # the fourth entry is what their difference takes
    assert (abs(found[0, 4]) < 1e-3) == held_too


@pytest.mark.parametrize("contacts", [1, 3, 4, 20])
def test_the_strongest_tangents_span_the_largest_singular_vectors(contacts, rng):
    """Also of more rows than velocities, here six, and of rows that depend on each other."""
    W = rng.normal(size=(3 * contacts, 6)) * np.array([1.0, 1.0, 1.0, 1.0, 1e-3, 1e-6])
    near, sticks, Q = np.ones(contacts, bool), np.ones(contacts, bool), np.zeros((4 * contacts + 2, 6))
    size = strongest_tangents(W, near, sticks, Q)
    tangents = W[[i for i in range(len(W)) if i % 3]]
    _, s, V = np.linalg.svd(tangents, full_matrices=False)
    expected = V[s**2 > HARDLY * s[0] ** 2]
    assert size == len(expected) == min(2 * contacts, 4)
    np.testing.assert_allclose(Q[:size].T @ Q[:size], expected.T @ expected, rtol=0, atol=1e-8)


def test_of_a_row_along_held_tangents_nothing_is_left():
    J = np.zeros((3, SIZE))
    J[0, 0], J[1, 0], J[2, 1] = 1.0, 1.0, 1.0
    rows = held(TreeMetric(np.eye(SIZE), PARENT), J, np.ones(1, bool), np.ones(1, bool))
    np.testing.assert_array_equal(rows, 0.0)


@pytest.mark.parametrize(
    ("moved", "lower", "raises"),
    [
        (1.0, 1.0, True),
        (1.0 - 0.5e-8, 1.0, True),
        (1.0 - 2e-8, 1.0, False),
        (0.99 * FARTHEST, 1.0, True),
        (1.01 * FARTHEST, 1.0, False),
        (1e-12, -1.0, False),
    ],
)
def test_a_displacement_raises_gaps_and_is_not_too_long(moved, lower, raises):
    """One unit mass that moves along the normal; to raise nothing takes no displacement."""
    J = np.zeros((3, SIZE))
    J[0, 0] = 1.0
    d = moved * J[0]
    assert raises_near(np.eye(SIZE), J, J, np.ones(1, bool), d, np.array([lower]), 1e-8) == raises
