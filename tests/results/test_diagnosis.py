"""What a run says of itself: where it is one of several answers, and what it may be trusted for."""

import numpy as np
import pytest

import mbvi
from support.paths import ROBOTS, real_robot


def corner(degrees, e, v, time=0.5, M=None):
    """A point on its way into a corner of kinetic angle `degrees`, where it arrives at `time`."""
    M = np.eye(2) if M is None else np.asarray(M, dtype=float)
    root = np.linalg.cholesky(M).T
    angle = np.radians(degrees)
    v = np.linalg.solve(root, v)
    walls = [
        mbvi.GapFunction(lambda q, n=n: n @ q, lambda q, n=n: n, name=name)
        for n, name in zip(np.array([[0, 1], [np.sin(angle), -np.cos(angle)]]) @ root, ("right", "left"), strict=True)
    ]
    system = mbvi.LagrangianSystem(lambda q: M, lambda t, q, v: np.zeros(2), 2, potential=lambda q: 0.0)
    return mbvi.Problem(system, walls, -time * v, v, restitution=e)


def diagnosis(problem, duration=1.0, step=1e-3, **more):
    return mbvi.simulate(problem, mbvi.Paoli(), step=step, duration=duration, **more).diagnosis()


METRICS = pytest.mark.parametrize("M", [None, [[2.0, 0.6], [0.6, 0.4]]], ids=["unit mass", "a metric"])


@METRICS
@pytest.mark.parametrize(
    ("degrees", "e", "horizon"),
    [
        (90, 1.0, np.inf),
        (90, 0.5, np.inf),
        # (12) fails, but orders agree with each other and with the law: it is sufficient only
        (45, 1.0, np.inf),
        # orders agree, the law does not
        (60, 1.0, 0.5),
        (120, 1.0, 0.5),
        # an acute corner at e = 0 meets (12), an obtuse one does not
        (60, 0.0, np.inf),
        (120, 0.0, 0.5),
    ],
)
def test_the_horizon_of_a_corner(degrees, e, horizon, M):
    middle = np.radians(degrees / 2 - 8)
    found = diagnosis(corner(degrees, e, [-np.cos(middle), -np.sin(middle)], M=M))
    assert found.horizon == pytest.approx(horizon, abs=1.5e-3)
    (at_corner,) = [i for i in found.instants if i.impact]
    assert at_corner.condition_12 == (degrees == 90 or (degrees == 60 and e == 0.0))
    assert at_corner.independent
    assert at_corner.constraints == ("right", "left")
    np.testing.assert_allclose(np.degrees(at_corner.angles[0, 1]), 180 - degrees, atol=1e-9)
    assert ("one of several answers" in str(found)) == np.isfinite(horizon)


@pytest.mark.parametrize(
    ("degrees", "e", "horizon"), [(90, 0.5, np.inf), (120, 1.0, 0.5), (120, 0.5, 0.5), (120, 0, 0.5)]
)
@pytest.mark.parametrize("tolerance", [1e-2, 1e-4])
def test_impacts_of_adaptive_act_on_contacts_that_are_open_by_its_tolerance(degrees, e, horizon, tolerance):
    middle = np.radians(degrees / 2 - 8)
    problem = corner(degrees, e, [-np.cos(middle), -np.sin(middle)])
    run = mbvi.simulate(problem, mbvi.Adaptive(tolerance), duration=1.0)
    found = run.diagnosis()
    (at_corner,) = [i for i in found.instants if i.impact]
    assert at_corner.constraints == run.impacts[0].constraints == ("right", "left")
    assert at_corner.time == run.impacts[0].time
    assert found.horizon == pytest.approx(horizon, abs=tolerance)


def test_walls_hit_one_after_the_other_leave_no_doubt():
    found = diagnosis(corner(120, 1.0, [-1.0, -0.1], time=0.5), duration=0.45)
    assert found.instants == ()
    assert found.horizon == np.inf
    assert "never seen active at once" in str(found)


def test_touching_balls_are_one_of_several_answers():
    scene = mbvi.Scene(gravity=(0, 0, 0), restitution=1.0)
    for k, x in enumerate([-0.5, 0.2, 0.4]):
        scene.add_sphere(0.1, mass=2.0, position=(x, 0, 0), velocity=(1.0 * (k == 0), 0, 0), name=f"ball {k}")
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=1.0)
    found = run.diagnosis()
    assert found.horizon == run.impacts[0].time
    (impact,) = [i for i in found.instants if i.impact]
    assert impact.forks.spread == pytest.approx(np.sqrt(2.0 * 2 / 3), rel=1e-9)
    np.testing.assert_allclose(impact.forks.outcomes[:, ::3], [[0, 0, 1]], atol=1e-9)
    np.testing.assert_allclose(impact.forks.law[::3], [-1 / 3, 2 / 3, 2 / 3], atol=1e-9)


def test_thinned_runs_say_the_same(tmp_path):
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_urdf(ROBOTS / "quadruped/quadruped.urdf", position=(0, 0, 0.6))
    every, seventh = (
        mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=0.4, every=every, out=tmp_path / f"{every}.h5")
        for every in (1, 7)
    )
    first, second = every.diagnosis(), seventh.diagnosis()
    assert first.horizon == second.horizon == pytest.approx(every.impacts[0].time)
    assert [i.constraints for i in first.instants] == [i.constraints for i in second.instants]
    assert first.variation == pytest.approx(second.variation, rel=1e-12)
    assert not second.unseen
    again, thinned = mbvi.load(tmp_path / "1.h5").diagnosis(), mbvi.load(tmp_path / "7.h5").diagnosis()
    assert str(again) == str(first)
    assert str(thinned) == str(second)


def test_the_variation_of_thinned_steps_of_their_own_is_a_lower_bound():
    scene = mbvi.Scene(restitution=0.5)
    scene.add_halfspace((0, 0, 1))
    scene.add_box((0.2, 0.3, 0.4), position=(0, 0, 1), angular_velocity=(1, 2, 0.5))
    problem = scene.build()
    full, some, few = (
        mbvi.simulate(problem, mbvi.EventDriven(1e-8), duration=0.6, every=n).diagnosis().variation for n in (1, 2, 100)
    )
    # the jumps of impacts are in all of them
    assert 0.9 * full < few < some < full


def test_a_file_without_its_control_says_what_it_cannot_tell(tmp_path):
    scene = mbvi.Scene(gravity=(0, 0, 0), restitution=1.0)
    for k, x in enumerate([-0.5, 0.2, 0.4]):
        scene.add_sphere(0.1, position=(x, 0, 0), velocity=(1.0 * (k == 0), 0, 0))
    scene.add_urdf(ROBOTS / "hopper/hopper.urdf", position=(0, 5, 0), control=lambda t, q, v: np.r_[np.zeros(6), 1, 0])
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=0.6, every=7, out=tmp_path / "run.h5")
    assert run.diagnosis().horizon == pytest.approx(0.5, abs=2e-3)
    with pytest.warns(mbvi.MbviWarning, match="control of robot 'hopper'"):
        found = mbvi.load(tmp_path / "run.h5").diagnosis()
    assert found.unseen
    assert np.isnan(found.energy_excess)
    assert np.isnan(found.horizon)
    assert "outcomes is not known" in str(found)
    assert "Energies are not known: the file of this run could not keep control of robot 'hopper'." in str(found)
    assert "nan" not in str(found)


def test_a_file_of_some_steps_says_so_where_outcomes_are_not_known_for_another_reason(tmp_path):
    """With friction not all outcomes are sought: that the report lacks instants must not depend on it."""
    scene = mbvi.Scene(friction=0.5)
    scene.add_halfspace((0, 0, 1), name="floor")
    for k in range(2):
        scene.add_sphere(0.05, position=(k, 0, 0.06915))
    scene.add_urdf(ROBOTS / "hopper/hopper.urdf", position=(0, 5, 2), control=lambda t, q, v: np.zeros(8))
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=0.1, every=7, out=tmp_path / "run.h5")
    # both balls land at 63 ms, which the file keeps
    said = "The file keeps only some of the steps: instants between them were not looked at."
    assert run.diagnosis().not_followed
    assert said not in str(run.diagnosis())
    with pytest.warns(mbvi.MbviWarning, match="control of robot 'hopper'"):
        found = mbvi.load(tmp_path / "run.h5").diagnosis()
    assert found.unseen
    assert found.not_followed
    assert str(found).count(said) == 1


@pytest.mark.parametrize("duration", [0.502, 0.505, 0.5000001])
def test_a_short_last_step_is_looked_at_too(duration):
    problem = corner(120, 1.0, [-1.0, -0.1], time=0.497)
    for every in (1, 3, 7):
        run = mbvi.simulate(problem, mbvi.Paoli(), step=1e-2, duration=duration, every=every)
        assert run.diagnosis().horizon == pytest.approx(0.5)


def test_rounding_is_no_fork():
    """A last step shorter than half of the others follows an impact: it is none itself, and leads to no outcomes."""
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1))
    scene.add_box((0.4, 0.3, 0.2), mass=2.0, position=(0, 0, 0.6))
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-2, duration=0.332)
    (impact,) = run.impacts
    assert 0.332 - impact.time < 0.5e-2
    found = run.diagnosis()
    assert [i.impact for i in found.instants] == [True, False]
    assert found.instants[1].forks is None
    assert found.horizon == np.inf
    assert all(type(i.impact) is bool for i in found.instants)


def test_the_measured_energy_is_that_of_the_law():
    run = mbvi.simulate(corner(90, 0.5, [-1.0, -1.0]), mbvi.Paoli(), step=1e-3, duration=1.0)
    (impact,) = run.diagnosis().instants
    assert impact.energy_change == pytest.approx(-0.5 * 2.0 * (1 - 0.25), rel=1e-12)
    assert run.diagnosis().largest_percussion == pytest.approx(1.5, rel=1e-12)
    assert run.diagnosis().variation == pytest.approx(1.5 * np.sqrt(2), rel=1e-12)


def test_a_stretch_of_contact_is_one_entry():
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_box((0.4, 0.3, 0.2), position=(0, 0, 0.1), name="box")
    found = diagnosis(scene.build(), duration=0.3)
    (stretch,) = found.instants
    assert (stretch.time, stretch.until) == (0.0, 0.3)
    assert not stretch.impact
    assert not stretch.condition_12
    # four corners of one face span three directions
    assert not stretch.independent
    assert stretch.forks is None
    assert abs(stretch.energy_change) < 1e-12
    assert found.horizon == np.inf
    assert "0.0000 - 0.3000" in str(found)


def test_a_start_outside_the_tangent_cone_is_looked_at():
    problem = corner(120, 1.0, [-1.0, -0.1], time=0.0)
    assert diagnosis(problem, duration=0.1).horizon == 0.0


@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("name", ["hopper", "quadruped", "arm"])
def test_the_energy_estimate_holds_on_robots(name, e):
    """The inequality before Proposition 3.1: kinetic energy <= start + work + what a changing M gives."""
    files = {"hopper": ROBOTS / "hopper/hopper.urdf", "quadruped": ROBOTS / "quadruped/quadruped.urdf",
             "arm": real_robot("ur_description/urdf/ur5_robot.urdf")}  # fmt: skip
    scene = mbvi.Scene(restitution=e)
    scene.add_halfspace((0, 0, 1), name="floor", offset=-0.5 if name == "arm" else 0.0)
    scene.add_urdf(files[name], base="fixed" if name == "arm" else "free", position=(0, 0, 0.0 if name == "arm" else 1))
    problem = scene.build()
    run = mbvi.simulate(problem, mbvi.Paoli(), step=1e-3, duration=0.8)
    assert run.diagnosis().energy_excess <= 1e-9 * max(1.0, float(run.energies()[0].max()))


def test_a_run_that_gains_energy_is_found_out():
    # e = 0 on one wall and 1 on the other, at an acute corner: Newton's law with several e gains energy
    directions = [np.array([1.0, 0.0]), np.array([-0.9, np.sqrt(1 - 0.81)])]
    walls = [mbvi.GapFunction(lambda q, n=n: n @ q, lambda q, n=n: n) for n in directions]
    system = mbvi.LagrangianSystem(lambda q: np.eye(2), lambda t, q, v: np.zeros(2), 2)
    problem = mbvi.Problem(system, walls, [0.0, 0.0], [-1.0, 0.1], restitution=[1.0, 0.0])
    with pytest.warns(mbvi.MbviWarning, match="raised the energy"):
        run = mbvi.simulate(problem, mbvi.Paoli(), step=1e-3, duration=0.01)
    found = run.diagnosis()
    assert found.energy_excess == pytest.approx(run.impacts[0].energy_change, rel=1e-9)
    assert found.energy_excess > 0.1


def test_bad_arguments_of_diagnosis(tmp_path):
    run = mbvi.simulate(corner(90, 1.0, [-1.0, -1.0]), mbvi.Paoli(), step=0.1, duration=0.2)
    for tolerance in (0.0, -1.0, 1.0, np.nan, "small"):
        with pytest.raises(mbvi.InputError, match="tolerance"):
            run.diagnosis(tolerance)
    run.save(tmp_path / "run.h5")
    with pytest.raises(mbvi.InputError, match="no problem"):
        mbvi.load(tmp_path / "run.h5").diagnosis()


def test_an_interactive_session_shows_one_line():
    case = mbvi.reference.bouncing_ball(0.5, height=1.0, duration=1.0)
    run = mbvi.simulate(case.problem, mbvi.Paoli(), step=1e-2, duration=1.0)
    found, estimate = run.diagnosis(), run.error_estimate()
    assert repr(found) == f"Diagnosis(horizon=inf, instants={len(found.instants)}, jumps=0)"
    largest = f"{estimate.largest:.1e}"
    assert repr(estimate) == f"ErrorEstimate(largest={largest}, fork=inf, times={len(estimate.t)})"


def test_gaps_of_what_rests_are_measured_once():
    calls = []

    def gap(q):
        calls.append(q)
        return q[0]

    system = mbvi.LagrangianSystem(
        lambda q: np.eye(1), lambda t, q, v: np.array([-9.81]), 1, potential=lambda q: 9.81 * q[0]
    )
    floor = mbvi.GapFunction(gap, lambda q: np.ones(1), name="floor")
    run = mbvi.simulate(mbvi.Problem(system, [floor], [0.01], [0.0]), mbvi.Paoli(), step=1e-3, duration=1.0)
    moved = 1 + np.flatnonzero(np.diff(run.q[:, 0])).max()
    calls.clear()
    found = run.diagnosis()
    assert len(calls) <= 2 * (moved + 1) < 0.2 * len(run.t)
    # the balance holds over the steps at rest as well
    assert found.variation == sum(np.abs(np.diff(run.v[:, 0], prepend=0.0))) and found.energy_excess < 1e-12
