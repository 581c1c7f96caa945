"""Coulomb's law for contacts of bodies that do not touch each other: that of each as if alone."""

import numpy as np
import pytest

from mbvi.projection.coulomb.friction import project_frictional
from mbvi.projection.coulomb.separate_laws import label_contacts
from mbvi.projection.metric import DenseMetric


def part(rng, contacts, nv=6):
    """The metric of a body or a mechanism, rows of its contacts, and its velocity under forces alone."""
    # M^-1 of a diagonal M has the same bits in any company
    return np.diag(rng.uniform(0.5, 2.0, size=nv)), rng.normal(size=(3 * contacts, nv)), rng.normal(size=nv)


def together(parts, order):
    """The metric, the rows with contacts in some order, and the velocity of all parts."""
    widths = [len(x) for _, _, x in parts]
    M, J = np.zeros((sum(widths), sum(widths))), np.zeros((3 * len(order), sum(widths)))
    row = column = 0
    for (mass, own, _), width in zip(parts, widths, strict=True):
        M[column : column + width, column : column + width] = mass
        J[row : row + len(own), column : column + width] = own
        row, column = row + len(own), column + width
    J = J.reshape(len(order), 3, -1)[order].reshape(J.shape)
    return M, J, np.concatenate([x for _, _, x in parts])


@pytest.mark.parametrize("seed", range(40))
def test_each_island_is_solved_as_if_alone(seed):
    """To the last bit: with one contact and several, more than a body has velocities, and some that do not close."""
    rng = np.random.default_rng([seed, 3])
    parts = [part(rng, int(rng.integers(1, 6))) for _ in range(3)]
    sizes = [len(J) // 3 for _, J, _ in parts]
    owner = np.repeat(range(3), sizes)
    order, mu = rng.permutation(len(owner)), rng.uniform(0.1, 0.7, size=len(owner))
    M, J, x = together(parts, order)
    lower = -0.3 * rng.random(len(owner))
    found = project_frictional(x, DenseMetric(M), J, lower, mu[order])
    closing = 0
    for k, (mass, own, free) in enumerate(parts):
        here = np.flatnonzero(owner[order] == k)
        rows = own.reshape(-1, 3, 6)[order[here] - sum(sizes[:k])].reshape(-1, 6)
        alone = project_frictional(free, DenseMetric(mass), rows, lower[here], mu[order[here]])
        assert found.velocity[6 * k : 6 * k + 6].tobytes() == alone.velocity.tobytes()
        assert found.percussion.reshape(-1, 3)[here].tobytes() == alone.percussion.tobytes()
        assert found.case[here].tobytes() == alone.case.tobytes()
        assert found.residual >= alone.residual
        closing += alone.percussion.any()
    assert closing > 0


def test_a_start_does_not_change_the_answer_of_islands():
    """Of islands with one answer and with several."""
    rng = np.random.default_rng(5)
    parts = [part(rng, 1), part(rng, 4), part(rng, 2)]
    M, J, x = together(parts, np.arange(7))
    metric, mu = DenseMetric(M), np.full(7, 0.3)
    first = project_frictional(x, metric, J, np.zeros(7), mu)
    again = project_frictional(1.001 * x, metric, J, np.zeros(7), mu, start=first)
    np.testing.assert_allclose(again.velocity, 1.001 * first.velocity, rtol=0.0, atol=1e-9)


def test_islands_share_a_velocity_or_a_bound():
    """Contacts 0 and 2 move the first body, 2 and 3 the second, 1 none; the friction of 4 is bounded by 1."""
    J = np.zeros((15, 18))
    J[0, 0] = J[6, 0] = J[6, 6] = J[10, 8] = J[13, 14] = 1.0
    J[9, 7] = 1.0
    owner, label = np.zeros(18, np.int64), np.zeros(5, np.int64)
    assert label_contacts(J, J, np.array([-1, -1, -1, -1, 1]), owner, label) == 3
    assert label.tolist() == [0, 1, 0, 2, 1]
    # the contact that moves each velocity first
    assert owner.tolist() == [0, -1, -1, -1, -1, -1, 2, 3, 3, -1, -1, -1, -1, -1, 4, -1, -1, -1]
    J[9, 6] = 1.0
    assert label_contacts(J, J, np.array([-1, -1, -1, -1, 1]), owner, label) == 2
    assert label.tolist() == [0, 1, 0, 0, 1]
    # what a contact moves by the mass matrix counts too
    A = J.copy()
    A[0, 14] = 1.0
    assert label_contacts(J, A, np.full(5, -1), owner, label) == 2
    assert label.tolist() == [0, 1, 0, 0, 0]
