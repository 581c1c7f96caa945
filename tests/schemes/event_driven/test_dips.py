"""Gaps of given functions that are below zero for a small part of a long step only."""

import numpy as np
import pytest

import mbvi

TOLERANCE = 1e-6


def course(posts, radius, speed=1.0, offset=0.0):
    """Return a point that flies along the x axis towards posts at given places."""
    system = mbvi.LagrangianSystem(lambda q: np.eye(2), lambda t, q, v: np.zeros(2), 2)
    constraints = [
        mbvi.GapFunction(
            lambda q, p=p: np.linalg.norm(q - [p, 0.0]) - radius,
            lambda q, p=p: (q - [p, 0.0]) / np.linalg.norm(q - [p, 0.0]),
            name=f"post {k}",
        )
        for k, p in enumerate(posts)
    ]
    return mbvi.Problem(system, constraints, [0.0, offset], [speed, 0.0], restitution=1.0)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("radius", [0.1, 0.01, 0.001])
def test_a_thin_post_is_met_in_a_long_flight(radius, seed):
    random = np.random.default_rng(seed)
    place, offset = random.uniform(1.0, 8.0), radius * random.uniform(-0.9, 0.9)
    run = mbvi.simulate(course([place], radius, offset=offset), mbvi.EventDriven(TOLERANCE), duration=10.0)
    met = place - np.sqrt(radius**2 - offset**2)
    assert [impact.constraints for impact in run.impacts] == [("post 0",)]
    np.testing.assert_allclose(run.impacts[0].time, met, rtol=0, atol=10 * TOLERANCE)
    assert len(run.t) < 30


@pytest.mark.parametrize("seed", range(4))
def test_the_first_of_several_posts_is_met(seed):
    random = np.random.default_rng(seed)
    places = random.uniform(1.0, 8.0, 5)
    run = mbvi.simulate(course(places, 0.02), mbvi.EventDriven(TOLERANCE), duration=10.0)
    assert run.impacts[0].constraints == (f"post {places.argmin()}",)
    np.testing.assert_allclose(run.impacts[0].time, places.min() - 0.02, rtol=0, atol=10 * TOLERANCE)


def test_a_post_that_is_passed_closely_is_not_met():
    run = mbvi.simulate(course([3.0], 0.01, offset=0.01 + 1e-5), mbvi.EventDriven(TOLERANCE), duration=10.0)
    assert run.impacts == () and abs(run.q[-1][0] - 10.0) < 1e-9
