"""`mbvi.sensitivity` through limits of actuators and slack of springs, against closed forms."""

import numpy as np
import pytest

import mbvi
from support.derivatives import agrees, slopes

MASS, STIFFNESS = 1.3, 4.0
CART = f"""<mujoco><option gravity="0 0 0"/><worldbody><body name="cart">
    <joint name="slide" type="slide" axis="1 0 0"/>
    <inertial pos="0 0 0" mass="{MASS}" diaginertia="1 1 1"/>
    <geom type="sphere" size="0.1"/></body></worldbody>%s</mujoco>"""
SERVO = f'<actuator><position name="hold" joint="slide" kp="{STIFFNESS}" kv="0" forcerange="-1 1"/></actuator>'
MOTOR = '<actuator><motor name="push" joint="slide" ctrlrange="-1 1"/></actuator>'
ROPE = f"""<tendon><fixed name="rope" stiffness="{STIFFNESS}" springlength="-9 0.5">
    <joint joint="slide" coef="1"/></fixed></tendon>"""


def cart(tmp_path, more, place, speed, **given):
    (tmp_path / "cart.xml").write_text(CART % more)
    scene = mbvi.Scene(gravity=(0, 0, 0))
    scene.add_mjcf(tmp_path / "cart.xml", name="cart", joints={"slide": place}, velocity={"slide": speed}, **given)
    return scene.build()


def pulled(x, duration):
    """Drawn to zero by a stiffness, at most by a force of one: it leaves that limit once."""
    place, speed = x
    edge, push = 1.0 / STIFFNESS, 1.0 / MASS
    t = (speed + np.sqrt(speed**2 + 2.0 * push * (place - edge))) / push
    return swung(edge, speed - push * t, 0.0, duration - t)


def roped(x, duration):
    """Free up to 0.5, where a rope becomes tight, and free again when it comes back."""
    place, speed = x
    t, w = (0.5 - place) / speed, np.sqrt(STIFFNESS / MASS)
    if (duration - t).real < np.pi / w:
        return swung(0.5, speed, 0.5, duration - t)
    return np.array([0.5 - speed * (duration - t - np.pi / w), -speed])


def swung(place, speed, centre, t):
    w = np.sqrt(STIFFNESS / MASS)
    c, s = np.cos(w * t), np.sin(w * t)
    return np.array([centre + (place - centre) * c + speed / w * s, speed * c - w * (place - centre) * s])


CASES = {
    "servo": (SERVO, {}, pulled, (1.0, 0.2), 1.9),
    "input": (MOTOR, {"ctrl": lambda t, q, v: [-STIFFNESS * q[0]]}, pulled, (1.0, 0.2), 1.9),
    "tight": (ROPE, {}, roped, (0.1, 0.8), 1.3),
    "slack": (ROPE, {}, roped, (0.1, 0.8), 3.0),
}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("tolerance", [1e-8, 1e-12])
def test_the_times_at_which_limits_begin_and_end_to_act_are_found(tmp_path, case, tolerance):
    more, given, motion, start, duration = CASES[case]
    problem = cart(tmp_path, more, *start, **given)
    found = mbvi.sensitivity(problem, mbvi.EventDriven(tolerance), duration=duration)
    exact = slopes(lambda x: motion(x, duration), np.array(start))
    agrees(found.matrix, exact, 100.0 * tolerance)
    row = np.array([0.3, -0.7])
    back = mbvi.gradient(problem, lambda q, v: (0.0, row), mbvi.EventDriven(tolerance), duration=duration)
    agrees(back.gradient, row @ exact, 100.0 * tolerance)


def test_a_force_that_stays_at_its_limit_has_no_derivative(tmp_path):
    """The cart rests where the servo has exactly its largest force, held by a wall."""
    (tmp_path / "cart.xml").write_text(CART % SERVO)
    scene = mbvi.Scene(gravity=(0, 0, 0))
    scene.add_halfspace((1, 0, 0), offset=0.15, name="wall")
    scene.add_mjcf(tmp_path / "cart.xml", name="cart", joints={"slide": 0.25})
    with pytest.raises(mbvi.SensitivityError, match="stays at its limit"):
        mbvi.sensitivity(scene.build(), mbvi.EventDriven(1e-9), duration=0.3)
