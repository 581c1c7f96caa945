"""A five-bar linkage, a leg as Cassie's and a delta robot, drawn, against their motion in minimal coordinates."""

import numpy as np
import pytest

import mbvi
from support.linkages import CassieLeg, Delta, FiveBar, motion

DRAWN = np.random.default_rng(3).uniform(0.9, 1.1, size=(2, 7))
LINKAGES = [
    pytest.param(kind(tuple(scale[: len(kind().lengths)] * kind().lengths)), duration, id=f"{kind.__name__}-{k}")
    for kind, duration in ((FiveBar, 0.25), (CassieLeg, 0.2), (Delta, 0.12))
    for k, scale in enumerate(DRAWN)
]


def centres(linkage, duration):
    """Where the bodies should be."""
    return np.array(
        [0.5 * (begin + end) for begin, end, *_ in linkage.rods(motion(linkage.rods, linkage.start, duration))]
    )


def found_centres(run, linkage):
    """Where they are."""
    bodies = list(run.problem.system.bodies[1:])
    return run.q[-1].reshape(-1, 7)[[bodies.index(name) for name in linkage.names], :3]


@pytest.mark.parametrize(("linkage", "duration"), LINKAGES)
def test_the_motion_is_that_in_minimal_coordinates(linkage, duration):
    """`EventDriven` within ten tolerances, `Centered` at order 2; loops are closed to rounding."""
    problem, expected = linkage.scene().build(), centres(linkage, duration)
    run = mbvi.simulate(problem, mbvi.EventDriven(1e-10), duration=duration)
    assert np.abs(found_centres(run, linkage) - expected).max() <= 1e-9
    errors = []
    for step in (2e-3, 1e-3):
        run = mbvi.simulate(problem, mbvi.Centered(), step=step, duration=duration)
        errors.append(np.abs(found_centres(run, linkage) - expected).max())
        assert run.loop_gap().max() <= 1e-12
    assert 3.5 < errors[0] / errors[1] < 4.5, errors
    # it has moved
    assert np.abs(expected - centres(linkage, 0.0)).max() > 0.03
