"""`mbvi.sensitivity` and `mbvi.gradient` by gains and targets of `PDControl`: closed forms, laws, limits."""

import numpy as np
import pytest
from scipy.linalg import expm

import mbvi
from mbvi.derivatives.motion.tracking import Tracking
from mbvi.projection import Projector
from mbvi.system.system import located_parts
from support.derivatives import agrees, slopes

OF = ("control stiffness of ", "control damping of ", "control target of ")
MASS = 1.3
CART = f"""<mujoco><option gravity="0 0 0"/><worldbody><body name="cart">
    <joint name="slide" type="slide" axis="1 0 0"/>
    <inertial pos="0 0 0" mass="{MASS}" diaginertia="1 1 1"/>
    <geom type="sphere" size="0.1"/></body></worldbody></mujoco>"""


@pytest.fixture
def cart(tmp_path):
    """A function that returns a cart with a control, above a wall at -0.5 m."""

    def made(control, place=0.8, speed=0.5, wall=True):
        (tmp_path / "cart.xml").write_text(CART)
        scene = mbvi.Scene(gravity=(0, 0, 0), restitution=0.7)
        if wall:
            scene.add_halfspace((1, 0, 0), offset=-0.6, name="wall")
        start = {"joints": {"slide": place}, "velocity": {"slide": speed}}
        scene.add_mjcf(tmp_path / "cart.xml", name="cart", control=control, **start)
        return scene.build()

    return made


def of_cart(*more):
    return [*more, *(one + "cart/slide" for one in OF)]


def oscillator(p, duration):
    """A cart above a wall at -0.5 by (q, v, stiffness, damping, target), exact, below critical damping."""
    q, v, stiffness, damping, target = p
    rate, left = damping / (2 * MASS), duration + 0j
    w = np.sqrt(stiffness / MASS - rate**2)

    def at(t, q, v):
        x, y = q - target, (v + rate * (q - target)) / w
        c, s, shrunk = np.cos(w * t), np.sin(w * t), np.exp(-rate * t)
        place = shrunk * (x * c + y * s)
        return target + place, shrunk * w * (y * c - x * s) - rate * place

    while True:
        grid = np.linspace(1e-6, left.real, 4000)
        below = np.flatnonzero(at(grid, q, v)[0].real < -0.5)
        if not below.size:
            return np.array(at(left, q, v))
        t = grid[below[0]] + 0j
        for _ in range(8):
            t = t - (at(t, q, v)[0] + 0.5) / at(t, q, v)[1]
        q, v, left = -0.5 + 0j, -0.7 * at(t, q, v)[1], left - t


@pytest.mark.parametrize("seed", range(4))
def test_a_damped_oscillator_at_a_wall(cart, seed):
    rng = np.random.default_rng(seed)
    stiffness, damping, target = rng.uniform(3, 6), rng.uniform(0.1, 0.6), rng.uniform(-0.4, -0.3)
    problem = cart(mbvi.PDControl([target], stiffness, damping))
    found = mbvi.sensitivity(problem, mbvi.EventDriven(1e-12), duration=4.0, wrt=of_cart("state"))
    x = np.array([0.8, 0.5, stiffness, damping, target])
    agrees(np.array([*found.run.q[-1], *found.run.v[-1]]), oscillator(x, 4.0).real, 1e-10)
    agrees(found.matrix, slopes(lambda x: oscillator(x, 4.0), x))
    assert found.run.impacts


def both_ways(problem, scheme, bound, **given):
    """The gradient by one pass back is the row times the matrix."""
    row = np.random.default_rng(0).normal(size=2 * problem.system.nv)
    back = mbvi.gradient(problem, lambda q, v: (0.0, row), scheme, **given)
    found = mbvi.sensitivity(problem, scheme, **given)
    exact = row @ found.matrix
    assert found.run.impacts and np.abs(back.gradient - exact).max() <= bound * np.abs(exact).max()
    return found


TRAJECTORY = mbvi.PDControl(
    [[0.5], [-0.6], [0.4]], 6.0, 0.5, v=[[0.0], [0.3], [0.0]], torque=[[0.0], [1.0], [0.5]], times=[0.3, 1.1, 2.9],
    limit=2.0,
)  # fmt: skip
CONTROLS = {
    **{
        f"{limit} N, {d} N s/m": mbvi.PDControl([-0.35], 4.0, d, limit=limit)
        for limit in (0.8, 2.0)
        for d in (0.0, 0.4)
    },
    "trajectory": TRAJECTORY,
}


@pytest.mark.parametrize("name", CONTROLS)
def test_everything_moved_together_moves_the_end_as_much(cart, name):
    """Start, target and wall: the torque reaches and leaves its limits at the same times, through impacts."""
    problem = cart(CONTROLS[name])
    wrt = of_cart("state", "offset of wall")
    found = both_ways(problem, mbvi.EventDriven(1e-11), 1e-10, duration=4.0, wrt=wrt)
    agrees(found.matrix @ [1, 0, 1, 0, 0, 1], np.array([1.0, 0.0]))
    assert np.abs(found.matrix[0, 2]) > 0.1


def long_steps(problem, count, h):
    """Steps of one length, which do not end where slopes jump."""
    flow, none = mbvi.EventDriven(1e-2).integrator(problem, Projector()).flow, np.zeros(0, np.int64)
    t, q, v = problem.t0, problem.q0, problem.v0
    for _ in range(count):
        step = flow.step(t, q, v, flow.acceleration(t, q, v, none), h, none)
        yield flow.with_dense_output(step, none)
        t, q, v = t + h, step.q, step.v


@pytest.mark.parametrize("seed", range(3))
def test_all_kinks_of_a_step_are_found(cart, seed):
    """Of long steps, in which a trajectory has several pieces: the same as by many samples."""
    rng = np.random.default_rng(seed)
    times, places = np.linspace(0.05, 1.9, 14), rng.uniform(-0.5, 1.5, (14, 1))
    control, free = (mbvi.PDControl(places, 6.0, 0.5, times=times, **limit) for limit in ({"limit": 1.5}, {}))
    problem, crossings, pieces = cart(control, wall=False), 0, 0
    tracking = Tracking(located_parts(problem.system)[0])
    shares = np.linspace(0, 1, 1001)
    for step in long_steps(problem, 5, 0.4):
        states = [(step.t + share * step.h, *step.at(problem.system, share)) for share in shares.tolist()]
        limited = np.abs([free(*state)[0] for state in states]) > 1.5
        seen = shares[:-1][limited[1:] != limited[:-1]]
        inner = (times - step.t) / step.h
        inner = inner[(inner > 0) & (inner < 1)]
        found = np.array(sorted(set(tracking.kinks(step)) - set(inner.tolist())))
        assert len(found) == len(seen) and np.abs(found - seen).max(initial=0.0) < 1.1e-3
        crossings, pieces = crossings + len(found), max(pieces, len(inner))
    assert crossings > 4 and pieces > 1


def bounded(p, duration):
    """A cart that is drawn to zero from rest by a stiffness, at most by a force of one: it reaches its edge once."""
    start, stiffness = p
    edge = 1.0 / stiffness
    t = np.sqrt(2 * MASS * (start - edge))
    w, v, left = np.sqrt(stiffness / MASS), -t / MASS, duration - t
    c, s = np.cos(w * left), np.sin(w * left)
    return np.array([edge * c + v / w * s, v * c - edge * w * s])


def test_a_torque_that_leaves_its_limit(cart):
    """Where it does nothing jumps: a saltation there would be seen, and so would a slope of the limited torque."""
    problem = cart(mbvi.PDControl([0.0], 4.0, 0.0, limit=1.0), place=1.0, speed=0.0, wall=False)
    found = mbvi.sensitivity(problem, mbvi.EventDriven(1e-12), duration=1.6, wrt=["state", of_cart()[0]])
    exact = slopes(lambda x: bounded(x, 1.6), np.array([1.0, 4.0]))
    agrees(found.matrix[:, [0, 2]], exact)
    # as long as the limit acts nothing else does
    short = mbvi.sensitivity(problem, mbvi.EventDriven(1e-12), duration=1.0, wrt=of_cart("state"))
    agrees(short.matrix, np.array([[1.0, 1.0, 0, 0, 0], [0, 1.0, 0, 0, 0]]))


@pytest.mark.slow(seconds=5)
def test_a_trajectory_with_limits_against_differences(cart):
    problem = cart(TRAJECTORY)
    wrt = of_cart("state", "torque of cart/slide", "mass of cart/slide")
    coarse, found = (mbvi.sensitivity(problem, mbvi.EventDriven(tol), duration=4.0, wrt=wrt) for tol in (1e-9, 1e-11))
    np.testing.assert_allclose(coarse.matrix, found.matrix, rtol=1e-8)
    # differences across the kinks of the limits have seven digits at best
    assert found.run.impacts and found.check(1).error.max() < 1e-6


def test_actuators_of_a_file_act_by_the_state_too(tmp_path):
    """A position servo is a spring and a damper: the exponential of its matrix."""
    servo = '<actuator><position name="hold" joint="slide" kp="20" kv="0.7"/></actuator></mujoco>'
    (tmp_path / "servo.xml").write_text(CART.replace("</mujoco>", servo))
    scene = mbvi.Scene(gravity=(0, 0, 0))
    scene.add_mjcf(tmp_path / "servo.xml", name="cart", joints={"slide": 0.8}, velocity={"slide": 0.5})
    found = mbvi.sensitivity(scene.build(), mbvi.EventDriven(1e-10), duration=0.5)
    agrees(found.matrix, expm(0.5 * np.array([[0.0, 1.0], [-20.0 / MASS, -0.7 / MASS]])))


def test_a_stiffness_of_zero(cart):
    """It may become less than zero, so that nothing is special there."""
    x, v, target, rate, t = 0.8, -0.7, 0.1, 0.4 / MASS, 1.0
    problem = cart(mbvi.PDControl([target], 0.0, 0.4), x, v)
    found = mbvi.sensitivity(problem, mbvi.EventDriven(1e-11), duration=t, wrt=[of_cart()[0]])
    # w' = (target - q) / m - rate w along q = x + v (1 - exp(-rate t)) / rate
    gone = np.exp(-rate * t)
    speed = ((target - x - v / rate) * (1 - gone) / rate + v / rate * t * gone) / MASS
    assert found.matrix[1, 0] == pytest.approx(speed, rel=1e-9)
    assert found.check(1).error.max() < 1e-8


def double_pendulum(control):
    scene = mbvi.Scene(restitution=0.4)
    scene.add_halfspace((-1, 0, 0), offset=-0.2, name="wall")
    start = {"joints": {"shoulder": 0.3}, "velocity": {"shoulder": 2.0, "elbow": 1.0}}
    scene.add_urdf("robot:double_pendulum", base="fixed", name="arm", control=control, **start)
    return scene.build()


def test_masses_and_gains_together_change_nothing():
    """All forces and M are multiplied by one factor."""
    hold = mbvi.PDControl({"shoulder": 0.4, "elbow": -0.3}, {"shoulder": 6.0, "elbow": 2.0}, 0.3)
    problem = double_pendulum(hold)
    joints = "arm/shoulder", "arm/elbow"
    wrt = [kind + joint for joint in joints for kind in ("mass of ", "inertia of ", *OF[:2])]
    found = mbvi.sensitivity(problem, mbvi.EventDriven(1e-11), duration=1.5, wrt=wrt)
    assert len(found.run.impacts) > 0
    factors = []
    for inertia, stiffness in zip(list(problem.system.model.inertias)[1:], (6.0, 2.0), strict=True):
        factors += [inertia.mass, *inertia.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]], stiffness, 0.3]
    assert np.abs(found.matrix @ factors).max() < 1e-8 * np.abs(found.matrix * factors).max()


HOLD = mbvi.PDControl({"shoulder": 0.5, "elbow": -0.5}, 40.0, 0.6, limit={"shoulder": 15.0, "elbow": 8.0})
OF_ARM = [kind + joint for joint in ("arm/shoulder", "arm/elbow") for kind in OF]


@pytest.mark.slow(seconds=5)
def test_a_double_pendulum_with_limits_against_differences():
    problem = double_pendulum(HOLD)
    found = both_ways(problem, mbvi.EventDriven(1e-11), 1e-9, duration=1.2, wrt=["state", *OF_ARM])
    limited = np.abs([problem.system.control(t, *found.run.at(t)) for t in np.linspace(0, 1.2, 200)]) > [14.99, 7.99]
    assert limited.any(axis=0).all() and not limited.all(axis=0).any()
    check = found.check(1)
    assert check.error.max() < 1e-6, check


@pytest.mark.slow(seconds=5)
@pytest.mark.parametrize("scheme", [mbvi.Centered(), mbvi.Paoli()], ids=repr)
def test_along_fixed_steps(scheme):
    """Their error falls with h, also with limits, and where accelerations pass through zero."""
    problem = double_pendulum(HOLD)
    given = {"duration": 1.2, "wrt": ["state", *OF_ARM]}
    exact = mbvi.sensitivity(problem, mbvi.EventDriven(1e-9), **given).matrix
    coarse = mbvi.sensitivity(problem, scheme, step=8e-3, **given)
    found = coarse.matrix, both_ways(problem, scheme, 1e-11, step=2e-3, **given).matrix
    off = [(np.abs(one - exact) / np.abs(exact).max(axis=0)).max() for one in found]
    assert coarse.run.impacts and off[1] < 1e-1 and off[1] < 0.5 * off[0], off


@pytest.mark.slow(seconds=5)
def test_a_robot_that_lands_with_the_limits_of_its_file():
    hold = mbvi.PDControl({"hip": -0.5, "knee": 1.0}, 400.0, 4.0, limit="effort")
    scene = mbvi.Scene()
    scene.add_halfspace((0, 0.05, 1), name="floor")
    start = {"joints": {"hip": -0.3, "knee": 0.7}, "velocity": {"hip": 1.0}}
    scene.add_urdf("robot:hopper", position=(0, 0, 0.6), name="hopper", control=hold, **start)
    names = [kind + joint for joint in ("hopper/hip", "hopper/knee") for kind in OF]
    found = both_ways(scene.build(), mbvi.EventDriven(1e-8), 1e-7, duration=0.25, wrt=names)
    assert len(found.columns) == 6


def test_a_torque_at_the_edge_of_its_limit(cart):
    """Pressed onto a wall with exactly the largest force: a larger gain changes nothing, a smaller one does."""
    problem = cart(mbvi.PDControl([-1.0], 4.0, 0.5, limit=2.0), place=-0.5, speed=0.0)
    with pytest.raises(mbvi.SensitivityError, match="stays at its limit") as caught:
        mbvi.sensitivity(problem, duration=0.5, wrt=of_cart())
    assert caught.value.bodies == ("cart/slide",) and caught.value.time == 0.0
    for limit in (1.9, 2.1):
        problem = cart(mbvi.PDControl([-1.0], 4.0, 0.5, limit=limit), place=-0.5, speed=0.0)
        assert not mbvi.sensitivity(problem, duration=0.5, wrt=of_cart()).matrix.any()


def test_joints_without_such_gains(cart):
    wrong = [*(kind + joint for kind in OF for joint in ("cart/slide", "cart", "ball")), "control of cart/slide"]
    for control in (None, mbvi.ConstantTorque([0.1]), mbvi.PDControl([0.0], 0.0, 0.0)):
        for name in wrong:
            with pytest.raises(mbvi.InputError, match="wrt"):
                mbvi.sensitivity(cart(control), duration=0.1, wrt=[name])
    hold = mbvi.PDControl({"knee": 1.0}, 40.0, 1.0)
    scene = mbvi.Scene()
    scene.add_urdf("robot:hopper", position=(0, 0, 2), name="hopper", control=hold)
    with pytest.raises(mbvi.InputError, match=r"what has one is hopper/knee$"):
        mbvi.sensitivity(scene.build(), duration=0.1, wrt=["control damping of hopper/hip"])
