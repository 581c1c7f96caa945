"""Slips that begin gently: their directions turn far faster than all else moves, and few steps are needed for them."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import mbvi

MU, MASS, SLIPS_AT, END = 0.3, 2.0, 0.5, 1.5
# the largest horizontal acceleration that a homogeneous ball follows by rolling, 7/2 mu g
HELD = 3.5 * MU * 9.81


def pull(t, rate):
    """Return a horizontal force, over the mass, that turns, and exceeds what friction can hold ever more [m/s^2]."""
    return HELD * (1.0 + 0.02 * (t - SLIPS_AT)) * np.array([np.cos(rate * t), np.sin(rate * t)])


def pulled_ball(rate):
    scene = mbvi.Scene(friction=MU)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_sphere(0.1, MASS, position=(0, 0, 0.1), name="ball")
    scene.add_force("ball", lambda t, q, v: np.append(MASS * pull(t, rate), np.zeros(4)))
    return scene.build()


def motion_of_the_ball(rate):
    """Return a function that gives x, y and their rates of the ball, by plain equations of its slip.

    While it rolls, friction takes 2/7 of the force. The slip s, in polar coordinates, has s' = pull - 7/2 mu g s / |s|.
    """
    accuracy = {"method": "Radau", "rtol": 1e-12, "atol": 1e-16, "dense_output": True}
    rolls = solve_ivp(lambda t, y: [*y[2:], *(5 / 7 * pull(t, rate))], (0.0, SLIPS_AT), np.zeros(4), **accuracy)

    def slides(t, y):
        size, angle = y[4:]
        way, force = np.array([np.cos(angle), np.sin(angle)]), pull(t, rate)
        across = way[0] * force[1] - way[1] * force[0]
        return [*y[2:4], *(force - MU * 9.81 * way), way @ force - HELD, across / size]

    after = 1e-5
    # the slip grows as this just after it has begun, and lags behind the force
    begun, size = SLIPS_AT + after, 0.01 * HELD * after**2
    start = [*rolls.y[:, -1], size, rate * begun - rate * size / HELD]
    start[:2] += after * rolls.y[2:, -1] + 0.5 * after**2 * 5 / 7 * pull(SLIPS_AT, rate)
    start[2:4] += after * 5 / 7 * pull(SLIPS_AT + 0.5 * after, rate)
    slips = solve_ivp(slides, (begun, END), start, **accuracy)
    return lambda t: rolls.sol(t) if t <= SLIPS_AT else slips.sol(t)[:4]


@pytest.mark.parametrize("rate", [3.0, 30.0])
@pytest.mark.parametrize("tolerance", [1e-5, 1e-7, 1e-9])
def test_a_ball_begins_to_slide_under_a_force_that_turns(tolerance, rate):
    run, exact = mbvi.simulate(pulled_ball(rate), mbvi.EventDriven(tolerance), duration=END), motion_of_the_ball(rate)
    assert run.notes == () and len(run.t) <= 100
    times = [t for t in np.linspace(0.0, END, 40) if not SLIPS_AT < t < SLIPS_AT + 1e-3]
    for t in times:
        (q, v), known = run.at(t), exact(t)
        np.testing.assert_allclose(q[:2], known[:2], atol=10 * tolerance)
        np.testing.assert_allclose(v[:2], known[2:], atol=10 * tolerance * max(1.0, np.abs(run.v).max()))


def tumbling(seed):
    """Return an ellipsoid or a capsule that lands on a slope, with drawn parameters."""
    random = np.random.default_rng(seed)
    slope = random.uniform(0.0, 0.4)
    normal = np.array([np.sin(slope), 0.0, np.cos(slope)])
    scene = mbvi.Scene(friction=float(random.choice([0.15, 0.3, 0.5])))
    scene.add_halfspace(normal)
    body = {
        "position": 0.15 * normal,
        "rotation": Rotation.random(rng=random).as_matrix(),
        "velocity": 0.5 * random.normal(size=3),
        "angular_velocity": 3.0 * random.normal(size=3),
    }
    if seed % 2:
        scene.add_capsule(0.05, 0.1, **body)
    else:
        scene.add_ellipsoid((0.1, 0.07, 0.05), **body)
    return scene.build()


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(12))
def test_bodies_that_tumble_on_a_slope_take_few_steps_and_keep_to_the_tolerance(seed):
    problem = tumbling(seed)
    run, fine = (mbvi.simulate(problem, mbvi.EventDriven(tolerance), duration=0.5) for tolerance in (1e-6, 1e-8))
    assert run.notes == () and len(run.t) <= 100
    apart = [np.abs(problem.system.difference(fine.at(t)[0], run.at(t)[0])).max() for t in np.linspace(0.0, 0.5, 60)]
    assert max(apart) <= 1e-5
