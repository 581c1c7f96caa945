"""The tests of SimBenchmark in benchmarks/simbenchmark_cases.py: exact solutions, errors, equal starts in MuJoCo."""

import sys

import numpy as np
import pinocchio as pin
import pytest

import mbvi
from support.paths import DOCS, ROOT

sys.path.append(str(ROOT / "benchmarks"))

import simbenchmark
import simbenchmark_cases as cases
from simbenchmark_cases import TRIALS, States
from simbenchmark_engines import DELIVERED, Ours, Theirs, agreement, problems


def test_rolling_solves_newtons_equations():
    """Unknown: accelerations of box and balls, spin of the balls, friction at one ball."""
    n, m, r = cases.BALLS**2, cases.BALL_MASS, 0.5
    weight = (cases.BOX_MASS + n * m) * cases.G
    a = np.array(
        [
            [cases.BOX_MASS, 0.0, 0.0, n],
            [0.0, m, 0.0, -1.0],
            [0.0, 0.0, 0.4 * m * r**2, -r],
            [1.0, -1.0, -r, 0.0],
        ]
    )
    b = np.array([cases.PUSH - cases.MU_GROUND_BOX * weight, 0.0, 0.0, 0.0])
    box, ball, _, friction = np.linalg.solve(a, b)
    assert cases.rolling_accelerations() == pytest.approx((box, ball), rel=1e-14)
    # the balls roll: their friction is below the limit; and the box slides
    assert friction < cases.MU_BOX_BALL * m * cases.G and box > 0.0
    assert np.linalg.norm(cases.DIRECTION) == pytest.approx(1.0)


def test_exact_states_have_no_error():
    h = 1e-2
    times = h * np.arange(400)
    velocities = np.array([a * times for a in cases.rolling_accelerations()]).T[..., None] * cases.DIRECTION
    assert cases.rolling_error(States(velocities=velocities), h) == 0.0
    assert cases.rolling_error(
        States(velocities=velocities + np.array([[0.3, 0.0, 0.4], [0.0, 0.0, 0.0]])), h
    ) == pytest.approx(0.25)
    energy = cases.BOUNCING**2 * cases.MASS * cases.G * cases.HEIGHT
    assert cases.bouncing_error(States(energy=np.full(5, energy)), h) == 0.0
    assert cases.bouncing_error(States(energy=energy + np.array([3.0, -3.0])), h) == pytest.approx(9.0)
    assert cases.drift_error(States(energy=np.array([7.0, 7.0, 10.0])), h) == pytest.approx(3.0)
    momentum = np.tile([0.0, 50.0, 0.0], (4, 1))
    assert cases.momentum_error(States(momentum=momentum), h) == 0.0
    assert cases.momentum_error(States(momentum=momentum + np.array([3.0, 0.0, 4.0])), h) == pytest.approx(25.0)


def test_overlaps_are_those_of_all_pairs_and_the_floor():
    """Written out over all pairs."""
    rng = np.random.default_rng(3)
    centres = rng.uniform(0.0, 0.6, (2, 40, 3))
    expected = []
    for place in centres:
        depth = np.maximum(0.0, 0.1 - place[:, 2]) ** 2
        pairs = [max(0.0, 0.2 - np.linalg.norm(place[i] - place[j])) ** 2 for i in range(40) for j in range(i)]
        expected.append(depth.sum() + sum(pairs))
    assert cases.overlap_error(States(centres), 1e-3) == pytest.approx(np.mean(expected), rel=1e-12)
    # nothing overlaps at the start of 666
    assert cases.overlap_error(States(cases.six_centres(cases.LOW)[None]), 1e-3) == 0.0


def test_the_creep_is_that_after_a_fifth_of_the_run():
    centres = np.zeros((10, 1, 3))
    centres[:2], centres[5:, 0, 0] = 7.0, 0.2
    assert cases.creep_error(States(centres), 1e-3) == pytest.approx(0.04 * 5 / 8)


@pytest.mark.parametrize("name", TRIALS)
def test_both_engines_start_from_the_same_state(name):
    """Places, velocities, energy and momentum, of which each engine computes its own."""
    assert agreement(name)() < 1e-9


def test_both_engines_have_the_same_robot():
    _, flying = problems("energy")
    model, theirs = flying.model("anymal"), Theirs("energy", 1e-3, DELIVERED).model
    assert theirs.body_mass.sum() == pytest.approx(pin.computeTotalMass(model), rel=1e-12)
    assert theirs.nv == model.nv == 18
    # the push is upright in the world, however the base is turned
    pin.seed(0)
    q = pin.randomConfiguration(model, -np.ones(model.nq), np.ones(model.nq))
    turn = pin.XYZQUATToSE3(q[:7]).rotation
    tau = np.zeros(18)
    cases.lifting_torque(2.0)(0.0, q, np.zeros(18), tau)
    np.testing.assert_allclose(turn @ tau[:3], [0.0, 0.0, 4.0 * cases.G], atol=1e-12)
    assert not tau[3:].any()


def test_the_standing_robot_falls_onto_its_feet():
    problem = problems("PD")[0]
    rows, gap = problem.constraints, problem.constraints.gap(0.0, problem.q0)
    ground = sorted((gap[k], rows.name(k)) for k in range(len(rows)) if rows.name(k).endswith(" | ground"))
    assert all("_FOOT" in name and height < 0.05 for height, name in ground[:4])
    assert gap.min() > 0.0 and problem.q0[2] == 0.54


def test_mbvi_is_exact_where_the_definition_is():
    """Short runs by the scheme that keeps the energy."""
    h = 2e-3
    run = mbvi.simulate(problems("rolling")[0], mbvi.Centered(), step=h, duration=0.02, progress=False)
    states = Ours("rolling", h)._states(run.q[:-1], run.v[:-1])
    assert cases.rolling_error(states, h) < 1e-20
    run = mbvi.simulate(problems("bouncing")[0], mbvi.Centered(), step=1e-2, duration=3.0, progress=False)
    states = Ours("bouncing", 1e-2)._states(run.q[:-1], run.v[:-1])
    assert len(run.impacts) and cases.bouncing_error(states, 1e-2) < 1e-15


SHORT = {
    # step, duration, and the largest error in the unit of the test: rounding where the scheme is exact
    "rolling": (1e-2, 0.1, 1e-20),
    "bouncing": (1e-2, 3.0, 1e-15),
    "666": (1e-2, 0.5, 1e-6),
    "elastic 666": (1e-2, 0.7, 1e-15),
}


@pytest.mark.parametrize("name", SHORT)
def test_the_default_scheme_is_ahead_of_mujoco_on_error(name, monkeypatch):
    h, duration, most = SHORT[name]
    monkeypatch.setitem(TRIALS, name, TRIALS[name]._replace(duration=duration))
    mine, theirs = (TRIALS[name].error(one.states(), h) for one in (Ours(name, h), Theirs(name, h, DELIVERED)))
    assert mine < most and mine < theirs


@pytest.mark.parametrize(("name", "projected"), [("bouncing", False), ("elastic 666", False), ("momentum", True)])
def test_elastic_grains_have_the_scheme_that_keeps_their_energy(name, projected):
    run = mbvi.simulate(problems(name)[0], step=1e-2, duration=2e-2, progress=False)
    assert run.scheme == "Centered" and run.record.scheme.project_positions == projected


@pytest.mark.parametrize("name", ["rolling", "666"])
def test_grains_that_come_to_rest_have_the_scheme_that_lands_on_contacts(name):
    assert mbvi.simulate(problems(name)[0], step=1e-2, duration=2e-2, progress=False).scheme == "StewartTrinkle"


@pytest.mark.slow(seconds=40)
def test_stewart_trinkle_finishes_rolling():
    """The whole run at the step of the table, in which balls come near the edge of the pattern."""
    ours = Ours("rolling", 4e-3, mbvi.StewartTrinkle())
    states = ours.states()
    assert len(states.velocities) == 1000 and cases.rolling_error(states, 4e-3) < 1e-20


def test_the_page_has_the_numbers_of_its_file():
    records = simbenchmark.read_numbers()
    assert {r.test for r in records} == set(TRIALS)
    page = (DOCS / "benchmarks/simbenchmark.md").read_text()
    assert simbenchmark.summary(records) in page and simbenchmark.verdict(records) in page
