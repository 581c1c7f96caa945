"""Steps of Newton's method for Coulomb's law: by velocities as by percussions, and as differences of its equations."""

import numpy as np
import pytest

from mbvi.projection.coulomb.friction import project_frictional
from mbvi.projection.coulomb.newton.cases import OPEN, SLIP, STICK, case_error
from mbvi.projection.coulomb.newton.directions import direction_by_velocities, newton_direction, takes_fewer_velocities
from mbvi.projection.coulomb.one_contact import coulomb_defect
from mbvi.projection.metric import DenseMetric
from support.coulomb_arguments import alone, crowd

SEEDS = range(200)


def equations(law, b, mu, p, case):
    """The arguments of the steps of Newton's method of given cases: velocities, scales and errors."""
    scale, error, u = np.full(len(mu), 0.7), np.empty(len(p)), law.G @ p + b
    case_error(u, p, mu, scale, case, error)
    return u, p, mu, scale, error, case


def step_of(law, b, mu, p, case):
    n = len(p)
    room = np.empty((n, n)), np.empty(n), np.zeros(n, np.int64), np.empty(n)
    assert newton_direction(law, *equations(law, b, mu, p, case), 0.0, *room)
    return room[-1]


@pytest.mark.parametrize("seed", SEEDS)
def test_steps_by_velocities_are_those_by_percussions(seed):
    law, b, mu, p, case = crowd(np.random.default_rng(seed))
    given = equations(law, b, mu, p, case)
    # as `newton_direction` finds them: percussions that are known, and those of the second tangents of joints
    known = np.repeat(case == OPEN, 3) | (np.repeat(mu == 0.0, 3) & (np.arange(len(p)) % 3 > 0))
    step = np.where(known | ((mu < 0.0).repeat(3) & (np.arange(len(p)) % 3 == 2)), -p, 0.0)
    step[::3] = np.where(mu < 0.0, -given[0][::3] / np.diag(law.G)[::3], step[::3])
    assert direction_by_velocities(law, *given, law.compliance, step)
    expected = step_of(alone(law.G), b, mu, p, case)
    np.testing.assert_allclose(step, expected, atol=1e-8 * np.abs(expected).max())


def test_velocities_are_solved_for_where_there_are_many_more_percussions():
    law, *_ = crowd(np.random.default_rng(0))
    closed = np.ones(len(law.scale), np.int64)
    assert not takes_fewer_velocities(law, closed, law.J.shape[1])
    assert takes_fewer_velocities(law, closed, 10 * law.J.shape[1])


@pytest.mark.parametrize("seed", SEEDS[:50])
def test_steps_take_away_the_error_of_their_equations_to_first_order(seed):
    law, b, mu, p, case = crowd(np.random.default_rng(seed))
    # closed contacts without friction slip
    case[:] = np.where(mu == 0.0, SLIP, np.where(case == OPEN, STICK, case))
    step, before = step_of(law, b, mu, p, case), equations(law, b, mu, p, case)[4]
    size = 1e-5 * np.abs(p).max() / np.abs(step).max()
    ahead, behind = (equations(law, b, mu, p + way * step, case)[4] for way in (size, -size))
    found, atol = (ahead - behind) / (2.0 * size), 1e-5 * np.abs(before).max()
    # the known normal percussion of a joint's friction counts as constant
    contacts = np.repeat(mu >= 0.0, 3)
    np.testing.assert_allclose(found[contacts], -before[contacts], rtol=0.0, atol=atol)


@pytest.mark.parametrize(("contacts", "mu"), [(8, 0.5), (40, 0.3), (60, 0.8)])
def test_a_body_on_many_points_moves_as_coulombs_law_says(contacts, mu):
    """A disc on a ring of points: far more rows than velocities; the law is checked in plain numpy."""
    rng = np.random.default_rng(contacts)
    M = np.diag([2.0, 2.0, 2.0, 0.05, 0.05, 0.09])
    angle = np.linspace(0.0, 2.0 * np.pi, contacts, endpoint=False)
    arms = np.column_stack([0.3 * np.cos(angle), 0.3 * np.sin(angle), np.full(contacts, -0.05)])
    rows = [np.hstack([axis, np.cross(arm, axis)]) for arm in arms for axis in np.eye(3)[[2, 0, 1]]]
    J, metric = np.array(rows), DenseMetric(M)
    for _ in range(20):
        x = np.concatenate([rng.normal(size=2), [-1.0], 2.0 * rng.normal(size=3)])
        found = project_frictional(x, metric, J, np.zeros(contacts), np.full(contacts, mu))
        p = found.percussion
        np.testing.assert_allclose(M @ (found.velocity - x), J.T @ p, atol=1e-11)
        each = np.sqrt(np.diag(J @ np.linalg.solve(M, J.T))[::3]).repeat(3)
        assert coulomb_defect(J @ found.velocity / each, p * each, np.full(contacts, mu)) <= 1e-9 * np.abs(x).max()
