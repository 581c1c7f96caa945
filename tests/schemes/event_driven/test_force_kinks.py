"""Forces whose slopes jump: torques of PD control at their limits and along trajectories, springs, actuators."""

from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.optimize import brentq

import mbvi

MASS = 1.3
CART = f"""<mujoco><option gravity="0 0 0"/><worldbody><body name="cart">
    <joint name="slide" type="slide" axis="1 0 0"/>
    <inertial pos="0 0 0" mass="{MASS}" diaginertia="1 1 1"/>
    <geom type="sphere" size="0.1"/></body></worldbody>%s</mujoco>"""
SERVO = '<actuator><position name="hold" joint="slide" kp="40" kv="0.5" forcerange="-1 1"/></actuator>'
MOTOR = '<actuator><motor name="push" joint="slide" ctrlrange="-1 1"/></actuator>'
ROPE = """<tendon><fixed name="rope" stiffness="40" springlength="-0.3 0.5">
    <joint joint="slide" coef="1"/></fixed></tendon>"""
STARTS = [-1.0, -0.3], [0.7, 1.9]
# what acts, and its force between pairs of limits: each a constant and factors of place and speed, with the limits
PUSHED = [((0.0, -40.0, -0.5), -1.0, 1.0)]
CASES = {
    "PD control": ("", {"control": mbvi.PDControl([0.0], 40.0, 0.5, limit=1.0)}, PUSHED),
    "servo": (SERVO, {}, PUSHED),
    "input": (MOTOR, {"ctrl": lambda t, q, v: [-40.0 * q[0] - 0.5 * v[0]]}, PUSHED),
    "rope": (ROPE, {}, [((-12.0, -40.0, 0.0), 0.0, np.inf), ((20.0, -40.0, 0.0), -np.inf, 0.0)]),
}


@pytest.fixture
def cart(tmp_path):
    def made(more, place, speed, **given):
        (tmp_path / "cart.xml").write_text(CART % more)
        scene = mbvi.Scene(gravity=(0, 0, 0))
        scene.add_mjcf(tmp_path / "cart.xml", name="cart", joints={"slide": place}, velocity={"slide": speed}, **given)
        return scene.build()

    return made


def moved(x, forces, duration):
    """A cart under forces that are linear between limits, by matrix exponentials from limit to limit."""
    x, left = np.array([*x, 1.0]), duration
    while True:
        A = np.zeros((3, 3))
        A[0, 1] = 1.0
        soon = x + 1e-9 * np.array([x[1], sum(np.clip(law @ x[[2, 0, 1]], *limits) for law, *limits in forces), 0.0])
        edges = []
        for law, low, high in forces:
            row = np.array(law)[[1, 2, 0]]
            value = row @ soon
            A[1] += (row if low < value < high else [0.0, 0.0, np.clip(value, low, high)]) / np.array(MASS)
            edges += [(row, limit) for limit in (low, high) if np.isfinite(limit)]
        grid, found = np.linspace(0.0, left, 2000)[1:], [left]
        states = np.array([expm(A * t) @ x for t in grid])
        for row, limit in edges:
            off = states @ row - limit
            for k in np.flatnonzero(off[1:] * off[:-1] < 0.0)[:1]:
                found.append(brentq(lambda t: row @ expm(A * t) @ x - limit, grid[k], grid[k + 1], xtol=1e-15))  # noqa: B023
        x, left = expm(A * min(found)) @ x, left - min(found)
        if left <= 0.0:
            return x[:2]


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("start", STARTS)
def test_a_force_reaches_and_leaves_its_limits(cart, case, start):
    more, given, forces = CASES[case]
    exact = moved(start, forces, 5.0)
    for tolerance in (1e-5, 1e-6, 1e-8, 1e-10):
        run = mbvi.simulate(cart(more, *start, **given), mbvi.EventDriven(tolerance), duration=5.0)
        found = np.array([run.q[-1][0], run.v[-1][0]])
        np.testing.assert_allclose(found, exact, rtol=0, atol=2.0 * tolerance)
        assert len(run.t) < 140


TIMES = np.linspace(0.0, 0.9, 10)
GAINS, LIMIT = (np.array([60.0, 30.0]), np.array([3.0, 1.5])), np.array([8.0, 4.0])
WAY = 0.8 * np.sin(4.0 * TIMES[:, None] + [0.0, 1.0])
SPEED = 3.2 * np.cos(4.0 * TIMES[:, None] + [0.0, 1.0])
START = np.array([-0.5, 0.9])


def pendulum(limit=LIMIT, times=TIMES, way=WAY, speed=SPEED):
    """A double pendulum that is led along a trajectory, without limits of its joints."""
    scene = mbvi.Scene()
    scene.add_urdf(
        mbvi.robot("double_pendulum"), base="fixed", name="p",
        control=mbvi.PDControl(way, *GAINS, v=speed, times=times, limit=limit),
    )  # fmt: skip
    problem = scene.build()
    return mbvi.Problem(problem.system, [], START, [0.0, 0.0], length=problem.length), problem.model("p")


def led(model, duration):
    """Where it ends, by scipy's DOP853 from one jump of a slope to the next one."""
    data, x, margins = model.createData(), np.array([*START, 0.0, 0.0]), []

    def torque(t, x, k):
        share = (t - TIMES[k]) / (TIMES[k + 1] - TIMES[k])
        way, speed = ((1 - share) * rows[k] + share * rows[k + 1] for rows in (WAY, SPEED))
        return GAINS[0] * (way - x[:2]) + GAINS[1] * (speed - x[2:])

    def rate(t, x, k, side):
        tau = np.where(side == 0, torque(t, x, k), side * LIMIT)
        return np.concatenate([x[2:], pin.aba(model, data, x[:2], x[2:], tau)])

    def margin(j, sign):
        def left(t, x, k, side):
            if side[j]:
                return side[j] * torque(t, x, k)[j] - LIMIT[j]
            return LIMIT[j] - sign * torque(t, x, k)[j]

        left.terminal, left.direction = True, -1.0
        return left

    margins = [margin(j, sign) for j in (0, 1) for sign in (-1, 1)]
    for k, (t, end) in enumerate(pairwise([*TIMES[TIMES < duration], duration])):
        while t < end:
            over = torque(t, x, k)
            clipped = np.where(np.abs(over) < LIMIT, 0, np.sign(over))
            soon = torque(t + 1e-9, x + 1e-9 * rate(t, x, k, clipped), k)
            side = np.where(np.abs(soon) < LIMIT, 0, np.sign(soon))
            found = solve_ivp(
                rate, (t, end), x, "DOP853", events=margins, rtol=1e-13, atol=1e-14, max_step=0.02, args=(k, side)
            )
            t, x = found.t[-1], found.y[:, -1]
    return x


def test_a_robot_is_led_along_a_trajectory():
    problem, model = pendulum()
    exact = led(model, 0.8)
    for tolerance in (1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10):
        run = mbvi.simulate(problem, mbvi.EventDriven(tolerance), duration=0.8)
        speed = np.abs(run.v).max()
        np.testing.assert_allclose(run.q[-1], exact[:2], rtol=0, atol=tolerance)
        np.testing.assert_allclose(run.v[-1], exact[2:], rtol=0, atol=tolerance * speed)


def test_limits_that_are_not_reached_change_nothing():
    runs = [mbvi.simulate(pendulum(limit)[0], mbvi.EventDriven(1e-7), duration=0.5) for limit in (None, 1e4)]
    assert np.array_equal(runs[0].q, runs[1].q) and np.array_equal(runs[0].v, runs[1].v)


def test_steps_are_longer_than_the_steps_of_a_fine_trajectory():
    times = np.linspace(0.0, 1.0, 2001)
    way = np.sin(3.0 * times[:, None] + [0.0, 1.0])
    problem, _ = pendulum(None, times, way, 3.0 * np.cos(3.0 * times[:, None] + [0.0, 1.0]))
    assert len(mbvi.simulate(problem, mbvi.EventDriven(1e-5), duration=1.0).t) < 100


@pytest.mark.parametrize("length", [1e-2, 1e-3, 1e-5])
def test_a_torque_of_a_trajectory_is_not_missed_however_short(cart, length):
    """A trapezoid: its impulse is its height times the sum of its two lengths."""
    times, torque = 0.7 + length * np.array([0.0, 0.1, 0.9, 1.0]), np.array([[0.0], [1.0], [1.0], [0.0]]) / length
    run = mbvi.simulate(
        cart("", 0.0, 0.0, control=mbvi.PDControl(np.zeros((4, 1)), 0.0, 0.0, torque=torque, times=times)),
        mbvi.EventDriven(1e-6),
        duration=2.0,
    )
    assert abs(run.v[-1][0] - 0.9 / MASS) < 1e-6
    assert len(run.t) < 60


def test_a_force_may_stay_at_its_limit(cart):
    """The cart rests where the force is its limit to rounding."""
    scene_force = mbvi.PDControl([0.3], 10.0 / 3.0, 0.1, limit=1.0, torque=[-1.0])
    for place in (0.3 - 0.3, 0.3 - 0.3 * (1.0 + 1e-15)):
        run = mbvi.simulate(cart("", place, 0.0, control=scene_force), mbvi.EventDriven(1e-8), duration=1.0)
        assert len(run.t) < 40
