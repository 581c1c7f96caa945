"""Derivatives along runs of fixed steps: of the motion that they approximate, with an error that falls with h."""

import numpy as np
import pytest

import mbvi
from mbvi.derivatives.fixed_steps import LocatedSteps
from mbvi.reference import MAKERS
from mbvi.schemes.event_driven.impact_event import ImpactEvent
from support.robot_problems import tilted_quadruped

G = 9.81
SCHEMES = [
    mbvi.Paoli(),
    mbvi.MoreauJean(),
    mbvi.Centered(),
    mbvi.Centered(project_positions=True),
    mbvi.StewartTrinkle(),
]
NAMES = [repr(scheme) for scheme in SCHEMES]


def ball(e=0.7, height=1.0):
    scene = mbvi.Scene(restitution=e)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_sphere(radius=0.1, mass=1.0, position=(0, 0, height), name="ball")
    return scene.build()


def errors(problem, scheme, duration, steps, **given):
    """Relative errors, compared with a run whose impacts are located to 1e-10."""
    exact = mbvi.sensitivity(problem, mbvi.EventDriven(1e-10), duration=duration, **given).matrix
    found = [mbvi.sensitivity(problem, scheme, duration=duration, step=h, **given) for h in steps]
    assert all(len(one.matrices) == len(one.run.t) and one.run.impacts for one in found)
    return [np.abs(one.matrix - exact).max() / np.abs(exact).max() for one in found]


@pytest.mark.parametrize("scheme", SCHEMES, ids=NAMES)
def test_a_ball_at_e_one(scheme):
    """The derivative of a step's map is 1 at any h; the exact one is 0.7352."""
    fall = np.sqrt(1.8 / G)
    exact = (2 * (0.8 - fall) - fall) / fall
    found = [mbvi.sensitivity(ball(1.0), scheme, duration=0.8, step=h).matrix[2, 2] for h in (1e-2, 1e-3)]
    assert np.all(np.abs(np.array(found) - exact) < [5e-2, 5e-3]), found


@pytest.mark.parametrize("e", [0.7, 1.0])
def test_impacts_are_located_in_their_steps(e):
    """`Centered` falls exactly, so that only the time of the impact in its step is found here."""
    run = mbvi.simulate(ball(e), mbvi.Centered(), step=1e-2, duration=0.5, progress=False)
    event = next(part for part, _ in LocatedSteps(run, 1e-9).parts() if isinstance(part, ImpactEvent))
    fall = np.sqrt(1.8 / G)
    assert event.t == pytest.approx(fall, abs=1e-9)
    assert event.before[2] == pytest.approx(-G * fall, abs=1e-9)
    assert event.after[2] == pytest.approx(e * G * fall, abs=1e-9)


@pytest.mark.parametrize("scheme", SCHEMES, ids=NAMES)
def test_a_ball_by_all_its_parameters(scheme):
    wrt = ["state", "restitution", "gravity", "offset of floor"]
    coarse, fine = errors(ball(), scheme, 1.2, (1e-2, 1e-3), wrt=wrt)
    assert coarse < 5e-2 and fine < 5e-3


@pytest.mark.slow(seconds=5)
def test_a_double_pendulum_at_a_wall():
    ref = MAKERS["double pendulum"](0.5)
    found = errors(ref.problem, mbvi.Centered(), 0.9 * ref.duration, (1e-2, 3e-3, 1e-3))
    assert found[0] < 1e-1 and found[1] < 2e-2 and found[2] < 5e-3, found


def test_feet_that_stay_closed():
    """A quadruped lands on three feet, one after the other, with e = 0."""
    coarse, fine = errors(tilted_quadruped(), mbvi.Paoli(), 0.12, (1e-3, 3e-4))
    assert coarse < 3e-2 and fine < 4e-3


def test_a_contact_that_opens():
    """A point slides down a circle and leaves it, where its contact force becomes zero."""
    outside = mbvi.GapFunction(lambda q: 0.5 * (q @ q - 1), lambda q: q)
    system = mbvi.LagrangianSystem(lambda q: np.eye(2), lambda t, q, v: np.array([0.0, -G]), 2)
    start = [np.sin(0.3), np.cos(0.3)], [np.cos(0.3), -np.sin(0.3)]
    problem = mbvi.Problem(system, [outside], *start)
    exact = mbvi.sensitivity(problem, mbvi.EventDriven(1e-10), duration=0.45).matrix
    found = [mbvi.sensitivity(problem, mbvi.StewartTrinkle(), duration=0.45, step=h).matrix for h in (1e-2, 1e-3)]
    off = [np.abs(one - exact).max() / np.abs(exact).max() for one in found]
    assert off[0] < 1e-1 and off[1] < 1e-2, off


def test_the_gradient_is_the_row_times_the_matrix():
    problem, wrt = ball(), ["state", "restitution", "mass of ball", "offset of floor"]
    row = np.random.default_rng(0).normal(size=6 * 2)[: 2 * problem.system.nv]
    given = {"duration": 1.2, "step": 1e-2, "wrt": wrt}
    found = mbvi.gradient(problem, lambda q, v: (0.0, row), mbvi.Centered(), **given)
    exact = row @ mbvi.sensitivity(problem, mbvi.Centered(), **given).matrix
    assert np.abs(found.gradient - exact).max() < 1e-12 * np.abs(exact).max()


def refused(problem, reason, duration, step, scheme=SCHEMES[0]):
    with pytest.raises(mbvi.SensitivityError, match=reason) as caught:
        mbvi.sensitivity(problem, scheme, duration=duration, step=step)
    assert caught.value.run.complete
    return caught.value


def test_where_there_is_none():
    # impacts that accumulate, and a step that is too long for them
    refused(ball(0.5), "grazes|accumulate", 2.0, 1e-3)
    system = mbvi.LagrangianSystem(lambda q: np.diag([1.0, 0.1]), lambda t, q, v: np.array([-G, 0.0]), 2)
    feet = [
        mbvi.GapFunction(
            lambda q, s=s: q[0] + s * 0.5 * np.sin(q[1]), lambda q, s=s: np.array([1.0, s * 0.5 * np.cos(q[1])]),
            name=f"foot {s:+d}",
        )
        for s in (-1, 1)
    ]  # fmt: skip
    error = refused(mbvi.Problem(system, feet, [0.3, 0.0], [0.0, 0.0], restitution=0.5), "not orthogonal", 0.4, 1e-3)
    assert error.bodies == ("foot -1", "foot +1") and abs(error.time - np.sqrt(0.6 / G)) < 2e-3
    refused(mbvi.Problem(system, feet[:1], [0.0, 0.0], [-1.0, 0.0], restitution=0.5), "starts with", 0.1, 1e-3)


def test_a_step_that_the_scheme_chooses():
    with pytest.raises(mbvi.InputError, match="leave out step"):
        mbvi.sensitivity(ball(), mbvi.EventDriven(), duration=0.1, step=1e-3)
