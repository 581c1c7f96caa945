"""Given constraints in the compiled loop: states are those of the Python step, errors reach the caller."""

import signal

import numpy as np
import pytest

import mbvi
from mbvi.run.fixed_steps import taking
from support.paths import ROBOTS

STEP = 1e-3
SCHEMES = [
    mbvi.Paoli(), mbvi.MoreauJean(), mbvi.Centered(), mbvi.Centered(project_positions=True), mbvi.StewartTrinkle(),
]  # fmt: skip


class Posts:
    """Three walls that select their rows themselves."""

    names = ("left post", "right post", "far post")
    normals = np.array([[0.1, -1.0], [0.0, 1.0], [-1.0, -0.1]])

    def gap(self, t, q):
        return self.normals @ q + np.array([1.3, 0.3, 0.9])

    def gradient(self, t, q):
        return self.normals

    def active(self, t, q, tolerance, travel):
        gap = self.gap(t, q)
        near = np.flatnonzero(gap <= tolerance)
        if not near.size:
            return None
        nowhere = np.full((near.size, 3), np.nan)
        return near, gap[near], self.normals[near], np.full(near.size, np.nan), nowhere, nowhere, None


def curved(q):
    return np.sin(q[0]) * np.cos(0.5 * q[1]) - 0.2


def slope(q):
    return np.array([np.cos(q[0]) * np.cos(0.5 * q[1]), -0.5 * np.sin(q[0]) * np.sin(0.5 * q[1])])


def pendulum(*given, e=0.5, mu=None):
    """A double pendulum between the floor of a scene and given constraints."""
    scene = mbvi.Scene(restitution=e)
    scene.add_halfspace((0, 0, 1), offset=0.6, name="floor")
    scene.add_urdf(
        ROBOTS / "double_pendulum/double_pendulum.urdf", base="fixed", joints={"shoulder": 0.7, "elbow": 0.5},
        velocity={"elbow": 4.0},
    )  # fmt: skip
    built = scene.build()
    friction = [0.0] * len(built.constraints.constraints) + [mu] * len(given) if mu else 0.0
    return mbvi.Problem(
        built.system, [*built.constraints.constraints, *given], built.q0, built.v0, length=built.length,
        restitution=e, friction=friction,
    )  # fmt: skip


def both(problem, scheme, loops, monkeypatch, duration=1.0):
    """The run, and the same by Python's steps."""
    run = mbvi.simulate(problem, scheme, step=STEP, duration=duration, progress=False)
    # `StewartTrinkle` leaves steps to Python that end on rows which it did not know
    assert loops[-1].codes[[1, 2, 3, 5]].tolist() == [0] * 4
    assert loops[-1].codes[4] <= 1
    monkeypatch.setattr(taking, "compiled_loop", lambda *_: None)
    return run, mbvi.simulate(problem, scheme, step=STEP, duration=duration, progress=False)


@pytest.mark.parametrize("scheme", SCHEMES, ids=repr)
@pytest.mark.parametrize("e", [0.0, 0.5])
def test_the_run_is_that_of_python(scheme, e, loops, monkeypatch):
    problem = pendulum(mbvi.GapFunction(curved, slope, name="bowl"), Posts(), e=e)
    run, other = both(problem, scheme, loops, monkeypatch)
    touched = {name for impact in run.impacts for name in impact.constraints}
    assert {"bowl"} < touched
    assert touched & set(Posts.names)
    assert [impact.constraints for impact in run.impacts] == [impact.constraints for impact in other.impacts]
    np.testing.assert_allclose(run.q, other.q, rtol=0, atol=1e-9)
    np.testing.assert_allclose(run.penetration(), other.penetration(), rtol=0, atol=1e-9)


@pytest.mark.parametrize("scheme", SCHEMES[:4], ids=repr)
def test_a_given_constraint_may_have_friction(scheme, loops, monkeypatch):
    along = lambda q: np.array([[0.0, 1.0], [0.0, 0.0]])  # noqa: E731
    bowl = mbvi.GapFunction(curved, slope, name="bowl", tangents=along)
    run, other = both(pendulum(bowl, e=0.0, mu=0.4), scheme, loops, monkeypatch)
    assert any(impact.constraints == ("bowl",) for impact in run.impacts)
    np.testing.assert_allclose(run.q, other.q, rtol=0, atol=1e-7)
    smooth, _ = both(pendulum(mbvi.GapFunction(curved, slope), e=0.0), scheme, loops, monkeypatch)
    assert np.abs(run.q - smooth.q).max() > 1e-3


class Stop(Exception):
    """Of a user."""


@pytest.mark.parametrize(
    ("act", "error"),
    [
        (lambda: (_ for _ in ()).throw(Stop("enough")), Stop),
        (lambda: signal.raise_signal(signal.SIGINT), KeyboardInterrupt),
        (lambda: np.nan, mbvi.DivergedError),
    ],
    ids=["an error", "an interrupt", "no number"],
)
def test_what_goes_wrong_in_a_function_reaches_the_caller_with_the_run_so_far(act, error):
    calls = []

    def f(q):
        calls.append(q.copy())
        # the check of gradients calls it before the run
        return (act() if len(calls) > 300 else None) or curved(q)

    problem = pendulum(mbvi.GapFunction(f, slope), e=0.0)
    calls.clear()
    with pytest.raises(error) as caught:
        mbvi.simulate(problem, mbvi.Paoli(), step=STEP, duration=1.0, progress=False)
    run = caught.value.run
    assert not run.complete
    assert 0.2 < run.t[-1] < 0.31
    whole = mbvi.simulate(
        pendulum(mbvi.GapFunction(curved, slope), e=0.0), mbvi.Paoli(), step=STEP, duration=run.t[-1], progress=False
    )
    np.testing.assert_array_equal(run.q, whole.q)


def test_more_rows_than_there_is_room_for_are_those_of_python():
    many = type(
        "Many", (), {
            "size": 401, "names": tuple(f"post {k}" for k in range(401)),
            "gap": lambda self, t, q: np.full(401, q[0] - 0.4),
            "gradient": lambda self, t, q: np.tile([1.0, 0.0], (401, 1)),
        },
    )  # fmt: skip
    problem = pendulum(many(), e=0.0)
    run = mbvi.simulate(problem, mbvi.Paoli(), step=STEP, duration=0.6, progress=False)
    assert run.q[:, 0].min() > 0.39
    assert any(len(impact.constraints) > 400 for impact in run.impacts)
