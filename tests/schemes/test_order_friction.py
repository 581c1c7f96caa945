"""Schemes with friction against exact solutions: their order, rest without creep, and single impacts."""

import numpy as np
import pytest

import mbvi
from mbvi import reference
from mbvi_studies.chart.errors import fitted_order, path_errors, worst_errors
from support.orders import STEPS, runs

PAOLI, MOREAU, CENTERED, LIFTED, PLASTIC = (
    mbvi.Paoli(),
    mbvi.MoreauJean(),
    mbvi.Centered(),
    mbvi.Centered(project_positions=True),
    mbvi.StewartTrinkle(),
)
SCHEMES = (PAOLI, MOREAU, CENTERED, LIFTED, PLASTIC)
MOVING = [name for name in reference.ROUGH if name != "block that sticks"]
# a stop, a turn, a belt, rolling, impacts, a slip whose direction turns, stick and slip in turns, a jam
OF_EACH_KIND = (
    "block launched up, that comes back",
    "block on a belt",
    "box that tips",
    "ball that slides, then rolls",
    "ball with spin, six bounces",
    "tripod that slides and spins",
    "pendulum on a wall",
    "Painlevé rod",
)


def runs_it(scheme, case):
    return scheme is not PLASTIC or case.problem.restitution[0] == 0.0


def pairs(schemes, names):
    cases = {name: reference.ROUGH[name]() for name in names}
    return [
        pytest.param(scheme, case, id=f"{scheme!r}, {name}")
        for name, case in cases.items()
        for scheme in schemes
        if runs_it(scheme, case)
    ]


@pytest.mark.slow(seconds=13)
@pytest.mark.parametrize(
    ("scheme", "case"), [*pairs((PAOLI,), MOVING), *pairs((MOREAU, CENTERED, LIFTED, PLASTIC), OF_EACH_KIND)]
)
def test_schemes_are_of_order_one(scheme, case):
    """Configurations uniformly, and velocities in L1."""
    found = np.array([worst_errors(case, scheme, h, path_errors, runs(case)) for h in STEPS])
    assert min(fitted_order(STEPS, of_one) for of_one in found.T) >= 0.9
    assert found[-1, 0] < 0.02


@pytest.mark.parametrize(
    ("scheme", "case"), pairs(SCHEMES, ("block launched on a floor", "tripod that slides and spins"))
)
def test_errors_fall_with_the_step(scheme, case):
    coarse, fine = (
        path_errors(mbvi.simulate(case.problem, scheme, step=h, duration=case.duration, progress=False), case)
        for h in (8e-3, 2e-3)
    )
    assert fine[0] < 0.35 * coarse[0] and fine[1] < 0.35 * coarse[1]


@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
@pytest.mark.parametrize("share", [0.9, 0.9999])
def test_a_block_on_an_incline_does_not_creep(scheme, share):
    case = reference.block_on_incline(0.5, 0.5 * share, duration=0.3)
    run = mbvi.simulate(case.problem, scheme, step=1e-3, duration=0.3, progress=False)
    assert np.abs(case.problem.system.difference(case.problem.q0, run.q[-1])).max() <= 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
def test_a_block_on_an_incline_stays_for_ten_seconds(scheme):
    case = reference.block_on_incline(0.5, 0.5 * 0.9999, duration=10.0)
    run = mbvi.simulate(case.problem, scheme, step=1e-3, duration=10.0, every=1000, progress=False)
    assert np.abs(case.problem.system.difference(case.problem.q0, run.q[-1])).max() <= 1e-9


@pytest.mark.parametrize("scheme", (PAOLI, MOREAU, CENTERED, LIFTED), ids=repr)
@pytest.mark.parametrize(("mu", "sticks"), [(0.02, False), (0.12, False), (0.5, True)])
def test_the_first_impact_of_a_ball_with_spin_is_exact(scheme, mu, sticks):
    """Of sticking impacts whenever they are taken; slipping ones feel that the normal speed is off by g h."""
    case, h = reference.ball_with_spin(0.7, mu, bounces=1), 1e-3
    run = mbvi.simulate(case.problem, scheme, step=h, duration=case.duration, progress=False)
    off = np.linalg.norm(run.v[-1, :2] - case.at(case.duration)[1][:2])
    assert off <= (1e-12 if sticks else mu * 1.7 * 9.81 * h)
