"""The estimated error of a run beside the true one, and its end at a fork."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import mbvi
from mbvi import reference
from mbvi.errors import InputError, UnsuitableError


def drawn(rng):
    """Exact problems with drawn parameters."""
    e = float(rng.choice([0.0, rng.uniform(0.1, 0.9), 1.0]))
    yield reference.bouncing_ball(e, height=rng.uniform(0.5, 2.0), duration=1.5)
    yield reference.sliding_in_disc(e, speed=rng.uniform(0.5, 2.0))
    yield reference.corner(e, angle=rng.uniform(0.6, 2.5))
    yield reference.chain(e, masses=tuple(rng.uniform(0.5, 2.0, 3)), gaps=tuple(rng.uniform(0.2, 0.6, 2)))
    yield reference.rolling_ball(rng.uniform(0.1, 0.5), speed=rng.uniform(0.5, 2.0))
    yield reference.block_on_incline(rng.uniform(0.3, 0.6), 0.5, -rng.uniform(0.5, 2.0))


def simulated(case, scheme, step):
    """The run of a problem, with steps where the scheme does not choose them."""
    given = {} if step is None else {"step": step}
    return mbvi.simulate(case.problem, scheme, duration=case.duration, **given)


@pytest.mark.parametrize(
    ("scheme", "rounds"),
    [
        (mbvi.EventDriven(1e-6), 3),
        (mbvi.Adaptive(1e-2), 2),
        (mbvi.Paoli(), 4),
        pytest.param(mbvi.Centered(project_positions=True), 3, marks=pytest.mark.slow),
    ],
    ids=repr,
)
def test_the_estimate_is_within_a_factor_of_ten_of_the_true_error(rng, scheme, rounds):
    ratios = []
    for _ in range(rounds):
        for case in drawn(rng):
            step = None if isinstance(scheme, mbvi.EventDriven | mbvi.Adaptive) else 2e-2 * rng.uniform(0.5, 1.5)
            try:
                run = simulated(case, scheme, step)
            except UnsuitableError:
                # friction, for schemes without it
                continue
            estimate, system = run.error_estimate(), case.problem.system
            unit = np.where(system.are_lengths(), case.problem.length, 1.0)
            known = estimate.t <= estimate.fork
            pairs = [(case.at(min(t, case.problem.t0 + case.duration))[0], run.at(t)[0]) for t in estimate.t[known]]
            true = max(np.abs(system.difference(*pair) / unit).max() for pair in pairs)
            # what is exact to rounding has no digits to compare
            ratios.append(max(estimate.largest, 1e-12) / max(true, 1e-12))
    ratios = np.array(ratios)
    assert len(ratios) >= 12
    assert np.mean((ratios > 0.1) & (ratios < 10.0)) >= 0.95
    assert 0.5 < np.median(ratios) < 2.0


@pytest.mark.parametrize("tolerance", [0.1, 1e-2, 1e-3])
def test_slow_motion_has_an_error_too(tolerance):
    """The longest steps are short enough for any tolerance, and a second run with these would differ by nothing."""
    length, start = 4.0, 0.8
    system = mbvi.LagrangianSystem(lambda q: length**2 * np.eye(1), lambda t, q, v: -9.81 * length * np.sin(q), 1)
    run = mbvi.simulate(mbvi.Problem(system, [], [start], [0.0]), mbvi.Adaptive(tolerance), duration=2.0)

    def rates(t, y):
        return y[1], -9.81 / length * np.sin(y[0])

    exact = solve_ivp(rates, (0.0, 2.0), (start, 0.0), "DOP853", run.t, rtol=1e-13, atol=1e-14).y[0]
    true = np.abs(run.q[:, 0] - exact).max()
    assert 0.1 < run.error_estimate().largest / true < 10.0


@pytest.mark.parametrize("phase", np.linspace(0.02, 0.98, 13))
def test_an_impact_anywhere_within_its_step_is_noticed(phase):
    """Late in its step, a run of steps a tenth as long strikes at the same time, and would differ by nothing."""
    case = reference.corner(0.5)
    step = case.impacts[0] / (30 + phase)
    run = mbvi.simulate(case.problem, mbvi.Paoli(), step=step, duration=33 * step)
    true = np.abs(case.at(run.t[-1])[0] - run.q[-1]).max()
    assert 0.1 < run.error_estimate().error[-1] * case.problem.length / true < 10.0


def test_no_number_after_a_fork():
    """Two balls that touch are struck by a third: the outcome depends on which impact is first."""
    run = simulated(reference.chain(0.5), mbvi.EventDriven(1e-8), None)
    estimate = run.error_estimate()
    assert estimate.fork == pytest.approx(0.5, abs=1e-9)
    assert np.isnan(estimate.error[estimate.t > 0.5 + 1e-9]).all()
    assert np.isfinite(estimate.error[estimate.t < 0.5]).all()
    assert "several solutions" in str(estimate)
    assert run.diagnosis().horizon == estimate.fork


def test_forks_that_are_not_looked_for_are_named():
    scene = mbvi.Scene(restitution=0.0, friction=0.5)
    scene.add_halfspace((0, 0, 1), name="floor")
    for k in range(2):
        scene.add_sphere(0.1, position=(k, 0, 0.1), velocity=(1.0, 0, -1.0))
    estimate = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-2, duration=0.1).error_estimate()
    assert np.isinf(estimate.fork)
    assert "not known" in estimate.caveat
    assert estimate.caveat in str(estimate)


def falling():
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_sphere(0.1, mass=1.0, position=(0, 0, 0.5), name="ball")
    return scene.build()


def test_a_thinned_run_and_one_from_a_file_have_the_same_estimate(tmp_path):
    problem = falling()
    full = mbvi.simulate(problem, mbvi.Paoli(), step=1e-3, duration=0.61)
    thinned = mbvi.simulate(problem, mbvi.Paoli(), step=1e-3, duration=0.61, every=3)
    thinned.save(tmp_path / "run.h5")
    estimates = [run.error_estimate() for run in (full, thinned, mbvi.load(tmp_path / "run.h5"))]
    assert len(estimates[1].t) == 1 + 610 // 21 + 1
    at = np.searchsorted(estimates[0].t, estimates[1].t - 1e-9)
    np.testing.assert_allclose(estimates[0].error[at], estimates[1].error, rtol=1e-6, atol=1e-15)
    assert np.array_equal(estimates[1].error, estimates[2].error)
    assert estimates[0].largest > 1e-4


@pytest.mark.parametrize("every", [3, 10])
def test_states_that_switches_add_to_a_thinned_run_are_not_compared(every):
    """Two boxes fly side by side and are welded for a while: Centered has their parabola exactly."""
    scene = mbvi.Scene()
    for name, x in (("left", 0.0), ("right", 0.3)):
        scene.add_box((0.1, 0.1, 0.1), mass=1.0, position=(x, 0, 1), velocity=(1, 0, 2), name=name)
    scene.weld("left", "right", name="weld", active=False)
    run = mbvi.simulate(
        scene.build(), mbvi.Centered(), step=1e-3, duration=0.4, every=every,
        switch=lambda state: {"weld": 0.0015 < state.t < 0.2},
    )  # fmt: skip
    assert len(run.t) > 1 + 400 / every
    np.testing.assert_allclose(run.q[:, 2], 1 + 2 * run.t - 9.81 / 2 * run.t**2, rtol=0, atol=1e-12)
    assert run.error_estimate().largest < 1e-10


def test_what_has_no_estimate_is_refused():
    with pytest.raises(UnsuitableError, match="1e-12"):
        mbvi.simulate(falling(), mbvi.EventDriven(1e-13), duration=0.1).error_estimate()

    def stop(t, q, v):
        if t > 0.05:
            raise KeyboardInterrupt
        return np.zeros(6)

    scene = mbvi.Scene()
    scene.add_sphere(0.1, mass=1.0, position=(0, 0, 0.5), name="ball")
    scene.add_force("ball", stop)
    with pytest.raises(KeyboardInterrupt) as caught:
        mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-2, duration=0.1)
    with pytest.raises(InputError, match="complete"):
        caught.value.run.error_estimate()


def test_what_is_set_after_a_run_does_not_change_what_is_known_of_it():
    drive = mbvi.ConstantTorque([0.2, -0.1, 0.1])
    scene = mbvi.Scene()
    scene.add_urdf("robot:arm", base="fixed", name="arm", control=drive)
    problem = scene.build()
    run = mbvi.simulate(problem, mbvi.Centered(), step=1e-2, duration=0.2)
    known = run.error_estimate().error, run.diagnosis().energy_excess
    drive.torque[:] = 5.0
    assert np.array_equal(run.error_estimate().error, known[0])
    assert run.diagnosis().energy_excess == known[1]
    assert drive.torque.tolist() == [5.0, 5.0, 5.0]


def test_a_run_shorter_than_rounding_of_its_step_reaches_its_end():
    run = mbvi.simulate(falling(), mbvi.Centered(), duration=1e-12)
    assert run.t.tolist() == [0.0, 1e-12]
    assert run.error_estimate().largest < 1e-12
