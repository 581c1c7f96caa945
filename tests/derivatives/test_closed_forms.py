"""`mbvi.sensitivity` against closed forms, whose derivatives are exact by complex steps, and against laws."""

import numpy as np
import pytest

import mbvi
from mbvi.reference import MAKERS
from support.derivatives import agrees, beads, slopes

G = 9.81
BOTH = ("state", "restitution")


def problem(dim, force, gaps, q, v, e):
    """A system of unit masses, and constraints as pairs of a function and its gradient."""
    system = mbvi.LagrangianSystem(lambda q: np.eye(dim), force, dim)
    walls = [mbvi.GapFunction(f, gradient, name=f"wall {k}") for k, (f, gradient) in enumerate(gaps)]
    return mbvi.Problem(system, walls, q, v, restitution=e)


def differentiated(given, duration, wrt=BOTH, tolerance=1e-12):
    return mbvi.sensitivity(given, mbvi.EventDriven(tolerance), duration=duration, wrt=wrt)


def ball(x, duration):
    """Height and speed of a ball above a floor, from (height, speed, e)."""
    z, w, e = x
    left = duration
    while True:
        t = (w + np.sqrt(w * w + 2 * G * z)) / G
        if t.real >= np.real(left):
            return np.array([z + w * left - 0.5 * G * left**2, w - G * left])
        z, w, left = 0.0, -e * (w - G * t), left - t


@pytest.mark.parametrize("seed", range(6))
def test_a_bouncing_ball(seed):
    rng = np.random.default_rng(seed)
    x, duration = np.array([rng.uniform(0.3, 2), rng.normal(), rng.uniform(0.5, 1)]), rng.uniform(0.7, 1.2)
    floor = (lambda q: q[0], lambda q: np.ones(1))
    found = differentiated(problem(1, lambda t, q, v: np.array([-G]), [floor], x[:1], x[1:2], x[2]), duration)
    agrees(found.matrix, slopes(lambda x: ball(x, duration), x))
    assert len(found.run.impacts) > 0


def test_the_ball_whose_derivative_every_fixed_step_gets_wrong():
    """d z(T) / d z0 at e = 1: that of the map of every step is 1, at any length."""
    scene = mbvi.Scene(restitution=1.0)
    scene.add_halfspace((0, 0, 1), name="floor")
    scene.add_sphere(radius=0.1, mass=1.0, position=(0, 0, 1.0), name="ball")
    found = mbvi.sensitivity(scene.build(), duration=0.8)
    fall = np.sqrt(2 * 0.9 / G)
    assert found.matrix[2, 2] == pytest.approx((2 * (0.8 - fall) - fall) / fall, rel=1e-9)
    assert round(found.matrix[2, 2], 4) == 0.7352


def test_two_balls_that_exchange_their_speeds():
    """nimblephysics' issue 97: the last ball's place by both places and both speeds is (1, 0, 1, 0)."""
    touch = (lambda q: q[1] - q[0] - 0.2, lambda q: np.array([-1.0, 1.0]))
    found = differentiated(problem(2, lambda t, q, v: np.zeros(2), [touch], [0.0, 0.52], [1.0, 0.0], 1.0), 1.0)
    assert np.abs(found.matrix[1, :4] - [1, 0, 1, 0]).max() < 1e-10


@pytest.mark.parametrize("seed", range(4))
def test_beads(seed):
    rng = np.random.default_rng(seed)
    masses, e = rng.uniform(0.5, 2, 3), rng.uniform(0.5, 1)
    x = np.array([0, 0.5, 1.1, *sorted(rng.normal(size=3))[::-1], e])
    gaps = [(lambda q, k=k: q[k + 1] - q[k], lambda q, k=k: np.eye(3)[k + 1] - np.eye(3)[k]) for k in range(2)]
    system = mbvi.LagrangianSystem(lambda q: np.diag(masses), lambda t, q, v: np.zeros(3), 3)
    walls = [mbvi.GapFunction(f, gradient) for f, gradient in gaps]
    found = differentiated(mbvi.Problem(system, walls, x[:3], x[3:6], restitution=e), 2.0)
    agrees(found.matrix, slopes(lambda x: beads(x, 2.0, masses), x))
    assert len(found.run.impacts) > 0


def oscillator(x, duration, wall=-0.5):
    """q'' = -q above a wall, from (q, v, e); the time of an impact by Newton's method."""
    q, v, e, left = *x, duration
    while True:
        grid = np.linspace(1e-6, np.real(left), 4000)
        below = np.flatnonzero(q.real * np.cos(grid) + v.real * np.sin(grid) < wall)
        if not below.size:
            return np.array([q * np.cos(left) + v * np.sin(left), v * np.cos(left) - q * np.sin(left)])
        t = grid[below[0]] + 0j
        for _ in range(8):
            t = t - (q * np.cos(t) + v * np.sin(t) - wall) / (v * np.cos(t) - q * np.sin(t))
        q, v, left = wall + 0j, -e * (v * np.cos(t) - q * np.sin(t)), left - t


@pytest.mark.parametrize("seed", range(4))
def test_an_oscillator_at_a_wall(seed):
    rng = np.random.default_rng(seed)
    x = np.array([rng.uniform(1, 2), rng.normal(), rng.uniform(0.5, 1)])
    wall = (lambda q: q[0] + 0.5, lambda q: np.ones(1))
    found = differentiated(problem(1, lambda t, q, v: -q, [wall], x[:1], x[1:2], x[2]), 6.0)
    agrees(found.matrix, slopes(lambda x: oscillator(x, 6.0), x))
    assert len(found.run.impacts) > 0


def billiard(x, duration):
    """A free point within the unit circle, from (q, v, e)."""
    q, v, e, left = x[:2], x[2:4], x[4], duration
    while True:
        a, b, c = v @ v, q @ v, q @ q - 1
        t = (-b + np.sqrt(b * b - a * c)) / a
        if t.real > np.real(left):
            return np.concatenate([q + left * v, v])
        q, left = q + t * v, left - t
        v = v - (1 + e) * (v @ q) * q


DISC = (lambda q: 0.5 * (1 - q @ q), lambda q: -q)


@pytest.mark.parametrize("seed", range(4))
def test_a_billiard_in_a_disc(seed):
    rng = np.random.default_rng(seed)
    x = np.array([*rng.uniform(-0.4, 0.4, 2), *rng.normal(size=2), rng.uniform(0.7, 1)])
    found = differentiated(problem(2, lambda t, q, v: np.zeros(2), [DISC], x[:2], x[2:4], x[4]), 2.5)
    agrees(found.matrix, slopes(lambda x: billiard(x, 2.5), x))
    assert len(found.run.impacts) > 0


def test_a_closed_contact():
    """Sliding along a circle: variations of angle and speed are those that keep the contact closed."""
    angle, speed, duration = 0.3, 0.7, 2.0

    def state(x, t):
        turned = x[0] + t * x[1]
        return np.array([np.cos(turned), np.sin(turned), -x[1] * np.sin(turned), x[1] * np.cos(turned)])

    x = np.array([angle, speed])
    start, end = (slopes(lambda x, t=t: state(x, t), x) for t in (0.0, duration))
    began = state(x, 0.0)
    found = differentiated(problem(2, lambda t, q, v: np.zeros(2), [DISC], began[:2], began[2:], 0.0), duration)
    agrees(found.matrix[:, :4] @ start, end)
    # what would open the contact is left out
    assert np.linalg.matrix_rank(found.matrices[0][:, :4], tol=1e-9) == 2
    agrees(found.matrices[0][:, :4] @ start, start)


def test_a_release():
    """A point slides down the outside of a circle and leaves it, where its contact force becomes zero."""
    outside = (lambda q: 0.5 * (q @ q - 1), lambda q: q)
    start = np.array([np.sin(0.3), np.cos(0.3)]), np.array([np.cos(0.3), -np.sin(0.3)])
    given = problem(2, lambda t, q, v: np.array([0.0, -G]), [outside], *start, 0.0)
    found = differentiated(given, 0.45, ("state",), 1e-10)
    assert not found.run.impacts and found.run.q[-1] @ found.run.q[-1] > 1.01
    check = found.check(1)
    assert check.error.max() < 1e-7, check


def test_at_an_impact_of_e_zero_the_contact_stays_closed():
    """A ball that lands on a slope slides down it: place and speed along the slope by the start."""
    slope = np.array([np.sin(0.4), np.cos(0.4)])
    along, gravity = np.array([slope[1], -slope[0]]), np.array([0.0, -G])
    floor = (lambda q: q @ slope, lambda q: slope)

    def motion(x):
        q, v = x[:2], x[2:4]
        rate, pull = v @ slope, -gravity @ slope
        t = (rate + np.sqrt(rate * rate + 2 * pull * (q @ slope))) / pull
        place, speed, left = (q + v * t + 0.5 * gravity * t * t) @ along, (v + gravity * t) @ along, 0.9 - t
        down = gravity @ along
        return np.concatenate([(place + speed * left + 0.5 * down * left**2) * along, (speed + down * left) * along])

    x = np.array([0.1, 0.8, 0.3, -0.2])
    found = differentiated(problem(2, lambda t, q, v: gravity, [floor], x[:2], x[2:], 0.0), 0.9)
    agrees(found.matrix[:, :4], slopes(motion, x))
    # bounces that end at once: e changes nothing in the end, to first order
    assert np.abs(found.matrix[:, 4]).max() < 1e-9
    # by differences on one side, because e < 0 is no restitution
    assert found.check(1).error.max() < 1e-6


@pytest.mark.parametrize(
    ("name", "e"), [("rocking block", 0.5), ("tumbling body", 0.5), ("tumbling body", 0.0), ("double pendulum", 0.5)]
)
def test_a_variation_along_the_motion_stays_one(name, e):
    """Nothing depends on time alone, so the derivative carries (v, dv/dt) at the start to that at the end."""
    ref = MAKERS[name](e)
    found = differentiated(ref.problem, 0.7 * ref.duration, ("state",), 1e-11)
    run, system = found.run, ref.problem.system
    # the forces of closed contacts are read from the dense output
    ends = [np.concatenate([run.v[k], system.acceleration(run.t[k], run.q[k], run.v[k])]) for k in (0, -1)]
    if e == 0.0:
        n, h = system.nv, run.t[-1] - run.t[-2]
        ends[1][n:] = run.record.dense[-1, 1] @ np.arange(1, 8)
        assert h > 0.0
    agrees(found.matrix @ ends[0], ends[1], 1e-7 if e == 0.0 else 1e-8)


def test_elastic_impacts_are_symplectic():
    """With p = M v the derivative of an elastic motion keeps dq ^ dp."""
    ref = MAKERS["double pendulum"](1.0)
    found = differentiated(ref.problem, 0.6 * ref.duration, ("state",), 1e-11)
    assert len(found.run.impacts) > 0

    def momenta(q, v):
        system, out = ref.problem.system, np.eye(4)
        mass = system.metric(q).dense()
        turned = [(system.metric(q + dq).dense() - system.metric(q - dq).dense()) @ v / 2e-5 for dq in 1e-5 * np.eye(2)]
        out[2:, :2], out[2:, 2:] = np.array(turned).T, mass
        return out

    form = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.eye(2), np.zeros((2, 2))]])
    run = found.run
    canonical = momenta(run.q[-1], run.v[-1]) @ found.matrix @ np.linalg.inv(momenta(run.q[0], run.v[0]))
    assert np.abs(canonical.T @ form @ canonical - form).max() < 1e-8 * np.abs(canonical).max() ** 2
