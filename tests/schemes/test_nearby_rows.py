"""Rows that are known to first order near the configuration of a search."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import mbvi
from mbvi.constraints import AdmissibleSet
from mbvi.schemes.positions.nearby_rows import NearbyRows
from support.paths import ROBOTS


def quadruped(height):
    scene = mbvi.Scene(restitution=0.0)
    scene.add_halfspace((0, 0, 1))
    scene.add_urdf(ROBOTS / "quadruped/quadruped.urdf", position=(0, 0, height))
    return scene.build()


PROBLEM = quadruped(0.43)


@pytest.fixture
def searches(monkeypatch):
    """The arguments of each search."""
    made, active = [], AdmissibleSet.active
    monkeypatch.setattr(AdmissibleSet, "active", lambda *a, **k: made.append(a) or active(*a, **k))
    return made


@given(seed=st.integers(0, 10_000), size=st.floats(1e-9, 1e-4))
@settings(max_examples=30, deadline=None)
def test_gaps_to_first_order_are_those_of_a_search(seed, size):
    """To 1e-6 of the scene's length, and where the displacement is small to within its square."""
    rng, system = np.random.default_rng(seed), PROBLEM.system
    displacement = size * rng.normal(size=system.nv)
    near = NearbyRows(PROBLEM, 0.0, linear=True)
    margin = 0.02
    margins = np.array([margin])
    found = near.at(PROBLEM.q0, margins)
    q = system.integrate(PROBLEM.q0, displacement)
    known = near.at(q, margins)
    if near.place is q:
        assert PROBLEM.constraints.travel(displacement) > 1e-3 * PROBLEM.length
        return
    assert len(found.gap) and near.place is PROBLEM.q0
    true = PROBLEM.constraints.active(0.0, q, PROBLEM.tolerance + margin)
    if len(true.gap) == len(known.gap):
        np.testing.assert_array_equal(known.constraint, true.constraint)
        travel = PROBLEM.constraints.travel(displacement)
        error = np.abs(known.gap - true.gap).max(initial=0.0)
        assert error <= min(1e-6 * PROBLEM.length, 10.0 * travel**2 / PROBLEM.length) + 1e-14


def test_what_moved_too_far_is_searched_again(searches):
    near, system = NearbyRows(PROBLEM, 0.0, linear=True), PROBLEM.system
    upward = np.eye(system.nv)[2]
    near.at(PROBLEM.q0)
    near.at(system.integrate(PROBLEM.q0, 1e-6 * upward))
    assert len(searches) == 1
    near.at(system.integrate(PROBLEM.q0, 1e-2 * upward))
    assert len(searches) == 2
    # beyond the margin of a search nothing is known
    near.at(near.place, np.array([0.1]))
    assert len(searches) == 3
    # nor, with any margin, where gaps are not linear
    near.at(system.integrate(near.place, 1e-6 * upward))
    assert len(searches) == 3
    near.at(system.integrate(near.place, 1e-2 * upward))
    assert len(searches) == 4


def test_without_first_order_every_configuration_is_searched(searches):
    near = NearbyRows(PROBLEM, 0.0, linear=False)
    for _ in range(3):
        near.at(PROBLEM.q0)
    assert len(searches) == 3


def test_a_robot_that_lands_needs_at_most_two_searches_a_step(searches):
    run = mbvi.simulate(quadruped(0.45), mbvi.Centered(project_positions=True), step=1e-3, duration=0.6)
    assert run.impacts
    assert len(searches) <= 2 * (len(run.t) - 1)
    assert run.penetration()[-100:].max() < 1e-4
    assert run.diagnosis().energy_excess < 1e-3 * run.energy()[0]


@pytest.mark.parametrize("scheme", [mbvi.Centered(project_positions=True), mbvi.MoreauJean(project_positions=True)])
def test_no_edge_of_a_box_bears_load_above_the_floor(scheme):
    """A row that joins the law while it is open may close: the box neither stays tilted nor hovers."""
    c, s = np.cos(1.1e-5), np.sin(1.1e-5)
    height = 0.1 * c + 0.2 * s + 2e-9

    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0, 0, 1))
    scene.add_box((0.4, 0.3, 0.2), position=(0, 0, height), rotation=np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]))
    problem = scene.build()
    assert np.sum(problem.constraints.active(0.0, problem.q0, 1e-3).gap <= problem.tolerance) == 2
    run = mbvi.simulate(problem, scheme, step=3e-3, duration=0.3)
    gaps = problem.constraints.active(0.0, run.q[-1], 1e-3).gap
    assert len(gaps) == 4
    assert np.abs(gaps).max() < 2e-8
    assert np.abs(run.v[-1]).max() < 1e-6
