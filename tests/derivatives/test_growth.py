"""How variations grow along a run, and until when digits are left, against closed forms."""

import numpy as np
import pytest

import mbvi

SCHEME = mbvi.EventDriven(1e-11)


def moving(force, q, v, gaps=(), e=1.0):
    dim = len(q)
    system = mbvi.LagrangianSystem(lambda q: np.eye(dim), force, dim)
    return mbvi.Problem(system, list(gaps), q, v, restitution=e)


def test_a_free_flight():
    """[[1, t], [0, 1]], whose largest singular value is known."""
    problem = moving(lambda t, q, v: np.zeros(1), [0.0], [1.0])
    found = mbvi.sensitivity(problem, SCHEME, duration=3.0)
    t = found.run.t
    np.testing.assert_allclose(found.growth, np.sqrt(1 + t**2 / 2 + t * np.sqrt(1 + t**2 / 4)), rtol=1e-10)
    assert found.trusted_until() == np.inf


@pytest.mark.parametrize(("digits", "start"), [(3, 1e-9), (6, 2.0**-52), (1, 1e-4)])
def test_a_point_that_falls_off_a_top(digits, start):
    """q'' = q: variations grow by exp(t), so that digits are left until exp(t) start = 10^-digits."""
    problem = moving(lambda t, q, v: q, [0.0], [1e-9])
    found = mbvi.sensitivity(problem, SCHEME, duration=25.0)
    np.testing.assert_allclose(found.growth, np.exp(found.run.t), rtol=1e-7)
    exact = np.log(10.0**-digits / start)
    steps = np.diff(found.run.t).max()
    assert exact <= found.trusted_until(digits, start) <= exact + steps


def test_the_diagnosis_says_until_when_digits_are_left(tmp_path):
    problem = moving(lambda t, q, v: q, [0.0], [1e-9])
    run = mbvi.sensitivity(problem, SCHEME, duration=32.0).run
    found = run.diagnosis().growth
    assert found.growth == pytest.approx(np.exp(32.0), rel=1e-7) and found.followed == 32.0
    exact = np.log(1e-3 / 2.0**-52)
    assert exact <= found.until <= exact + np.diff(run.t).max()
    sentence = f"of a start known to rounding 3 digits are left until t = {found.until:.6g} s."
    assert sentence in str(run.diagnosis())
    run.report(tmp_path / "run.html")
    assert sentence in (tmp_path / "run.html").read_text()
    assert mbvi.simulate(problem, SCHEME, duration=1.0).diagnosis().growth is None
    part = mbvi.sensitivity(problem, SCHEME, duration=1.0, wrt=["restitution"])
    assert part.run.diagnosis().growth is None


@pytest.mark.parametrize(("scheme", "step"), [(SCHEME, None), (mbvi.Paoli(), 1e-3)], ids=["events", "steps"])
def test_the_growth_is_known_up_to_where_a_run_has_no_derivative(scheme, step):
    """A ball strikes a wall head on, which is a free flight in a mirror, then two walls at once that are not at right
    angles."""
    scene = mbvi.Scene(gravity=(0, 0, 0), restitution=1.0)
    for normal, offset in (((1, 0, 0), 0.0), ((-1, 0, 0.5), -3.0), ((-1, 0, -0.5), -3.0)):
        scene.add_halfspace(normal, offset / np.linalg.norm(normal))
    scene.add_sphere(0.1, position=(1, 0, 0), velocity=(-1, 0, 0), name="ball")
    with pytest.raises(mbvi.SensitivityError, match="not orthogonal") as refused:
        mbvi.sensitivity(scene.build(), scheme, duration=5.0, step=step)
    run, t = refused.value.run, refused.value.time
    found = run.diagnosis().growth
    assert run.impacts[0].constraints == ("ball | floor",)
    assert 3.0 < t < 4.0 and t - 2e-3 <= found.followed <= t
    s = found.followed
    assert found.growth == pytest.approx(np.sqrt(1 + s**2 / 2 + s * np.sqrt(1 + s**2 / 4)), rel=1e-6)
    assert found.until == np.inf


def test_impacts_on_a_ball_multiply_what_a_flight_adds():
    """A point between two balls strikes them head on: each adds a curvature 2 / r, exactly as light in mirrors."""
    r, apart, count = 1.0, 1.0, 4
    centres = np.array([[-r - 0.5 * apart, 0.0], [r + 0.5 * apart, 0.0]])
    gaps = [
        mbvi.GapFunction(lambda q, c=c: np.linalg.norm(q - c) - r, lambda q, c=c: (q - c) / np.linalg.norm(q - c))
        for c in centres
    ]
    problem = moving(lambda t, q, v: np.zeros(2), [0.0, 0.0], [1.0, 0.0], gaps)
    found = mbvi.sensitivity(problem, SCHEME, duration=count * apart)
    flight, ball = np.array([[1.0, apart], [0.0, 1.0]]), np.array([[1.0, 0.0], [2.0 / r, 1.0]])
    half = np.array([[1.0, 0.5 * apart], [0.0, 1.0]])
    across = half @ np.linalg.matrix_power(ball @ flight, count - 1) @ ball @ half
    assert len(found.run.impacts) == count
    assert found.growth[-1] == pytest.approx(np.linalg.norm(across, 2), rel=1e-7)
    assert found.growth[-1] > 100.0


def test_lengths_may_have_any_unit():
    found = []
    for length in (1.0, 2.0**10):
        scene = mbvi.Scene(gravity=(0, 0, -9.81 * length), restitution=0.5)
        scene.add_halfspace((0, 0, 1), name="floor")
        scene.add_box(length * np.array([0.25, 0.5, 0.75]), mass=1.0, position=(0, 0, 0.75 * length),
                      angular_velocity=(0.5, 1.0, 0.25))  # fmt: skip
        found.append(mbvi.sensitivity(scene.build(), duration=0.375).growth[-1])
    assert found[1] == pytest.approx(found[0], rel=1e-9)


def test_of_some_bodies_only():
    """A box that turns in flight, beside one that does not: the first one's growth is that of its own columns."""
    scene = mbvi.Scene(gravity=(0, 0, 0))
    for name, x, spin in (("turns", 0.0, (1.0, 5.0, 0.1)), ("rests", 3.0, (0.0, 0.0, 0.0))):
        scene.add_box((0.1, 0.2, 0.3), mass=1.0, position=(x, 0, 0), angular_velocity=spin, name=name)
    problem = scene.build()
    every = mbvi.sensitivity(problem, duration=2.0)
    turns, rests = (mbvi.sensitivity(problem, duration=2.0, bodies=[name]) for name in ("turns", "rests"))
    assert every.growth[-1] == pytest.approx(turns.growth[-1], rel=1e-9)
    assert turns.growth[-1] > 1.1 * rests.growth[-1]


def test_without_the_state_there_is_none():
    problem = moving(lambda t, q, v: np.zeros(1), [0.0], [1.0], [mbvi.GapFunction(lambda q: q[0] + 1, np.ones_like)])
    found = mbvi.sensitivity(problem, SCHEME, duration=1.0, wrt=["restitution"])
    with pytest.raises(mbvi.InputError, match='wrt must hold "state"'):
        found.trusted_until()
    found = mbvi.sensitivity(problem, SCHEME, duration=1.0)
    for given in ({"digits": 0}, {"start": -1.0}, {"start": np.inf}):
        with pytest.raises(mbvi.InputError):
            found.trusted_until(**given)
