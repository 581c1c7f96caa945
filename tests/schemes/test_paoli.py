"""The scheme (10)-(11) against itself written out by hand; its order is in schemes/test_order.py."""

import numpy as np
import pytest

import mbvi

G = 9.81


def falling_point(restitution=0.5, q0=(1.0,), v0=(0.0,), constraints=None, gravity=G, **more):
    d = len(q0)
    system = mbvi.LagrangianSystem(lambda q: np.eye(d), lambda t, q, v: -gravity * np.eye(d)[-1], d)
    if constraints is None:
        constraints = [mbvi.GapFunction(lambda q: q[-1], lambda q: np.eye(d)[-1], name="floor")]
    return mbvi.Problem(system, constraints, q0, v0, restitution=restitution, **more)


@pytest.mark.parametrize("e", [0.0, 0.4, 1.0])
def test_a_step_is_equations_10_and_11_to_the_letter(e):
    h, t0 = 7e-3, 0.3

    def mass(q):
        return np.diag([1.0 + q[0] ** 2, 2.0 + np.sin(q[1])])

    def force(t, q, v):
        return np.array([np.cos(t) - v[0] * v[1], -G + q[0] * v[0]])

    gaps = [
        mbvi.GapFunction(lambda q: q[1] - 0.1 * q[0] ** 2, lambda q: np.array([-0.2 * q[0], 1.0])),
        mbvi.GapFunction(lambda q: q[1] + 0.5 * q[0], lambda q: np.array([0.5, 1.0])),
    ]
    problem = mbvi.Problem(mbvi.LagrangianSystem(mass, force, 2), gaps, [0.02, 0.1], [-0.4, -1.5], restitution=e, t0=t0)
    q, v, t = problem.q0, problem.v0, t0
    seen = set()
    for k, step in enumerate(mbvi.steps(problem, mbvi.Paoli(), step=h)):
        t = t0 + (k + 1) * h
        q = q + h * v
        M = mass(q)
        active = [g for g in gaps if g.gap(t, q)[0] <= 1e-8]
        J = np.array([g.gradient(t, q)[0] for g in active]).reshape(-1, 2)
        push = np.linalg.solve(M, force(t, q, v))
        v = -e * v + (1 + e) * mbvi.project(v + h / (1 + e) * push, M, J).velocity
        seen.add(len(active))
        np.testing.assert_allclose(step.q, q, rtol=1e-12, atol=1e-14)
        np.testing.assert_allclose(step.v, v, rtol=1e-10, atol=1e-12)
        q, v = step.q, step.v
        if k == 150:
            break
    assert {0, 1} <= seen


def test_percussions_balance_the_jump():
    """M (v_{i+1} - v_i) - h g = J' p with p >= 0: Lemma 3.3 with the sign turned."""
    scene = mbvi.Scene(restitution=0.3)
    scene.add_halfspace((0, 0, 1))
    scene.add_halfspace((1, 0, 0.2), -0.4)
    scene.add_box((0.2, 0.3, 0.4), position=(0, 0, 0.5), velocity=(-2, 0.3, -1), angular_velocity=(1, 2, 3))
    problem, h = scene.build(), 1e-3
    v, pressed = problem.v0, 0
    for k, step in enumerate(mbvi.steps(problem, mbvi.Paoli(), step=h)):
        M = problem.system.metric(step.q).dense()
        # gyroscopic torques are those of the mean velocity without contacts
        mean = 0.5 * (v + problem.system.free_velocity(step.t, step.q, v, h))
        jump = M @ (step.v - v) - h * problem.system.force(step.t, step.q, mean)
        np.testing.assert_allclose(step.active.jacobian.T @ step.percussion, jump, atol=1e-10)
        assert (step.percussion >= 0).all()
        pressed += step.percussion.any()
        v = step.v
        if k == 800:
            break
    assert pressed > 50


@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_a_point_between_two_walls(e):
    """Two constraints at right angles, struck at once: (12) holds and each velocity component is reflected."""
    gaps = [mbvi.GapFunction(lambda q, k=k: q[k], lambda q, k=k: np.eye(2)[k], name=f"wall {k}") for k in range(2)]
    problem = falling_point(e, (0.5, 0.5), (-1.0, -1.0), gaps, gravity=0.0)
    run = mbvi.simulate(problem, mbvi.Paoli(), step=1e-2, duration=1.0)
    assert len(run.impacts) == 1
    assert run.impacts[0].constraints == ("wall 0", "wall 1")
    np.testing.assert_allclose(run.v[-1], e * np.ones(2), atol=1e-12)
    np.testing.assert_allclose(run.impacts[0].percussion, 1 + e, atol=1e-12)
    assert run.impacts[0].energy_change == pytest.approx(-(1 - e**2), abs=1e-12)


def test_start_outside_k_is_refused_by_name_and_depth():
    with pytest.raises(mbvi.InadmissibleStartError, match=r"floor is violated by 0\.01"):
        falling_point(q0=(-0.01,))
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1), name="ground")
    scene.add_sphere(0.1, position=(0, 0, 0.08), name="ball")
    with pytest.raises(mbvi.InadmissibleStartError, match=r"ball \| ground penetrates by 0\.02"):
        scene.build()


@pytest.mark.parametrize("e", [0.0, 0.6])
def test_start_velocity_outside_the_tangent_cone_gets_the_law_once(e):
    problem = falling_point(e, (0.0,), (-2.0,))
    run = mbvi.simulate(problem, mbvi.Paoli(), step=1e-3, duration=0.1)
    assert run.v[0, 0] == pytest.approx(2 * e)
    assert run.impacts[0].time == 0.0
    assert run.impacts[0].percussion[0] == pytest.approx(2 * (1 + e))
    assert sum(i.time == 0.0 for i in run.impacts) == 1
    first = next(mbvi.steps(problem, mbvi.Paoli(), step=1e-3))
    assert first.t == 0.0
    assert first.v[0] == pytest.approx(2 * e)


def test_start_at_rest_on_the_floor_is_no_impact():
    run = mbvi.simulate(falling_point(0.5, (0.0,)), mbvi.Paoli(), step=1e-3, duration=0.2)
    assert run.impacts == ()
    np.testing.assert_allclose(run.q, 0, atol=1e-15)


def test_elastic_energy_is_kept_at_consistent_times():
    run = mbvi.simulate(falling_point(1.0), mbvi.Paoli(), step=1e-3, duration=5.0)
    np.testing.assert_allclose(run.energy(), G, rtol=1e-12)


def test_touching_balls_take_the_simultaneous_law_whatever_the_rounding():
    for gap in (0.0, 1e-16, -1e-16, 1e-13):
        scene = mbvi.Scene(gravity=(0, 0, 0), restitution=1.0)
        for k, x in enumerate([-0.5, 0.2, 0.4 + gap]):
            scene.add_sphere(0.1, position=(x, 0, 0), velocity=(1.0 * (k == 0), 0, 0))
        run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=1.0)
        np.testing.assert_allclose(run.v[-1, ::3], [-1 / 3, 2 / 3, 2 / 3], atol=1e-9)


def test_mixed_restitution_that_raises_the_energy_is_said():
    # at an acute corner Newton's law with e = 0 on one wall and 1 on the other gains energy
    directions = [np.array([1.0, 0.0]), np.array([-0.9, np.sqrt(1 - 0.81)])]
    gaps = [mbvi.GapFunction(lambda q, n=n: n @ q, lambda q, n=n: n) for n in directions]
    problem = falling_point([1.0, 0.0], (0.0, 0.0), (-1.0, 0.1), gaps, gravity=0.0)
    with pytest.warns(mbvi.MbviWarning, match="raised the energy"):
        run = mbvi.simulate(problem, mbvi.Paoli(), step=1e-3, duration=0.01)
    assert run.impacts[0].energy_change > 0
    assert "raised the energy" in run.notes[0]


def test_a_resting_box_keeps_still_and_records_no_impacts():
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1))
    scene.add_box((0.4, 0.3, 0.2), position=(0, 0, 0.1))
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=1.0)
    assert run.impacts == ()
    np.testing.assert_allclose(run.q, run.q[0] * np.ones_like(run.q), atol=1e-12)


def test_a_box_landing_flat_strikes_with_four_corners_at_once():
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0, 1))
    scene.add_box((0.4, 0.3, 0.2), mass=2.0, position=(0, 0, 0.6))
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=0.6)
    (impact,) = run.impacts
    assert len(impact.constraints) == 4
    np.testing.assert_allclose(impact.percussion, impact.percussion[0], rtol=1e-9)
    assert impact.percussion.sum() == pytest.approx(2.0 * np.sqrt(2 * G * 0.5), rel=1e-2)
    np.testing.assert_allclose(run.v[-1], 0, atol=1e-12)


@pytest.mark.parametrize(("heaviest", "speed"), [(1.0, 1e-12), (1e4, 1e-10), (1e8, 1e-5)])
def test_a_stack_of_boxes_at_rest_does_not_creep(heaviest, speed):
    """Where faces just touch, the direction between witness points is noise: under a heavy top it threw boxes out."""
    scene = mbvi.Scene(restitution=0.2)
    scene.add_halfspace((0, 0, 1))
    for k, mass in enumerate((1.0, 1.0, heaviest)):
        scene.add_box((0.4, 0.4, 0.2), mass=mass, position=(0.01 * k, 0, 0.1 + 0.2 * k))
    run = mbvi.simulate(scene.build(), mbvi.Paoli(), step=1e-3, duration=1.0)
    assert np.abs(run.v).max() < speed
    assert run.penetration().max() < 1e-12
    assert run.impacts == ()
