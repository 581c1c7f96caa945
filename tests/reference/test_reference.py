"""Every reference against the laws it claims to solve, and against published figures; no scheme takes part."""

from functools import partial
from itertools import pairwise

import numpy as np
import pytest

import mbvi
from mbvi import reference
from mbvi.reference import located
from mbvi.reference.law import law
from support.references import CASES, every_case

E = (0.0, 0.5, 1.0)
# the forcing of these does work
FORCED = ("impact oscillator", "chaotic oscillator")


def between(case, count=5):
    """Instants inside each smooth stretch, away from its ends."""
    ends = case.breakpoints
    share = np.linspace(0.2, 0.8, count)
    return [float(a + s * (b - a)) for a, b in pairwise(ends) if b - a > 1e-4 for s in share]


def slope(function, t, h):
    """The derivative by central differences of order six."""
    weights = (45.0, -9.0, 1.0)
    return sum(w * (function(t + k * h) - function(t - k * h)) for k, w in enumerate(weights, 1)) / (60 * h)


def touching(case, q, tolerance=1e-9):
    return case.problem.constraints.active(0.0, q, tolerance).jacobian


def test_each_has_a_name_of_its_own():
    for e in E:
        names = [r.name for r in reference.references(e)]
        assert len(set(names)) == len(names) >= 12


@every_case
def test_it_starts_where_its_problem_starts(case):
    q, v = case.at(case.problem.t0)
    np.testing.assert_array_equal(q, case.problem.q0)
    np.testing.assert_array_equal(v, case.problem.v0)
    assert case.source
    assert np.all(np.diff(case.impacts) > 0)
    assert ((case.impacts > 0) & (case.impacts <= case.duration)).all()


def states_at_once(case):
    times = np.concatenate([np.linspace(0, case.duration, 150)[::-1], case.breakpoints, np.nextafter(case.impacts, 0)])
    for many, each in zip(case.at(times), zip(*map(case.at, times.tolist()), strict=True), strict=True):
        np.testing.assert_allclose(many, each, rtol=1e-14, atol=1e-14)
    with pytest.raises(mbvi.InputError, match="known from 0 s"):
        case.at([0.0, 1.1 * case.duration])


@every_case
def test_states_at_many_times_are_those_at_each(case):
    states_at_once(case)


@pytest.mark.parametrize("make", reference.ROUGH.values(), ids=reference.ROUGH)
def test_states_with_friction_at_many_times_are_those_at_each(make):
    states_at_once(make())


@every_case
def test_it_stays_in_k(case):
    gaps = [case.problem.constraints.gap(t, case.at(t)[0]) for t in np.linspace(0, case.duration, 400)]
    assert np.min(gaps) > -1e-10


@every_case
def test_the_configuration_moves_with_the_velocity(case):
    system = case.problem.system
    for t in between(case):
        q, v = case.at(t)
        h = 1e-3 * min(1.0, np.abs(case.breakpoints - t).min() / 4e-3)
        rate = slope(lambda s, q=q: system.difference(q, case.at(s)[0]), t, h)
        np.testing.assert_allclose(rate, v, atol=1e-8)


@every_case
def test_the_equation_of_motion_holds_between_impacts(case):
    """Equations (1), (3) and (4): M dv/dt - g is zero, or a nonnegative combination of touching gradients."""
    system = case.problem.system
    for t in between(case):
        q, v = case.at(t)
        h = 1e-3 * min(1.0, np.abs(case.breakpoints - t).min() / 4e-3)
        excess = system.metric(q).apply(slope(lambda s: case.at(s)[1], t, h)) - system.force(t, q, v)
        J = touching(case, q)
        share = np.linalg.lstsq(J.T, excess, rcond=None)[0] if len(J) else np.zeros(0)
        np.testing.assert_allclose(J.T @ share, excess, atol=1e-6)
        assert (share >= -1e-6).all()


@every_case
def test_the_law_holds_at_impacts(case):
    """(5), (7), (13)-(15): admissible velocities, a jump along the gradients that press, and these are reflected."""
    e = float(case.problem.restitution[0])
    for t in case.impacts[:12]:
        q, after = case.at(t)
        before = case.at(np.nextafter(t, -np.inf))[1]
        M, J = case.problem.system.metric(q), touching(case, q, 1e-8)
        jump = M.apply(after - before)
        p = np.linalg.lstsq(J.T, jump, rcond=None)[0]
        scale = np.abs(before).max() + np.abs(after).max()
        assert np.abs(jump).max() > 0
        np.testing.assert_allclose(J.T @ p, jump, atol=1e-8 * scale)
        assert (p >= -1e-8 * scale).all()
        reflected = J @ (after + e * before)
        assert (reflected >= -1e-8 * scale).all()
        assert np.abs(p * reflected).max() <= 1e-8 * scale**2
        assert (J @ before <= 1e-8 * scale).all()


@pytest.mark.parametrize(
    "case", [r for (e, n), r in CASES.items() if n not in FORCED], ids=[str(k) for k in CASES if k[1] not in FORCED]
)
def test_the_energy_never_rises_and_is_kept_at_e_1(case):
    system = case.problem.system

    def energy(t):
        q, v = case.at(t)
        return system.kinetic_energy(q, v) + system.potential_energy(t, q)

    values = np.array([energy(t) for t in np.linspace(0, case.duration, 300)])
    scale = max(values[0], system.kinetic_energy(*case.at(0.0)), 1.0)
    assert np.diff(values).max() <= 1e-11 * scale
    if case.problem.restitution[0] == 1.0:
        np.testing.assert_allclose(values, values[0], atol=1e-11 * scale)


def test_the_rocking_block_of_the_literature():
    """Impact times of the frictionless block at e = 0.5, as computed with Siconos's own example of it."""
    block = reference.rocking_block(0.5, duration=0.616)
    np.testing.assert_allclose(block.impacts, [0.1837515, 0.2962969, 0.4726932, 0.5185766, 0.6146458], atol=5e-8)


@pytest.mark.parametrize("e", [0.3, 0.5, 0.8])
def test_the_ball_comes_to_rest_at_its_accumulation(e):
    fall = np.sqrt(2.0 / 9.81)
    rest = fall * (1 + e) / (1 - e)
    ball = reference.bouncing_ball(e, duration=rest + 1.0)
    assert ball.switches[0] == pytest.approx(rest, rel=1e-14)
    assert ball.impacts[-1] < rest
    np.testing.assert_allclose(ball.impacts[:3], fall * np.array([1, 1 + 2 * e, 1 + 2 * e + 2 * e**2]), rtol=1e-14)
    np.testing.assert_allclose(ball.at(rest + 0.5), 0, atol=1e-25)


@pytest.mark.parametrize(
    ("masses", "gaps", "after"),
    [
        ((1, 1, 1), (0.5, 0.0), (-1 / 3, 2 / 3, 2 / 3)),
        ((1, 1, 1), (0.5, 0.2), (0, 0, 1)),
        ((1, 1, 1, 1), (0.5, 0.1, 0.2), (0, 0, 0, 1)),
        ((1, 2), (0.5,), (-1 / 3, 2 / 3)),
    ],
)
def test_chains_at_e_1(masses, gaps, after):
    q, v = reference.chain(1.0, masses, gaps, duration=3.0).at(3.0)
    np.testing.assert_allclose(v, after, atol=1e-14)
    assert (np.diff(q) >= -1e-14).all()


def test_the_rod_lies_still_at_e_0():
    q, v = reference.rod(0.0).at(0.55)
    np.testing.assert_allclose(q, 0, atol=1e-10)
    np.testing.assert_allclose(v, 0, atol=1e-10)


def test_the_rods_first_impact_by_hand():
    """It falls for (2 drop / g)^(1/2); then p = 2 m u / (1 + 3 cos^2) at the end of a rod, I = m l^2 / 12."""
    rod, angle = reference.rod(1.0), 0.35
    drop = 0.7 - 0.5 * np.sin(angle)
    speed, c = np.sqrt(2 * 9.81 * drop), np.cos(angle)
    assert rod.impacts[0] == pytest.approx(np.sqrt(2 * drop / 9.81), rel=1e-13)
    after = rod.at(rod.impacts[0])[1]
    p = 2.0 * speed / (1 + 3 * c**2)
    np.testing.assert_allclose(after, [-speed + p, -6.0 * p * c], rtol=1e-12)


def test_the_oscillator_returns_after_its_period():
    for e in (0.3, 0.5, 1.0):
        orbit = reference.impact_oscillator(e, duration=11.0)
        period = 2 * np.pi / 2.5
        np.testing.assert_allclose(np.diff(orbit.impacts), period, rtol=1e-13)
        for t in (0.3, 1.1, 2.0):
            np.testing.assert_allclose(orbit.at(t + 3 * period), orbit.at(t), atol=1e-12)


@pytest.mark.parametrize("e", [0.5, 0.8, 1.0])
def test_the_chaotic_oscillator_forgets_its_start(e):
    near, far = (reference.chaotic_oscillator(e, q0=q0, duration=40.0) for q0 in (0.5, 0.5 + 1e-8))
    assert abs(near.at(40.0)[0] - far.at(40.0)[0]) > 1e-5


def test_what_has_no_solution_at_an_e_is_left_out():
    names = [r.name for r in reference.references(0.01)]
    assert "rod" in names
    assert "impact oscillator" not in names
    with pytest.raises(mbvi.InputError, match="restitution"):
        reference.references(1.1)


def test_no_impact_of_the_oscillator_is_missed():
    case = reference.chaotic_oscillator(0.5, duration=40.0)
    fine = np.linspace(0, 40.0, 400_001)
    assert min(case.at(t)[0][0] for t in fine[::7]) >= 0.3 - 1e-12


@pytest.mark.parametrize("name", ["double_pendulum", "rod", "rocking_block", "tumbling_body"])
@pytest.mark.parametrize("e", E)
def test_located_solutions_do_not_depend_on_the_step(name, e, monkeypatch):
    coarse = getattr(reference, name)(e)
    monkeypatch.setattr("mbvi.reference.mechanisms.locate", partial(located.locate, largest_step=2.1e-3))
    fine = getattr(reference, name)(e)
    np.testing.assert_allclose(coarse.impacts, fine.impacts, atol=1e-11)
    for t in np.linspace(0, coarse.duration, 57):
        if np.abs(coarse.impacts - t).min() > 1e-6:
            for a, b in zip(coarse.at(t), fine.at(t), strict=True):
                np.testing.assert_allclose(a, b, atol=3e-11)


def test_the_law_by_enumeration_is_the_law_of_the_projection(rng):
    for _ in range(50):
        n, m = rng.integers(1, 6, 2)
        B = rng.normal(size=(n, n))
        M, J, v, e = B @ B.T + 0.3 * np.eye(n), rng.normal(size=(m, n)), rng.normal(size=n), rng.uniform()
        np.testing.assert_allclose(law(M, J, v, e), mbvi.impact(v, M, J, e), atol=1e-8)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: reference.bouncing_ball(1.5), "restitution"),
        (lambda: reference.bouncing_ball(0.5, height=-1), "height"),
        (lambda: reference.bouncing_ball(0.5, duration=0.0), "duration"),
        (lambda: reference.impact_oscillator(0.5, frequency=1.0), "resonance"),
        (lambda: reference.impact_oscillator(0.5, stop=5.0), "no stable orbit"),
        (lambda: reference.chaotic_oscillator(0.5, q0=-1.0), "above the stop"),
        (lambda: reference.corner(0.5, angle=4.0), "angle"),
        (lambda: reference.corner(0.5, mass=((1, 2), (2, 1))), "positive definite"),
        (lambda: reference.chain(0.5, gaps=(0.1, -1.0)), "gaps"),
        (lambda: reference.chain(0.5, masses=(1.0,)), "masses"),
        (lambda: reference.rod(0.3, duration=1.0), "accumulate"),
        (lambda: reference.corner(0.05, 0.3, duration=20.0), "accumulate"),
        (lambda: reference.corner(0.5, 0.3, np.eye(2), duration=20.0), "accumulate"),
        (lambda: reference.chain(0.05, (5, 1, 5), (0.1, 0.2)), "accumulate"),
        (lambda: reference.sliding_in_disc(0.5, speed=np.inf), "speed"),
        (lambda: reference.chain(0.5, gaps=(0.0, 0.0)), "first positive"),
        (lambda: reference.bouncing_ball(0.5).at(7.0), "known from"),
        (lambda: reference.impact_oscillator(0.5).at(-1.0), "known from"),
    ],
)
def test_bad_arguments_of_references(make, message):
    with pytest.raises(mbvi.InputError, match=message):
        make()
